"""The walk to the aim: as far as is safe now, with the reason for the rest."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.advise.evidence import NO_DOUBT, Evidence
from monitor.advise.guards import LOADS_ALONE, MISFIT, NEAR_THE_EDGE, NOT_EXCITED, Guards, crossovers
from monitor.advise.path import NEARLY_THERE, is_a_step
from monitor.advise.region import nominal, uncertain_models
from monitor.advise.suggestion import Advice, Withheld, renewed
from monitor.assess.reference import settings_of
from monitor.contract.loops import Loop
from monitor.identify.misfit import NOTHING_UNSEEN, ModelError
from tests.monitor.advise.tools import PERIOD, asked, given_advice, sluggish
from tests.support.fits import make_fit
from tuners.levels import method_product
from tuners.models import SELF_REGULATING
from tuners.robustness import peak_sensitivity
from tuners.settings import Settings


def error(omega: float, bound: float) -> ModelError:
    """One mode that is seen, and nothing known of others."""
    return ModelError(np.array([omega]), np.array([bound]), np.array([100.0]), NOTHING_UNSEEN)


FAR = {"kp": 0.2, "ti": 400.0}
"""Settings of today that are far from the aim."""


def test_the_first_part_of_a_long_way():
    """Twice the gain at most, and the reason; the stages lead on to the aim."""
    advice = given_advice(sluggish(**FAR))
    model = nominal(uncertain_models(make_fit(), PERIOD))
    today, now, aim = crossovers(model, [Settings(0.2, 400.0), advice.settings, advice.aim])
    assert aim > 3.0 * today >= now > 1.5 * today
    assert 0.3 < float(advice.settings.kp) <= max(0.4, float(advice.aim.kp) / 4.0)
    assert advice.limited_by == NOT_EXCITED
    assert (advice.stages[0], advice.stages[-1]) == (advice.settings, advice.aim)
    assert len(advice.stages) > 1


def test_far_below_the_aim_more_is_borne():
    """A quarter of the aim's gain and crossover: a model that is wrong by four is still safe there; after loads too."""
    loop = sluggish(kp=0.1, ti=900.0)
    for evidence in (NO_DOUBT, Evidence(loads_only=True)):
        advice = given_advice(loop, evidence=evidence)
        ratio, whole = float(advice.settings.kp) / 0.1, float(advice.aim.kp) / 0.1
        assert 2.0 < ratio <= whole / 4.0


@pytest.mark.parametrize("evidence", [NO_DOUBT, Evidence(loads_only=True), Evidence(misfit=error(0.05, 0.6))])
@pytest.mark.parametrize("ti", [10.0, 30.0, 60.0])
def test_a_loop_that_rolls_does_not_go_on_rolling_under_a_part_of_the_way(ti, evidence):
    """Too much integral action for the gain: where the gain may not rise far at once, the integral time gets longer."""
    today = sluggish(kp=0.4, ti=ti)
    model = nominal(uncertain_models(make_fit(), PERIOD))
    before = float(np.ravel(method_product(model, settings_of(today)))[0])
    advice = given_advice(today, evidence=evidence)
    after = float(np.ravel(method_product(model, advice.settings))[0])
    assert before < 2.0 < after
    assert abs(float(advice.settings.kp)) >= 0.4


def test_a_campaign_arrives():
    """Each part typed in, the same model found again: the aim is reached, and kept on the way."""
    facts: dict[str, Any] = dict(FAR)
    advice = given_advice(sluggish(**facts))
    aim = advice.aim
    for _ in range(5):
        if advice.settings == aim:
            break
        loop = sluggish(kp=float(advice.settings.kp), ti=float(advice.settings.ti))
        again = renewed(advice, loop, make_fit(), 0.01, PERIOD, NO_DOUBT)
        assert again is not None
        assert again.aim == aim
        advice = again
    assert advice.settings == aim
    there = sluggish(kp=float(aim.kp), ti=float(aim.ti))
    assert renewed(advice, there, make_fit(), 0.01, PERIOD, NO_DOUBT) is None


def test_a_loop_that_is_near_instability_is_slowed_down_at_once():
    """Whatever the error of the model: to take gain away needs no proof."""
    for evidence in (NO_DOUBT, Evidence(misfit=error(0.05, 3.0)), Evidence(loads_only=True)):
        for facts in ({"kp": 9.0, "ti": 60.0}, {"kp": 5.5, "ti": 30.0}):
            advice = given_advice(sluggish(**facts), evidence=evidence)
            assert advice.settings == advice.aim
            assert advice.ms_worst <= 2.2


