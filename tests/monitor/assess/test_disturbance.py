"""A disturbance: recorded, judged by what is known of the loop, and never more than that."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import DISTURBANCE, INCONCLUSIVE, LOAD, NOT_ASSESSED, SETPOINT, Assessment
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.wire.encode import encode_record
from tests.monitor.assess.test_upset import ONSET, half_sine, pulse, several, upset_loop
from tests.support.plants import START, pi_loop, times
from tests.support.runs import run, sorted_records

LOOP = Loop(name="L", kp=2.0, ti=40.0)


@pytest.mark.parametrize("load", [pulse, half_sine, several])
@pytest.mark.parametrize("process", ["auto", "integrating"])
def test_what_is_no_step_is_recorded_as_none(load, process):
    """One row of its own kind: no index, no model, no verdict but that; the loop's reason tells of it."""
    engine, seen = run(Loop(name="L", kp=2.0, ti=40.0, process=process), upset_loop(load, 0.05))
    (found,) = seen.assessments
    assert (found.kind, found.state, found.verdict) == (DISTURBANCE, "settled", INCONCLUSIVE)
    assert (found.ci, found.gain, found.fit, found.ms) == (None, None, None, None)
    assert found.iae is not None
    assert found.recovery is not None
    assert found.start == pytest.approx(START + ONSET * 1e9, abs=12e9)
    (closed,) = seen.closed
    assert (closed.id, closed.kind, closed.amplitude) == (found.id, DISTURBANCE, found.amplitude)
    (window,) = seen.windows
    assert window.id == found.id
    row = engine.row(0)
    assert (row.disturbances, row.events, row.verdict, row.new_kp) == (1, 0, NOT_ASSESSED, None)
    assert row.reason.startswith("1 upset was seen, no clean step: ")
    assert engine.disturbances == 1
    assert json.loads(encode_record(found))["damping"] == found.damping


def test_a_load_step_stays_one():
    _, seen = run(LOOP, upset_loop(lambda k: 8.0 * (k >= ONSET), 0.05))
    assert [a.kind for a in seen.assessments] == [LOAD]


def test_a_jump_behind_the_process_is_no_load_step():
    """PV of an integrating process jumps, and OP comes back to where it was."""
    sp = np.full(1500, 50.0)
    pv, op = pi_loop(sp, noise=0.05, disturb=lambda k, pv: pv + 2.0 * (k >= ONSET))
    for process in ("auto", "integrating"):
        _, seen = run(
            Loop(name="L", kp=2.0, ti=40.0, process=process), Samples.of(0, times(1500), sp, pv, op)
        )
        assert [a.kind for a in seen.assessments] == [DISTURBANCE]


@pytest.mark.parametrize(
    ("end", "word"),
    [("data", "the end of the data"), ("gap", "a gap"), ("mode", "manual"), ("step", "set point")],
)
def test_what_is_cut_short_is_recorded_so(end, word):
    """As far as seen, with what cut it short."""
    n, cut = 1500, ONSET + 90
    sp = np.where(np.arange(n) < cut, 50.0, 54.0 if end == "step" else 50.0)
    pv, op = pi_loop(sp, noise=0.05, load=several)
    samples = Samples.of(0, times(n), sp, pv, op, auto=(np.arange(n) < cut) if end == "mode" else True)
    if end == "data":
        samples = samples.take(slice(0, cut))
    if end == "gap":
        samples = samples.take(np.r_[0:cut, cut + 100 : n])
    engine, seen = run(LOOP, samples)
    found = next(a for a in seen.assessments if a.kind == DISTURBANCE)
    assert (found.state, found.recovery) == ("interrupted", None)
    assert word in found.reason
    assert "not seen to come back" in found.reason
    assert engine.row(0).disturbances == 1


def with_step_first(**facts: float) -> Samples:
    """A set-point step, and a pulse after it."""
    sp = np.where(np.arange(6000) < 300, 50.0, 54.0)
    pv, op = pi_loop(sp, noise=0.02, load=lambda k: pulse(k - 2600), **facts)
    return Samples.of(0, times(6000), sp, pv, op)


def test_a_recovery_is_measured_by_the_process_known():
    """In dead times, beside the reference loop; numbered after the step, whose verdict stands."""
    engine, seen = run(LOOP, with_step_first())
    step, upset = seen.assessments
    assert (step.kind, upset.kind, upset.event) == (SETPOINT, DISTURBANCE, 2)
    assert "dead times" in upset.reason
    assert "the reference loop takes" in upset.reason
    row = engine.row(0)
    assert (row.events, row.disturbances, row.verdict, row.reason) == (1, 1, step.verdict, step.reason)


def test_a_slow_loop_crawls_back():
    _, seen = run(Loop(name="L", kp=0.4, ti=400.0), with_step_first(kp=0.4, ti=400.0))
    assert any("crawls back" in a.reason for a in seen.assessments if a.kind == DISTURBANCE)


def test_the_same_however_batched():
    samples = upset_loop(several, 0.05)
    whole, parts = Engine(LoopTable([LOOP])), Engine(LoopTable([LOOP]))
    at_once = whole.step(samples) + whole.flush()
    piecewise = [r for k in range(0, len(samples), 37) for r in parts.step(samples.take(slice(k, k + 37)))]
    piecewise += parts.flush()
    records = [sorted_records(r).assessments for r in (at_once, piecewise)]
    assert records[0] == records[1] != []


def test_several_are_told_by_the_largest():
    """Two pulses: the row says how many, and what the larger one was like."""
    sp = np.full(3000, 50.0)
    pv, op = pi_loop(sp, noise=0.05, load=lambda k: pulse(k) - 2.0 * pulse(k - 1200))
    engine, seen = run(LOOP, Samples.of(0, times(3000), sp, pv, op))
    sizes = [a.amplitude for a in seen.assessments if isinstance(a, Assessment)]
    assert len(sizes) == 2
    row = engine.row(0)
    assert row.disturbances == 2
    assert f"2 upsets were seen, none a clean step: the largest {max(sizes, key=abs):+.3g} [PV]" in row.reason
    assert math.copysign(1.0, sizes[0]) == -math.copysign(1.0, sizes[1])
