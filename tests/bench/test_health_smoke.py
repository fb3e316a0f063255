"""A few loops of the benchmark `health`: it runs, repeats itself, and most loops are called what they are."""

from __future__ import annotations

import numpy as np
import pytest

from sim_plants.loops import Simulation
from tests.bench.health import (
    CLASSES,
    KINDS,
    PROCESSES,
    archived,
    confusion,
    health_of,
    kind_of,
    share_right,
    slowed,
)
from tests.bench.health_archive import held, interpolated, reports, swinging_door
from tests.bench.health_fleet import draw

SEED = 11
"""Not the benchmark's own."""


def test_most_loops_are_called_what_they_are() -> None:
    found = confusion(5, SEED)
    assert set(found) == {(p, t) for p in PROCESSES for t in CLASSES}
    for process in PROCESSES:
        assert found[process, "healthy"]["healthy"] == 5
        assert share_right(found, process) >= 0.8
    assert {k for count in found.values() for k in count} <= set(KINDS)


def test_the_same_loop_twice() -> None:
    one, other = (draw("sticking", "integrating", 3, SEED) for _ in range(2))
    assert one.spec == other.spec
    assert kind_of(health_of(one.block)) == kind_of(health_of(other.block))


@pytest.mark.parametrize("process", PROCESSES)
def test_a_slower_loop_is_the_same_but_slower(process: str) -> None:
    case = draw("sinusoidal", process, 2, SEED)  # type: ignore[arg-type]
    slow = slowed(case.spec, 4.0)
    fast, late = health_of(case.block), health_of(Simulation([slow]).advance(4 * 8000.0))
    assert fast.oscillation_period is not None
    assert late.oscillation_period == pytest.approx(4 * fast.oscillation_period, rel=0.05)
    assert health_of(Simulation([slow]).advance(4 * 8000.0), every=4).mean_abs_e == pytest.approx(
        late.mean_abs_e, rel=0.05
    )


def test_an_archive_stays_within_its_deviation() -> None:
    pv = np.cumsum(np.random.default_rng(0).normal(size=2000))
    kept = swinging_door(pv, 0.8)
    assert len(kept) < 1000
    assert np.abs(interpolated(pv, kept) - pv).max() < 2 * 0.8
    assert np.abs(held(pv, reports(pv, 0.8)) - pv).max() <= 0.8


def test_compression_is_seen_and_raw_data_are_not_accused() -> None:
    for name, ratio, shown, raw in archived():
        assert shown is not None
        if ratio >= 3:
            assert shown > 0.5, name
            assert name.startswith("oscillation") or (raw is not None and raw > 0.5), name
        if ratio == 1:
            assert shown < 0.1, name