@pytest.mark.parametrize("today", [(2.0, 5.0), (3.0, 12.0), (6.0, 8.0)])
def test_a_loop_near_instability_is_calmed_before_it_gets_more_gain(today):
    """Far too short an integral time on a lag: the aim has more gain, but a longer integral time comes first."""
    fit = make_fit(1.0, 60.0, 8.0 if today[0] < 6.0 else 4.0, process=SELF_REGULATING)
    advice = given_advice(sluggish(kp=today[0], ti=today[1]), fit)
    assert float(advice.aim.kp) > today[0] >= float(advice.settings.kp)
    assert float(advice.settings.ti) > 1.2 * today[1]
    assert advice.ms_worst <= 2.2
    assert advice.limited_by == NEAR_THE_EDGE


def test_a_soft_step_is_what_an_error_leaves():
    wild = error(0.05, 3.5)
    advice = given_advice(sluggish(**FAR), evidence=Evidence(misfit=wild))
    assert 1.05 < float(advice.settings.kp) / 0.2 <= 1.25
    assert advice.limited_by == MISFIT
    none = asked(sluggish(**FAR), evidence=Evidence(misfit=wild, soft_step=False))
    assert isinstance(none, Withheld)
    assert none.reason == MISFIT


def test_after_loads_alone_no_new_derivative():
    """A PID by its declaration, run as PI: it is tuned as PI until a set point has stepped."""
    loop = sluggish(kp=0.6, controller="pid")
    free = given_advice(loop)
    assert free.settings.td > 0
    advice = given_advice(loop, evidence=Evidence(loads_only=True))
    assert advice.rule == "simc-pi"
    assert advice.settings.td == advice.aim.td == 0
    assert float(advice.settings.kp) <= 1.2
    held = renewed(free, loop, make_fit(), 0.01, PERIOD, Evidence(loads_only=True))
    assert held is not None
    assert held.aim == free.aim
    assert held.settings.td == 0
    assert held.limited_by == LOADS_ALONE


def test_without_settings_the_aim_or_something_gentler():
    """Nothing is known of today: what the error of the model allows of the way up from far gentler settings."""
    loop = Loop(name="L")
    free = given_advice(loop)
    assert free.settings == free.aim
    held = given_advice(loop, evidence=Evidence(misfit=error(0.6, 0.5)))
    assert held.aim == free.aim
    assert float(held.settings.kp) < 0.95 * float(free.aim.kp)
    assert isinstance(asked(loop, evidence=Evidence(misfit=error(0.05, 30.0))), Withheld)


def test_taking_gain_away_goes_as_far_as_the_error_asks():
    """The search's aim is gentler than today, but the error of the model asks for more than that."""
    loop, misfit = sluggish(kp=5.5, ti=30.0), error(0.5, 0.6)
    aim = given_advice(loop).aim
    advice = given_advice(loop, evidence=Evidence(misfit=misfit))
    assert float(advice.settings.kp) < 0.85 * float(aim.kp)
    assert advice.settings == advice.aim
    model = uncertain_models(make_fit(), PERIOD)
    c = advice.settings.frequency_response(0.5)
    assert abs(1 + c * nominal(model).frequency_response(0.5)[0]) - abs(c) * 0.6 >= 1 / 3


@pytest.mark.parametrize(
    ("other", "step"),
    [
        (Settings(1.04, 96.0), False),
        (Settings(1.06, 100.0), True),
        (Settings(1.0, 94.0), True),
        (Settings(1.0, math.inf), True),
        (Settings(1.0, 100.0, 1.0), True),
    ],
)
def test_less_than_five_percent_is_no_step(other, step):
    assert is_a_step(Settings(1.0, 100.0), other) == step
    assert "5 %" in NEARLY_THERE


@settings(max_examples=40)
@given(
    kp=st.floats(0.05, 8.0),
    ti=st.floats(10.0, 1000.0),
    omega=st.floats(0.02, 1.0),
    bound=st.floats(0.0, 3.0),
    loads_only=st.booleans(),
    soft_step=st.booleans(),
)
def test_what_is_typed_in_is_safe_or_safer(kp, ti, omega, bound, loads_only, soft_step):
    """Every part passes the guards (but for the soft step's error), and Ms is within the limit."""
    evidence = Evidence(misfit=error(omega, bound), loads_only=loads_only, soft_step=soft_step)
    loop = sluggish(kp=kp, ti=ti)
    advice = asked(loop, evidence=evidence)
    if isinstance(advice, Withheld):
        assert advice.reason
        return
    assert isinstance(advice, Advice)
    region = uncertain_models(make_fit(), PERIOD)
    today = settings_of(loop)
    assert today is not None
    worst = float(np.max(peak_sensitivity(region, advice.settings)))
    assert worst <= 2.2
    guards = replace(Guards.of(loop, region, evidence, PERIOD), aim=advice.aim)
    (why,) = guards.refused([advice.settings])
    assert not why or (why == MISFIT and soft_step and guards.soft([advice.settings]) == [True])
    assert bool(advice.limited_by) == (advice.settings != advice.aim)
