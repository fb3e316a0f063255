"""How fast a loop is by the model that its events agree on."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from monitor.assess.event import Finding
from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from monitor.verdict.history import LoopHistory
from monitor.verdict.in_force import InForce
from monitor.verdict.speed import falls_short, indices, kindest
from tests.monitor.assess.tools import assessed
from tests.support.fits import make_fit
from tests.support.plants import stepped

LOOP = Loop(name="L", kp=2.0, ti=40.0, process="integrating")


@pytest.fixture(scope="module")
def finding() -> Finding:
    """A set-point step of a loop that is as it should be."""
    _, engine, _ = assessed(stepped(noise=0.02), process="integrating")
    return engine._histories[0].findings[0]


def test_one_event_s_index_is_the_loop_s(finding):
    assert finding.fit is not None
    assert indices(LOOP, finding.fit, [finding]) == (finding.record.ci, None)


def test_a_poor_model_of_one_event_does_not_make_the_loop_fast(finding):
    """The index rests on what all events say: a dead time found five times too long would excuse everything."""
    assert finding.fit is not None
    poor = replace(finding, fit=replace(finding.fit, dead_time=5.0 * finding.fit.dead_time))
    assert indices(LOOP, finding.fit, [poor]) == indices(LOOP, finding.fit, [finding])


def test_events_without_an_index_do_not_count(finding):
    assert finding.fit is not None
    without = replace(finding, record=msgspec.structs.replace(finding.record, ci=None))
    assert indices(LOOP, finding.fit, [without]) == (None, None)


@pytest.mark.parametrize(
    ("ti", "objective", "said"),
    [(32.0, "both", ""), (400.0, "both", "CI_ld"), (400.0, SETPOINT, ""), (400.0, LOAD, "CI_ld")],
)
def test_what_the_model_foresees_of_steps_that_nobody_saw(ti, objective, said):
    """SIMC's gain with ten times its integral time follows the set point well, and leaves a load for long."""
    fit = make_fit(gain=0.05, lag=0.0, dead_time=4.0)
    short = falls_short(Loop(name="L", kp=2.5, ti=ti, objective=objective), fit, 1.0)
    assert said in short
    assert bool(short) == bool(said)


def test_a_long_lag_is_no_slow_level():
    """Tuned for its lag, a loop that may be either kind of process is not called slow as an integrating one."""
    loop = Loop(name="L", kp=1.61, ti=282.0)
    lag = make_fit(process="self-regulating", gain=2.46, lag=280.0, dead_time=40.0)
    assert kindest(loop, (None, 0.38), (0.98, None), (), 5.0) == (None, 0.38)
    of_setpoint, of_load = kindest(loop, (None, 0.38), (0.98, None), (lag,), 5.0)
    assert of_setpoint is None
    assert of_load is not None
    assert of_load > 0.6


def test_nothing_is_foreseen_without_settings_or_for_a_surge_vessel():
    fit = make_fit(gain=0.05, lag=0.0, dead_time=4.0)
    assert not falls_short(Loop(name="L"), fit, 1.0)
    assert not falls_short(Loop(name="L", kp=0.1, ti=900.0, objective="averaging"), fit, 1.0)


def test_events_that_know_the_gain_together_may_carry_a_suggestion(finding):
    """Each alone knows the gain to a factor of 2.2, two of them to one of 1.75; another kind's do not count."""
    wide = replace(finding, usable=False, wide=True, fit=make_fit(sd=(0.2, 0.2, 0.2)))
    other = replace(wide, fit=replace(make_fit(sd=(0.2, 0.2, 0.2)), process="self-regulating"))
    for findings, count in (([wide], 0), ([wide, other], 0), ([wide, wide], 2)):
        history = LoopHistory(InForce(LOOP), findings=findings)
        assert len(history.usable) == count
