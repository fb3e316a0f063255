"""Several events in one model: of which kind, where they contradict each other, and what they know together."""

from __future__ import annotations

import pytest

from monitor.assess.event import Finding
from monitor.contract.records import INCONCLUSIVE, SETPOINT, Assessment
from monitor.identify.fit import JOINT, Fit
from monitor.verdict.joint import joint_of, narrow_together
from tests.support.fits import make_fit
from tuners.models import INTEGRATING, SELF_REGULATING

ROUGH = (0.2, 0.2, 0.2)
"""Standard deviations of a fit that knows its gain to a factor of 2.2."""


def event(fit: Fit | None, usable: bool = True) -> Finding:
    """An event of which nothing but the model matters."""
    record = Assessment(
        loop="L", id="", event=1, kind=SETPOINT, start=0, end=0, state="settled", amplitude=1.0,
        verdict=INCONCLUSIVE, reason="",
    )  # fmt: skip
    return Finding(record, fit, usable=usable, wide=not usable, is_event=True, noise=0.01, period=1.0)


def of_kind(process: str, usable: bool = True) -> Finding:
    return event(make_fit(process=process), usable)


@pytest.mark.parametrize(
    ("kinds", "expected"),
    [
        ([INTEGRATING, INTEGRATING, SELF_REGULATING], INTEGRATING),
        ([SELF_REGULATING, INTEGRATING, SELF_REGULATING, INTEGRATING, SELF_REGULATING], SELF_REGULATING),
        ([INTEGRATING, SELF_REGULATING], SELF_REGULATING),
        ([SELF_REGULATING, INTEGRATING], INTEGRATING),
    ],
)
def test_of_two_kinds_the_one_that_more_events_show(kinds, expected):
    """The newer one of as many."""
    joint, why = joint_of([of_kind(kind) for kind in kinds])
    assert joint is not None
    assert (joint.process, why) == (expected, "")


def test_a_rough_event_has_no_say_in_the_kind():
    """Two that do not know their gain are outvoted by one that does; among themselves they have a say."""
    rough = [of_kind(INTEGRATING, usable=False)] * 2
    joint, _ = joint_of([of_kind(SELF_REGULATING), *rough])
    alone, _ = joint_of([of_kind(SELF_REGULATING, usable=False), *rough])
    assert joint is not None
    assert alone is not None
    assert (joint.process, alone.process) == (SELF_REGULATING, INTEGRATING)


def test_another_kind_does_not_move_the_model():
    """Its gain has another unit: however far off, it is no part of the mean, and contradicts nothing."""
    same = [event(make_fit(gain=gain)) for gain in (0.05, 0.052)]
    joint, why = joint_of([event(make_fit(gain=2.0, process=SELF_REGULATING)), *same])
    assert joint is not None
    assert joint.method == JOINT
    assert 0.05 < joint.gain < 0.052
    assert why == ""


def test_gains_of_both_signs_have_nothing_in_common():
    """Whatever kinds they are of: the loop can be made unstable by either."""
    for process in (INTEGRATING, SELF_REGULATING):
        joint, why = joint_of([event(make_fit()), event(make_fit(gain=-0.05, process=process))])
        assert joint is None
        assert "sign of the gain" in why


@pytest.mark.parametrize(("gain", "contradict"), [(0.055, False), (0.1, True)])
def test_gains_beyond_chance(gain, contradict):
    """Said beside the model, which is not to be used."""
    joint, why = joint_of([event(make_fit()), event(make_fit(gain=gain))])
    assert joint is not None
    assert ("beyond chance" in why) == contradict
    assert bool(why) == contradict


def test_an_event_without_a_model_says_nothing():
    fit = make_fit()
    assert joint_of([event(None), event(fit)]) == (fit, "")


def test_rough_events_know_the_gain_together():
    """Each to a factor of 2.2, two of them to one of 1.75; not where they contradict each other, or differ in kind."""
    rough = event(make_fit(sd=ROUGH), usable=False)
    other_kind = event(make_fit(sd=ROUGH, process=SELF_REGULATING), usable=False)
    other_sign = event(make_fit(gain=-0.05, sd=ROUGH), usable=False)
    far = event(make_fit(gain=0.5, sd=ROUGH), usable=False)
    assert narrow_together([rough, rough])
    assert not narrow_together([])
    assert not narrow_together([rough])
    assert not narrow_together([rough, other_kind])
    assert not narrow_together([rough, rough, other_sign])
    assert not narrow_together([rough, rough, far])
