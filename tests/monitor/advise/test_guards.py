"""What keeps settings back: each guard by the loop that it is for, and what it must let pass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.advise.evidence import NO_DOUBT, Evidence
from monitor.advise.guards import (
    CROSSOVER_RATIO,
    EXCITED_RATIO,
    FAR_SLOWER,
    GAIN_RATIO,
    LOADS_ALONE,
    MISFIT,
    NEAR_THE_EDGE,
    NOT_EXCITED,
    OTHER_KIND,
    SOFT_RATIO,
    Guards,
    crossovers,
)
from monitor.advise.region import uncertain_models
from monitor.identify.misfit import NOTHING_UNSEEN, OPEN_SD, ModelError, OpenModes
from tests.monitor.advise.tools import PERIOD, sluggish
from tests.support.fits import make_fit
from tuners.models import SELF_REGULATING, IntegratingModel
from tuners.settings import Settings


def guards(evidence: Evidence = NO_DOUBT, **facts: object) -> Guards:
    return Guards.of(sluggish(**facts), uncertain_models(make_fit(), PERIOD), evidence, PERIOD)


def left_open(omega: list[float], bound: float) -> ModelError:
    """Nothing is seen, and so much may be there."""
    every = np.full((5, len(omega)), 0.1)
    every[0], every[2:4], every[4] = omega, 0.0, bound / OPEN_SD
    return ModelError(*np.zeros((3, 0)), OpenModes(*every))


def error(omega: float, bound: float) -> ModelError:
    """One mode that is seen, and nothing known of others."""
    return ModelError(np.array([omega]), np.array([bound]), np.array([100.0]), NOTHING_UNSEEN)


@settings(max_examples=40)
@given(
    kp=st.floats(0.05, 4.0), ti=st.one_of(st.just(math.inf), st.floats(5.0, 500.0)), lag=st.floats(0.0, 20.0)
)
def test_the_crossover_is_where_the_loop_gain_is_one(kp, ti, lag):
    model = IntegratingModel(np.array([0.05]), np.array([4.0]), np.array([lag]))
    (found,) = crossovers(model, [Settings(kp, ti)])
    gain = np.abs(model.frequency_response(found) * Settings(kp, ti).frequency_response(found))
    assert float(gain[0]) == pytest.approx(1.0, rel=5e-3)


def test_a_gain_below_one_has_no_crossover():
    assert (
        crossovers(uncertain_models(make_fit(0.5, process=SELF_REGULATING), 0.0), [Settings(1.0)])[0] == 0.0
    )


def test_what_was_not_excited_is_not_known():
    """Twice the gain, three times the crossover; to take gain away is always allowed, of an unstable loop too."""
    held = guards(ti=1000.0)
    assert held.refused([Settings(0.6 * GAIN_RATIO * 1.05, 1000.0)]) == [NOT_EXCITED]
    assert held.refused([Settings(0.6 * GAIN_RATIO * 0.95, 1000.0), Settings(0.25, 300.0)]) == ["", ""]
    slow = guards(kp=0.3, ti=5000.0)
    quick = Settings(0.55, 12.0)
    today, now = crossovers(slow.model, [Settings(0.3, 5000.0), quick])
    assert now > CROSSOVER_RATIO * today
    assert slow.refused([quick]) == [NOT_EXCITED]
    wild = guards(kp=30.0, ti=10.0)
    assert wild.refused([Settings(1.0, 60.0), Settings(20.0, 30.0)]) == ["", ""]


def test_most_of_the_gain_is_not_taken_at_once_where_nothing_is_urgent():
    assert guards().refused([Settings(0.1, 300.0), Settings(0.25, 300.0)]) == [FAR_SLOWER, ""]
    assert guards(kp=6.0).refused([Settings(0.6, 300.0)]) == [""]


def test_after_loads_alone_less_is_asked_for():
    held = guards(Evidence(loads_only=True), kp=0.2)
    lead = Settings(0.2, 200.0, 2.0, 0.2)
    assert held.refused([Settings(0.45, 300.0), lead, Settings(0.3, 200.0)])[1:] == [LOADS_ALONE, ""]
    assert held.refused([Settings(0.2, 45.0), Settings(0.2, 55.0)]) == [LOADS_ALONE, ""]
    assert held.lead_withheld
    assert not guards(Evidence(loads_only=True), td=1.0).lead_withheld
    assert not guards().lead_withheld


def test_no_gain_is_added_near_instability():
    """Unless it is gain that is wanting: an integrating loop with too much integral action."""
    assert guards(kp=4.5, ti=100.0).refused([Settings(4.7, 200.0), Settings(4.0, 200.0)]) == [
        NEAR_THE_EDGE,
        "",
    ]
    assert guards(kp=0.3, ti=8.0).refused([Settings(0.4, 30.0)]) == [""]


def test_the_other_kind_of_process_counts():
    """Settings that are wild on a model that the events allow are refused, unless today's are wilder."""
    rival = make_fit(2.0, 20.0, 9.0, process=SELF_REGULATING)
    held = guards(Evidence(rivals=(rival,)))
    assert held.refused([Settings(1.1, 30.0)]) == [OTHER_KIND]
    assert held.refused([Settings(0.65, 100.0)]) == [""]


