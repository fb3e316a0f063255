"""The benchmark `mismatch`: its judge against figures of others and against itself, a few loops of some kinds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_plants.controllers import Controller
from sim_plants.plants import Plant as OtherPlant
from sim_plants.specs import LoopSpec
from tests.bench.mismatch import HEAD, describe, table_line, totals, worst
from tests.bench.mismatch_event import event, record
from tests.bench.mismatch_fleet import KINDS, RIGHT, TABLE, draw
from tests.bench.mismatch_judge import judge, judge_many
from tests.bench.mismatch_plant import INTEGRATING, Law, grid, peak, sampled
from tests.bench.mismatch_shapes import SHAPES, simple
from tests.bench.mismatch_sim import Rig
from tests.bench.retune_truth import sensitivity

SEED = 13
"""Not the benchmark's own."""


@pytest.mark.parametrize("form", ["series", "standard"])
@pytest.mark.parametrize("process", ["integrating", "self-regulating"])
def test_peak_agrees_with_the_judge_of_the_other_benchmark(form: str, process: str) -> None:
    law = Law(0.2, 30.0, 2.0, 0.2, form)
    mine = peak(simple(process, 0.5, 2.3, [4.0, 1.0]), law, 0.7)
    spec = LoopSpec(
        "x", OtherPlant(process, 0.5, 2.3, (4.0, 1.0)), Controller(0.2, 30.0, 2.0, form=form), period=0.7
    )  # type: ignore[arg-type]
    assert mine == pytest.approx(sensitivity(spec, spec.controller), rel=2e-3)


def test_series_settings_are_the_same_law_in_the_standard_form() -> None:
    series, omega = Law(2.0, 30.0, 8.0, 0.8, "series"), np.geomspace(1e-3, 100.0, 50)
    standard = Law(**series.standard, tf=0.8)
    # executed so often that it makes no difference
    assert standard.response(omega, 1e-6) == pytest.approx(series.response(omega, 1e-6), rel=1e-4)


@pytest.mark.parametrize("name", SHAPES)
def test_a_sine_through_the_simulator_is_the_frequency_response(name: str) -> None:
    """In open loop, a held sine of OP comes out of every plant as the response on the unit circle says."""
    rng = np.random.default_rng(3)
    plant = SHAPES[name](rng, 5.0, 0.01)
    rig = Rig(plant, Law(1e-12, math.inf, 0.0, 0.0), 1.0, 1)
    turns, many = 2 * math.pi / 25, 4000
    pv, _ = rig.run(np.zeros(many), np.sin(turns * np.arange(many)))
    assert plant.dead_time == 5.0
    # of what is left after all transients: sine and cosine, a constant where it integrates
    k = np.arange(many)[-500:]
    basis = np.column_stack(
        [np.sin(turns * k), np.cos(turns * k), np.ones(500), k, np.exp(-plant.slowest * (k - k[0]))]
    )
    sine, cosine = np.linalg.lstsq(basis, pv[-500:], rcond=None)[0][:2]
    wanted = sampled(plant, np.array([turns]), 1.0)[0]
    assert complex(sine, cosine) == pytest.approx(wanted, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize("filtered", [0.0, 3.0])
@pytest.mark.parametrize("scan", [1, 3])
def test_the_limit_of_stability_is_where_the_simulation_begins_to_grow(
    late: int, filtered: float, scan: int
) -> None:
    plant = simple(INTEGRATING, 0.1, 3.0, [2.0])
    law = Law(1.0, 60.0, 1.0, 0.1, "series", filter=filtered, late=late)
    gains = np.geomspace(0.1, 10.0, 60)
    stable = [math.isfinite(peak(plant, replace(law, kp=k), float(scan))) for k in gains]
    limit = gains[stable.index(False)]
    for factor, grows in ((0.85, False), (1.15, True)):
        rig = Rig(plant, replace(law, kp=limit * factor), 1.0, scan)
        pv, _ = rig.run(np.ones(6000), np.zeros(6000))
        error = np.abs(1 - pv)
        assert (error[-1000:].max() > error[2000:3000].max()) == grows


def test_the_grid_sees_a_narrow_resonance() -> None:
    rng = np.random.default_rng(1)
    plant = SHAPES["resonance_narrow"](rng, 5.0, 0.01)
    law = Law(0.2 / (plant.slope * plant.theta), 40.0, 0.0, 0.0)
    omega = np.geomspace(1e-4, math.pi, 200_000)
    fine = 1 / np.abs(1 + sampled(plant, omega, 1.0) * law.response(omega, 1.0)).min()
    rough = grid(plant, law, 1.0)
    assert 1 / np.abs(1 + sampled(plant, rough, 1.0) * law.response(rough, 1.0)).min() == pytest.approx(
        fine, rel=0.02
    )


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_can_be_drawn_and_recorded(name: str) -> None:
    for number in range(2):
        drawn = draw(KINDS[name], number, SEED)
        rig = drawn.unused()
        samples = record(drawn, event(drawn, rig, 0), 0, 0)
        assert np.isfinite(samples.pv).all()
        assert (np.diff(samples.time) > 0).all()
        assert np.ptp(samples.op) > 0
        again = draw(KINDS[name], number, SEED)
        assert again.law == drawn.law
        assert again.table == drawn.table


def test_a_campaign_goes_on_where_it_was() -> None:
    outcomes = judge_many("base-integrating", range(4), SEED, 2)
    assert any(o.cured and o.told for o in outcomes)
    for outcome in outcomes:
        assert not outcome.crash
        assert len({r["id"] for r in outcome.records}) == len(outcome.records) >= 2
    alike = [judge(KINDS["base-integrating"], 1, SEED, 2) for _ in range(2)]
    assert repr(replace(alike[0], cost=0.0)) == repr(replace(alike[1], cost=0.0))


def test_table_totals_and_descriptions() -> None:
    outcomes = [
        judge(KINDS[name], k, SEED) for name in ("base", "pv-filter", "ti-in-minutes") for k in range(2)
    ]
    assert len(table_line("base", outcomes[:2])) == len(HEAD)
    assert any(line.startswith("suggestions") for line in totals(outcomes))
    assert all(str(o.number) in describe(o) for o in outcomes)
    assert len(worst(outcomes)) <= len(outcomes)


def test_kinds_are_many_and_of_all_groups() -> None:
    assert len(KINDS) >= 40
    assert {RIGHT, TABLE} < {kind.group for kind in KINDS.values()}
    assert len({kind.group for kind in KINDS.values()}) == 6
    assert not any(kind.right for kind in KINDS.values() if kind.table)
