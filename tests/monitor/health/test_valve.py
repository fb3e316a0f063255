"""Evidence of a valve on simulated loops whose truth is known: what is named, what is not, and how evidence adds up."""

from __future__ import annotations

from functools import cache, reduce

import numpy as np
import pandas as pd
import pytest

from monitor.health.valve import (
    GRID_FACTOR,
    MOST_BANDS,
    ValveEvidence,
    figures_of,
    merged,
    valve_evidence,
    valve_found,
)
from tests.bench.valves_fleet import SETTLING, simulate
from tests.support.places import SHARED

BLOCK = 1024
PLAY, STICK = 1.0, 3.0


@cache
def loop(kind: float, integrating: bool = False, seed: int = 1, blocks: int = 4) -> np.ndarray:
    """A PI loop (rows SP, PV, OP) under a wandering load, with a band of 2 OP, noise of a tenth of it."""
    rng = np.random.default_rng(seed)
    n = blocks * BLOCK + SETTLING
    load, walk = np.zeros(n), 0.0
    for t, push in enumerate(rng.normal(size=n)):
        walk += 0.12 * push - 0.005 * walk
        load[t] = walk
    plant = np.array([1.0, 0.05, 1.0, 2.0]) if integrating else np.array([0.0, 1.0, 3.0, 1.0])
    law = np.array([2.0, 60.0, 0.0]) if integrating else np.array([0.3, 8.0, 0.0])
    signals = np.stack([np.zeros(n), load, 0.1 * rng.normal(size=n)])
    out = simulate(plant, law, np.array([kind, 2.0, 0.0]), signals, 1)
    return np.asarray(out[:3, SETTLING:])


def evidence(rows: np.ndarray) -> ValveEvidence | None:
    return reduce(_both, (valve_evidence(*rows[:, k : k + BLOCK]) for k in range(0, rows.shape[1], BLOCK)))


def _both(one: ValveEvidence | None, other: ValveEvidence | None) -> ValveEvidence | None:
    return merged(one, other) if one is not None and other is not None else one or other


def strength(rows: np.ndarray) -> float:
    found = evidence(rows)
    valve = valve_found(found) if found is not None else None
    return 0.0 if valve is None else valve.strength


@pytest.mark.parametrize("kind", [PLAY, STICK])
@pytest.mark.parametrize("integrating", [False, True])
def test_what_explains_most_is_near_the_valves_band(kind: float, integrating: bool) -> None:
    found = evidence(loop(kind, integrating))
    assert found is not None
    lr = figures_of(found)["lr"]
    assert lr.max() > 30.0
    band = GRID_FACTOR ** (found.first + int(np.argmax(lr.max(axis=(0, 1)))))
    assert 0.6 < band / 2.0 < 1.4


@pytest.mark.parametrize(("kind", "integrating"), [(STICK, False), (STICK, True), (PLAY, True)])
def test_a_valve_is_named(kind: float, integrating: bool) -> None:
    found = evidence(loop(kind, integrating, 2))
    assert found is not None
    valve = valve_found(found)
    assert valve is not None
    assert valve.strength > 0.5
    assert 0.6 < valve.band / 2.0 < 1.4


@pytest.mark.parametrize("integrating", [False, True])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_sound_loop_is_not(integrating: bool, seed: int) -> None:
    assert strength(loop(0.0, integrating, seed)) <= 0.5


def test_a_quiet_output_says_nothing() -> None:
    rng = np.random.default_rng(0)
    sp = np.zeros(BLOCK)
    assert valve_evidence(sp, rng.normal(size=BLOCK), rng.normal(size=BLOCK)) is None
    assert valve_evidence(sp, rng.normal(size=BLOCK), np.full(BLOCK, 40.0)) is None


def test_too_few_or_missing_samples_say_nothing() -> None:
    rows = loop(PLAY)
    assert valve_evidence(*rows[:, :50]) is None
    gone = rows[:, :BLOCK].copy()
    gone[1, 100] = np.nan
    assert valve_evidence(*gone) is None


@pytest.mark.parametrize(
    ("of_pv", "of_op", "shift"), [(1e-3, 1.0, 0.0), (1.0, 1.0, 1e3), (-1.0, 1.0, 0.0), (5.0, -1.0, 50.0)]
)
def test_units_offsets_and_signs_do_not_matter(of_pv: float, of_op: float, shift: float) -> None:
    rows = loop(PLAY)[:, :BLOCK]
    scaled = np.stack([of_pv * rows[0] + shift, of_pv * rows[1] + shift, of_op * rows[2] + shift])
    one, other = valve_evidence(*rows), valve_evidence(*scaled)
    assert one is not None
    assert other is not None
    assert other.first == one.first
    assert other.fits[..., 0] == pytest.approx(one.fits[..., 0], rel=1e-2, abs=0.1)


def test_a_band_is_in_units_of_op() -> None:
    rows = loop(PLAY).copy()
    rows[2] /= 1.2**10
    one, other = evidence(loop(PLAY)), evidence(rows)
    assert one is not None
    assert other is not None
    assert other.first == one.first - 10
    assert other.fits[..., 0] == pytest.approx(one.fits[..., 0], rel=1e-2, abs=0.1)


def test_evidence_adds_up_in_any_order() -> None:
    parts = [valve_evidence(*loop(PLAY, False, s)[:, :BLOCK]) for s in (1, 2, 3)]
    a, b, c = (p for p in parts if p is not None)
    one, other = merged(merged(a, b), c), merged(c, merged(b, a))
    assert one.first == other.first
    assert one.blocks == other.blocks == 3
    assert one.fits == pytest.approx(other.fits, rel=1e-4, abs=1e-3)
    assert one.rests == pytest.approx(other.rests, rel=1e-4, abs=1e-3)


def test_evidence_is_bounded() -> None:
    rows = loop(PLAY)
    found = None
    for scale in (1e-6, 1e-3, 1.0, 8.0):
        found = _both(found, valve_evidence(rows[0, :BLOCK], rows[1, :BLOCK], scale * rows[2, :BLOCK]))
    assert found is not None
    assert found.fits.shape[2] == MOST_BANDS
    assert found.fits.nbytes + found.rests.nbytes < 11_000


def test_one_block_does_not_outweigh_others() -> None:
    found = evidence(loop(0.0))
    assert found is not None
    assert found.fits[..., 0].min() >= -30.0 * found.blocks


def test_recorded_valves() -> None:
    """Real records: most valves are named, nothing else is."""
    folder = SHARED / "data" / "plant"
    if not folder.is_dir():
        pytest.skip("../shared/data is not there")
    labels = pd.read_csv(folder / "labels.csv").set_index("loop")["label"]
    named = []
    for name, rows in pd.read_parquet(folder / "data.parquet").groupby("loop"):
        found = valve_evidence(*(rows[c].to_numpy(float) for c in ("sp", "pv", "op")))
        valve = valve_found(found) if found is not None else None
        if valve is not None and valve.strength > 0.5:
            named.append(labels[name])
    assert named.count("valve") >= 12
    assert set(named) == {"valve"}
