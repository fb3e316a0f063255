"""What settings are predicted to make of unit steps, and how much of it counts."""

from __future__ import annotations

import math

import pytest

from monitor.advise.prediction import Predicted, predict, references_of
from monitor.assess.reference import model_of, settings_of
from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from tests.support.fits import make_fit
from tuners.responses import closed_loop_response
from tuners.settings import Settings

TODAY = Settings(1.0, 60.0)
NEW = [Settings(2.0, 40.0), Settings(3.0, 30.0)]


def test_each_of_the_settings_and_today_s():
    """As simulated one by one; none of today's where these are not known."""
    model = model_of(make_fit())
    each, before = predict(model, NEW, TODAY)
    assert before is not None
    for settings, found in zip([*NEW, TODAY], [*each, before], strict=True):
        assert found.iae[SETPOINT] == pytest.approx(closed_loop_response(model, settings).iae, rel=0.02)
    assert predict(model, NEW, None)[1] is None


def test_an_unstable_loop_has_no_overshoot():
    (found,), _ = predict(model_of(make_fit()), [Settings(200.0, 10.0)], None)
    assert found.overshoot is None
    assert all(math.isinf(error) for error in found.iae.values())


@pytest.mark.parametrize(
    ("objective", "kinds"), [("both", [SETPOINT, LOAD]), ("setpoint", [SETPOINT]), ("load", [LOAD])]
)
def test_the_objective_says_which_steps_count(objective, kinds):
    """The index is the least of those; an error of twice the reference's counts twice."""
    loop = Loop(name="L", kp=1.0, ti=60.0, objective=objective)
    references = references_of(loop, make_fit(), "pi", 4.0)
    assert list(references.of) == kinds
    twice = Predicted(0.0, {kind: 2.0 * references.of[kind].iae for kind in kinds})
    assert references.index(twice) == pytest.approx(0.5)
    assert references.error(twice) == pytest.approx(2.0 * len(kinds))


def test_better_than_the_reference_is_worth_nothing():
    """Below the reference, but for its uncertainty, the error is the same however small."""
    references = references_of(Loop(name="L", kp=1.0, ti=60.0), make_fit(), "pi", 4.0)
    half, tenth = (Predicted(0.0, {k: s * best.iae for k, best in references.of.items()}) for s in (0.5, 0.1))
    assert references.error(half) == references.error(tenth)


def test_fifteen_percent_are_asked_for():
    """Of one kind of step at least, and not at the other's cost."""
    loop = Loop(name="L", kp=1.0, ti=60.0)
    assert settings_of(loop) == TODAY
    references = references_of(loop, make_fit(), "pi", 4.0)
    iae = {kind: 3.0 * best.iae for kind, best in references.of.items()}
    before = Predicted(0.0, iae)
    assert not references.worthwhile(loop, before, Predicted(0.0, {k: 0.9 * v for k, v in iae.items()}))
    assert references.worthwhile(loop, before, Predicted(0.0, {k: 0.8 * v for k, v in iae.items()}))
    costly = {SETPOINT: 0.8 * iae[SETPOINT], LOAD: 2.0 * iae[LOAD]}
    assert not references.worthwhile(loop, before, Predicted(0.0, costly))
