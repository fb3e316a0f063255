"""What evidence cannot carry a verdict."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.assess.event import assess_event
from monitor.assess.evidence import evidence_against, is_explained, op_moved, wound_up
from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE
from monitor.contract.samples import Samples
from monitor.detect.event import LOAD_STEP, SETPOINT_STEP
from tests.monitor.assess.tools import assessed
from tests.support.detection import closed_event
from tests.support.fits import make_fit
from tests.support.plants import pi_loop, stepped

LOOP = Loop(name="L", kp=2.0, ti=40.0)


@pytest.mark.parametrize(
    ("change", "facts", "word"),
    [
        ({}, {"kp": -2.0}, "sign"),
        ({"saturated": True}, {"op_high": 54.0, "op_low": 0.0}, "limit"),
        ({"holes": True}, {}, "covered"),
        ({"coarse": True}, {}, "coarse"),
        ({"offset": True}, {"ti": math.inf}, "no integral action"),
        ({"jump": True}, {}, "something else moved"),
    ],
    ids=["wrong sign", "saturated", "holes", "too coarse", "offset", "another cause"],
)
def test_evidence_that_cannot_carry_a_verdict(change, facts, word):
    """`inconclusive` with the cause in words, never a suggestion."""
    samples = stepped(1200, noise=0.02)
    if change.get("saturated"):
        op = np.minimum(samples.op, 54.0)
        samples = replace(samples, op=np.where(np.arange(1200) < 250, op, 54.0))
    if change.get("holes"):
        keep = np.arange(1200) % 3 == 0
        keep[:200] = True
        samples = samples.take(keep)
        facts = {**facts, "period": 1.0}
    if change.get("coarse"):
        samples = samples.take(slice(0, None, 10))
    if change.get("offset"):
        pv = np.where(np.arange(1200) < 200, 50.0, 50 + 2.4 * (1 - np.exp(-(np.arange(1200) - 200) / 15)))
        samples = replace(samples, pv=pv, op=50 + 2.0 * (samples.sp - pv))
    if change.get("jump"):
        samples = stepped(1200, noise=0.02, disturb=lambda k, pv: pv + 3.0 * (k > 215))
    found, engine, seen = assessed(samples, **facts)
    assert found.verdict == INCONCLUSIVE
    assert word in found.reason
    assert seen.suggestions == []
    assert engine.row(0).new_kp is None


@pytest.mark.parametrize(("times", "named"), [(1.0, False), (3.0, True)])
def test_no_loop_goes_far_beyond_its_set_point_by_itself(times, named):
    """At the edge of instability it goes one step beyond."""
    event = closed_event()
    w = event.window
    pv = np.where(np.abs(w.time - w.time[-1] / 2) < 3.0, w.sp + times * event.amplitude, w.pv)
    event = replace(event, window=replace(w, pv=pv))
    reasons = evidence_against(LOOP, event, make_fit(), True)
    assert any("times the step beyond the set point" in reason for reason in reasons) is named


def clipped(kp: float, ti: float, high: float) -> Samples:
    """A step of 4 whose OP stands at its limit for most of the rise, where the integral waits."""
    return stepped(2500, kp=kp, ti=ti, noise=0.01, low=0.0, high=high)


@pytest.mark.parametrize(
    ("kp", "ti", "verdict"), [(2.0, 40.0, GOOD), (4.4, 20.0, RETUNE), (1.2, 400.0, RETUNE)]
)
def test_a_limit_takes_the_index_and_leaves_the_model(kp, ti, verdict):
    """The process saw OP as it was recorded: gain, Ms and the indices predicted of it are as good as ever."""
    limits = {"op_low": 0.0, "op_high": 50.6}
    found, engine, _ = assessed(clipped(kp, ti, 50.6), kp=kp, ti=ti, **limits)
    free, _, _ = assessed(stepped(2500, kp=kp, ti=ti, noise=0.01), kp=kp, ti=ti)
    assert found.verdict == verdict
    assert found.ci is None
    assert "OP was at its limit for" in found.reason
    assert "no index" in found.reason
    assert found.gain == pytest.approx(0.05, rel=0.05)
    assert found.ms == pytest.approx(free.ms, rel=0.15)
    row = engine.row(0)
    assert (row.verdict, row.ci_setpoint) == (verdict, None)
    assert (row.new_kp is not None) == (verdict == RETUNE)


def test_a_limit_without_settings_leaves_no_verdict():
    """Nothing is measured and nothing can be predicted."""
    event = replace(closed_event(), saturated_time=0.5 * closed_event().duration)
    found = assess_event(Loop(name="L"), event)
    assert (found.record.verdict, found.record.ci) == (INCONCLUSIVE, None)
    assert "none is predicted" in found.record.reason
    assert found.record.gain is not None


def test_an_integral_that_winds_up_is_no_matter_of_the_tuning():
    """OP stays at its limit for long after PV has passed the set point."""
    event, loop = closed_event(), Loop(name="L", kp=2.0, ti=40.0, op_low=0.0, op_high=60.0)
    w = event.window
    beyond = (w.time > 14.0) & (w.time < 60.0)
    over = replace(
        w, pv=np.where(beyond, w.sp + 1.0, w.pv), op=np.where((w.time >= 0.0) & (w.time < 60.0), 60.0, w.op)
    )
    wound = replace(event, window=over, saturated_time=60.0, duration=150.0)
    assert wound_up(loop, wound) == pytest.approx(46.0, abs=2.0)
    assert wound_up(loop, event) == 0.0
    assert wound_up(Loop(name="L"), wound) == 0.0
    found = assess_event(loop, wound)
    assert (found.record.verdict, found.usable) == (INCONCLUSIVE, False)
    assert "winds up" in found.record.reason
    # with the other sign of the gain it asks for the limit
    assert wound_up(Loop(name="L", kp=-2.0, ti=40.0, op_low=0.0, op_high=60.0), wound) < 25.0


def test_a_load_against_a_limit_leaves_no_model():
    """While OP rests the load's size and the gain are one number."""
    event = replace(closed_event(), kind=LOAD_STEP)
    half = replace(event, saturated_time=0.5 * event.duration)
    assert any("tells the load" in why for why in evidence_against(LOOP, half, make_fit(), True))
    fifth = replace(event, saturated_time=0.2 * event.duration)
    assert not any("limit" in why for why in evidence_against(LOOP, fifth, make_fit(), True))


