"""A loop's rows one by one: what is put out for them; of loops that come by exception steps are found and judged."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import SETPOINT
from monitor.contract.samples import QUALITY_GOOD, Columns, Samples
from monitor.engine import Engine
from monitor.reporting import kernel
from monitor.reporting.state import HOLDING, LATE_ROWS, PASSING, REPORTING, RING_ROWS, ROW
from tests.monitor.reporting.tools import by_exception
from tests.support.plants import START, pi_loop, times
from tests.support.runs import run, sorted_records

LOOP = Loop(name="L", process="integrating", kp=1.2, ti=200.0, op_low=0, op_high=100, pv_low=0, pv_high=100)
"""Slow for a gain of 0.01 and a dead time of 10 s."""
S = 10**9
"""Nanoseconds of a second."""


def reported(band: float, longest: float, every: bool, seed: int = 0, steps: bool = True) -> Samples:
    """Two set-point steps, two hours apart, of a slow loop whose noise is a sixth of its dead band."""
    sp = np.full(21_600, 50.0)
    if steps:
        sp[5000:13_000] += 6.0
    pv, op = pi_loop(sp, kp=1.2, ti=200.0, gain=0.01, dead=10, noise=band / 6, seed=seed)
    return by_exception(Samples.of(0, times(len(sp)), sp, pv, op), band, longest, every)


def columns(samples: Samples) -> Columns:
    return Columns(*(getattr(samples, f.name) for f in fields(Samples)))


def rows_at(*seconds: float, pv: Any = 50.0, op: Any = 40.0) -> Columns:
    """Rows of loop 0 so many seconds after the start."""
    return columns(Samples.of(0, START + np.round(np.array(seconds) * S).astype(np.int64), 50.0, pv, op))


def room(n: int) -> Columns:
    return columns(Samples.of(0, np.zeros(n, np.int64), 0.0, 0.0, 0.0))


def holding(**facts: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return state and ring of a loop whose values are held every 10 s; its last row is at 0 s, PV 50."""
    state, ring = np.zeros(1, REPORTING), np.zeros((1, RING_ROWS), ROW)
    last = {
        "rows": 2,
        "time": START,
        "out_time": START,
        "sp": 50.0,
        "pv": 50.0,
        "op": 40.0,
        "auto": 1,
        "good": 1,
    }
    way = {"mode": HOLDING, "period": 10 * S, "beat": 600 * S, "band": 0.4, "shown": 50.0}
    for name, value in (last | way | facts).items():
        state[name] = value
    return state, ring


def put_out(state: Any, ring: Any, batch: Columns, size: int = 1000) -> list[tuple[float, float, float]]:
    """Return all that comes out, (seconds, PV, OP), by pieces of so many rows at most."""
    found: list[tuple[float, float, float]] = []
    at = 0
    while at < len(batch.time):
        out = room(size)
        at, n, changed = kernel.take(state, ring, batch, at, out)
        assert changed == -1
        assert n > 0 or at == len(batch.time)
        found += zip(
            ((out.time[:n] - START) / S).tolist(), out.pv[:n].tolist(), out.op[:n].tolist(), strict=True
        )
    return found


@pytest.mark.parametrize("size", [2, 3, 1000])
def test_values_are_held_until_the_next_row(size):
    """On the grid, not closer than half a period to the row; the row itself comes as it is, room or not."""
    state, ring = holding()
    found = put_out(state, ring, rows_at(34.0, 58.0, pv=[51.0, 52.0], op=[41.0, 42.0]), size)
    assert found == [
        *((10.0, 50.0, 40.0), (20.0, 50.0, 40.0), (34.0, 51.0, 41.0)),
        *((44.0, 51.0, 41.0), (58.0, 52.0, 42.0)),
    ]
    assert state["added"][0] == 3


