"""Loops whose rows come by exception: their steps are found and judged, and it is said how they come."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import SETPOINT
from monitor.contract.samples import Samples
from monitor.engine import Engine
from tests.monitor.reporting.tools import by_exception
from tests.support.plants import pi_loop, times
from tests.support.runs import run, sorted_records

LOOP = Loop(name="L", process="integrating", kp=1.2, ti=200.0, op_low=0, op_high=100, pv_low=0, pv_high=100)
"""Slow for a gain of 0.01 and a dead time of 10 s."""


def reported(band: float, longest: float, every: bool, seed: int = 0, steps: bool = True) -> Samples:
    """Two set-point steps, two hours apart, of a slow loop whose noise is a sixth of its dead band."""
    sp = np.full(21_600, 50.0)
    if steps:
        sp[5000:13_000] += 6.0
    pv, op = pi_loop(sp, kp=1.2, ti=200.0, gain=0.01, dead=10, noise=band / 6, seed=seed)
    return by_exception(Samples.of(0, times(len(sp)), sp, pv, op), band, longest, every)


@pytest.mark.parametrize(
    ("band", "longest", "every"),
    [(0.25, 600.0, True), (0.25, 600.0, False), (0.1, 1800.0, False), (0.35, 900.0, False)],
)
def test_steps_are_found_and_the_gain_is_right(band, longest, every):
    engine, seen = run(LOOP, reported(band, longest, every))
    found = [a for a in seen.assessments if a.kind == SETPOINT]
    assert len(seen.assessments) == len(found)  # a crossing of the dead band is no load step
    assert len(found) >= 1
    assert all(a.gain_lo < 0.0105 and a.gain_hi > 0.0095 for a in found)
    row = engine.row(0)
    assert "exception_reported" in row.flags
    assert "compressed" not in row.flags
    assert row.quantum == pytest.approx(band, rel=0.5)
    assert "reported by exception" in row.reason
    assert engine.counts()["ok"] == len(reported(band, longest, every))


def test_without_a_step_it_is_named_with_the_way_out():
    sp = np.full(12_000, 50.0)
    pv, op = pi_loop(sp, kp=1.2, ti=200.0, gain=0.01, dead=10, noise=0.1)
    pv += np.interp(np.arange(12_000), [0, 3000, 6000, 9000, 12_000], [0, 4, 0, 4, 0])
    engine, seen = run(
        LOOP, by_exception(Samples.of(0, times(len(sp)), sp, pv, op), 0.25, 600.0, every=False)
    )
    row = engine.row(0)
    assert "exception_reported" in row.flags
    assert "switch exception reporting off" in row.action
    assert "idle" not in row.flags
    assert not [a for a in seen.assessments if a.kind == SETPOINT]


@pytest.mark.parametrize("size", [1, 37])
def test_live_is_the_audit(size):
    """Rows one by one, or in small batches, give the records of all at once."""
    rows = reported(0.25, 600.0, every=True, seed=3)
    _, whole = run(LOOP, rows)
    engine = Engine(LoopTable([LOOP]))
    records = [r for k in range(0, len(rows), size) for r in engine.step(rows.take(slice(k, k + size)))]
    seen = sorted_records(records + engine.flush())
    assert seen.assessments == whole.assessments
    assert seen.suggestions == whole.suggestions
    assert sorted(map(repr, seen.events)) == sorted(map(repr, whole.events))


def test_between_heartbeats_a_loop_is_not_silent():
    """What it may leave unsaid is no silence: staleness goes by the heartbeat."""
    rows = reported(0.25, 600.0, every=True)
    engine = Engine(LoopTable([LOOP]))
    engine.step(rows)
    last = engine.last_sample(0)
    assert last.time == rows.time[-1]
    assert last.period >= 500.0
    assert last.good == len(rows)


def test_rows_that_wait_have_been_heard():
    engine = Engine(LoopTable([LOOP]))
    engine.step(Samples.of(0, times(6, 600.0), 50.0, 50.0 + 0.1 * np.arange(6), 40.0))
    last = engine.last_sample(0)
    assert last.good == 6
    assert last.time == times(6, 600.0)[-1]