@pytest.mark.parametrize(("size", "moved"), [(3.0, True), (15.0, True), (0.01, False), (200.0, False)])
def test_a_load_of_which_op_has_answered_nothing_is_no_event(size, moved):
    """OP goes by 2 from a noise of 0.1: a load within 20 times of that, and above the noise, may be its cause."""
    event = closed_event()
    op = np.random.default_rng(0).normal(0.0, 0.1, len(event.window)) - 2.0 * (event.window.time > 0.0)
    event = replace(event, window=replace(event.window, op=op))
    fit = replace(make_fit(), size=size, onset=float(event.window.time[0]) + 2.0 * event.period)
    assert op_moved(fit, event) == moved


@pytest.mark.parametrize(
    ("kind", "quality", "sigma", "noise", "amplitude", "enough"),
    [
        (SETPOINT_STEP, 0.96, 0.1, 0.1, 2.0, True),
        (SETPOINT_STEP, 0.85, 0.1, 0.1, 2.0, True),  # nothing but noise is left
        (SETPOINT_STEP, 0.85, 0.2, 0.1, 2.0, False),
        (SETPOINT_STEP, 0.85, 0.1, 0.1, 0.5, False),  # noise makes shapes of this size
        (SETPOINT_STEP, 0.96, 0.1, 0.01, 2.0, False),  # what is left has a cause of its own
        (SETPOINT_STEP, 0.85, 0.1, 0.01, 2.0, False),
        (SETPOINT_STEP, 0.99, 0.1, 0.01, 2.0, True),
        (LOAD_STEP, 0.93, 0.1, 0.1, 2.0, True),
        (LOAD_STEP, 0.85, 0.1, 0.1, 2.0, False),  # time and size are fitted too: a slow change does as well
    ],
)
def test_what_a_model_must_explain(kind, quality, sigma, noise, amplitude, enough):
    """All but the noise; where far more than PV's noise is left over, as in a loop that swings, nearly all."""
    fit = replace(make_fit(), quality=quality, sigma=sigma)
    event = replace(closed_event(), kind=kind, amplitude=amplitude, error_sd=0.1, noise=noise)
    assert is_explained(fit, event) == enough


def test_an_event_cut_short_says_so():
    """The reason names what cut in; before PV had followed there is no index."""
    samples = stepped()
    found, _, _ = assessed(samples.take(slice(0, 208)))
    assert found.state == "interrupted"
    assert found.ci is None
    assert found.verdict == INCONCLUSIVE
    sp = samples.sp.copy()
    sp[260:] += 3.0
    pv, op = pi_loop(sp)
    first, _, _ = assessed(replace(samples, sp=sp, pv=pv, op=op))
    assert "the set point moved again" in first.reason


def test_integrals_check_the_fit():
    """The running integrals give gain and T0 beside the fit, for a settled event from rest."""
    found, _, _ = assessed(stepped(1500, noise=0.005))
    assert found.gain_integrals == pytest.approx(0.05, rel=0.02)
    assert found.t0_integrals == pytest.approx(4.5, rel=0.25)