def test_an_error_of_the_model_bounds_the_gain():
    """A resonance above the crossover: as much gain as leaves abs(1 + L) - abs(C) U above a third."""
    held = guards(Evidence(misfit=error(0.5, 0.6)))
    many = [Settings(kp, 200.0) for kp in (0.7, 0.9, 1.1)]
    omega = 0.5
    for one, why in zip(many, held.refused(many), strict=True):
        c = one.frequency_response(omega)
        room = abs(1 + c * held.model.frequency_response(omega)[0]) - abs(c) * 0.6
        assert (why == MISFIT) == (room < 1 / 3)
    assert {MISFIT, ""} == set(held.refused(many))


def test_where_the_error_is_as_large_as_the_model_nothing_is_built_on_it():
    """A load that came with the set point leaves a model of which little is right: no more gain, whatever the room."""
    model = guards().model
    size = float(abs(model.frequency_response(0.05)[0]))
    more, less = Settings(0.75, 200.0), Settings(0.5, 250.0)
    assert guards(Evidence(misfit=error(0.05, 0.5 * size))).refused([more, less]) == ["", ""]
    assert guards(Evidence(misfit=error(0.05, 1.2 * size))).refused([more, less]) == [MISFIT, ""]


def test_what_is_gentler_than_today_is_allowed_whatever_the_error():
    held = guards(Evidence(misfit=error(0.1, 5.0)))
    assert held.refused([Settings(0.5, 250.0), Settings(0.7, 200.0)]) == ["", MISFIT]
    assert list(held.endangered([Settings(0.5, 250.0), Settings(0.05, 250.0)])) == [True, False]


def test_where_a_step_excited_more_may_be_reached():
    """Up to four times the gain, where an error of the model would have been seen; not after loads alone."""
    aim = Settings(0.6 * GAIN_RATIO * 1.3, 200.0)
    for bound, loads_only, why in ((0.01, False, ""), (5.0, False, NOT_EXCITED), (0.01, True, NOT_EXCITED)):
        shown = left_open([0.1, 0.3], bound)
        assert guards(Evidence(misfit=shown, loads_only=loads_only)).refused([aim]) == [why]
    nothing = left_open([0.1], 0.01)
    far = Settings(0.6 * EXCITED_RATIO * 1.1, 200.0)
    assert guards(Evidence(misfit=nothing)).refused([far]) == [NOT_EXCITED]


def test_far_below_its_aim_a_loop_is_not_raised_into_what_looks_like_a_resonance():
    """Far below its aim a model may be wrong by a factor: what might be there counts no more, what looks so does."""
    aim, more = Settings(6.0, 30.0), Settings(0.06 * GAIN_RATIO * 1.3, 200.0)
    for size, sd, why in ((5.0, 4.0, ""), (5.0, 1.0, NOT_EXCITED), (0.05, 0.01, "")):
        unseen = OpenModes(*(np.array([x]) for x in (0.3, 0.05, size, 0.0, sd)))
        held = guards(Evidence(misfit=ModelError(*np.zeros((3, 0)), unseen)), kp=0.06)
        assert replace(held, aim=aim).refused([more]) == [why]


def test_the_mode_that_explains_most_decides_about_a_soft_step():
    wild = error(0.1, 50.0)
    assert guards(Evidence(misfit=wild)).soft([Settings(0.6 * 1.2, 200.0)]) == [False]


def test_a_soft_step_is_small():
    misfit = error(0.1, 1.0)
    small, large = Settings(0.6 * 1.2, 200.0), Settings(0.6 * 1.3, 200.0)
    lead = Settings(0.6, 200.0, 1.0, 0.1)
    assert guards(Evidence(misfit=misfit)).soft([small, large, lead]) == [True, False, False]
    assert guards(Evidence(misfit=misfit, soft_step=False)).soft([small]) == [False]
    assert pytest.approx(1.25) == SOFT_RATIO