def test_a_pv_within_half_the_dead_band_is_the_one_before():
    """A row for the sake of OP brings PV's noise with it; more than half a band is a move."""
    state, ring = holding()
    found = put_out(state, ring, rows_at(10.0, 20.0, 30.0, pv=[50.19, 50.21, 50.1], op=[41.0, 42.0, 43.0]))
    assert found == [(10.0, 50.0, 41.0), (20.0, 50.21, 42.0), (30.0, 50.21, 43.0)]


@pytest.mark.parametrize(("silence", "held"), [(890.0, 88), (910.0, 0)])
def test_nothing_is_held_across_a_gap(silence, held):
    """A heartbeat of 600 s may come half as late again."""
    state, ring = holding()
    assert len(put_out(state, ring, rows_at(silence))) == held + 1


def test_nothing_is_held_after_a_bad_row():
    """The bad row is handed on; what was known before it is not known to hold."""
    state, ring = holding()
    found = put_out(state, ring, rows_at(30.0, 60.0, 90.0, pv=[np.nan, 51.0, 51.0]))
    assert [second for second, _, _ in found] == [30.0, 60.0, 70.0, 80.0, 90.0]


def test_a_clock_that_was_set_back_ends_the_holding():
    """A late row alone does not, nor do as many as a network may bring late."""
    for late, changed in ((LATE_ROWS, -1), (LATE_ROWS + 1, 0)):
        state, ring = holding()
        _, n, loop = kernel.take(state, ring, rows_at(*(-100.0 + k for k in range(late))), 0, room(100))
        assert (n, loop) == (LATE_ROWS, changed)
        assert (state["mode"][0] == PASSING) == (changed == 0)


@pytest.mark.parametrize(
    ("change", "first"),
    [
        ({}, 10),
        ({"pv": np.nan}, 6),
        ({"op": np.inf}, 6),
        ({"quality": 0}, 6),
        ({"time": START}, 6),
        ({"time": START + 100 * S}, 6),
    ],
)
def test_rows_are_handed_on_up_to_the_first_odd_one(change, first):
    """Up to a bad one, a late one, and in a loop that is new up to one after far too long."""
    batch = columns(
        Samples.of(
            0, times(10), 50.0, np.full(10, 50.0), np.full(10, 40.0), quality=np.full(10, QUALITY_GOOD)
        )
    )
    for name, value in change.items():
        getattr(batch, name)[6] = value
    state = np.zeros(1, REPORTING)
    assert kernel.passes(state, batch, 0) == first
    assert state["time"][0] == batch.time[first - 1]


@pytest.mark.parametrize(
    ("band", "longest", "every"),
    [(0.25, 600.0, True), (0.25, 600.0, False), (0.1, 1800.0, False), (0.35, 900.0, False)],
)
def test_steps_are_found_and_the_gain_is_right(band, longest, every):
    engine, seen = run(LOOP, reported(band, longest, every))
    found = [a for a in seen.assessments if a.kind == SETPOINT]
    assert len(seen.assessments) == len(found)  # a crossing of the dead band is no load step
    assert len(found) >= 1
    scored = [a for a in found if a.ci is not None]  # a load beside a step may be the dead band's
    assert all(a.gain_lo < 0.0105 and a.gain_hi > 0.0095 for a in scored)
    row = engine.row(0)
    assert "exception_reported" in row.flags
    assert "compressed" not in row.flags
    assert row.quantum == pytest.approx(band, rel=0.5)
    assert "reported by exception" in row.reason
    assert engine.seen.counts()["ok"] == len(reported(band, longest, every))


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
    last = engine.seen.last(0)
    assert last.time == rows.time[-1]
    assert last.period >= 500.0
    assert last.good == len(rows)


def test_rows_that_wait_have_been_heard():
    engine = Engine(LoopTable([LOOP]))
    engine.step(Samples.of(0, times(6, 600.0), 50.0, 50.0 + 0.1 * np.arange(6), 40.0))
    last = engine.seen.last(0)
    assert last.good == 6
    assert last.time == times(6, 600.0)[-1]
