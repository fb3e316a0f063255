"""The way to a suggestion in stages, each of them safe."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.advise.region import uncertain_models, worst_peaks
from monitor.advise.stages import ORDERS, STAGE_RATIO, stages
from monitor.advise.suggestion import Withheld
from monitor.assess.reference import model_of, with_hold_delay
from tests.monitor.advise.tools import PERIOD, asked, given_advice, sluggish
from tests.support.fits import make_fit
from tuners.robustness import peak_sensitivity
from tuners.settings import Settings


def test_stages_take_the_safest_way():
    """A rolling integrator whose gain has to rise: with the old reset time the gain first, not both half-way."""
    fit = make_fit(lag=0.0, dead_time=2.0, sd=(0.2, 0.5, 0.5))
    region = uncertain_models(fit, 0.2)
    today, new = Settings(0.3, 10.0), Settings(3.0, 40.0)
    way = stages(region, today, new, 2.2)
    assert len(way) == 3
    assert way[-1] == new
    worst = worst_peaks(
        region, Settings(*(np.array([float(getattr(s, n)) for s in way]) for n in ("kp", "ti")))
    )
    assert worst.max() <= worst_peaks(region, today)[0]
    assert stages(region, new, replace(new, kp=2.0), 2.2) == [replace(new, kp=2.0)]
    assert {order(1.0) for order in ORDERS} == {(1.0, 1.0)}


def test_large_changes_come_in_stages():
    """At most a factor of three in gain each, the last one the suggestion, every one safe on the model."""
    loop = sluggish(kp=0.35, ti=150.0)
    advice = given_advice(loop)
    assert advice.limited_by
    gains = [loop.kp, *(float(s.kp) for s in advice.stages)]
    assert len(advice.stages) > 1
    assert (advice.stages[0], advice.stages[-1]) == (advice.settings, advice.aim)
    for a, b in pairwise(gains):
        assert a is not None
        assert 1 / (STAGE_RATIO * 1.01) <= b / a <= STAGE_RATIO * 1.01
    for stage in advice.stages:
        assert peak_sensitivity(with_hold_delay(model_of(make_fit()), PERIOD), stage) <= max(
            loop.ms_max, advice.ms
        )


@settings(max_examples=25)
@given(product=st.floats(0.3, 1.2), share=st.floats(0.1, 0.4))
def test_every_stage_of_a_rolling_loop_is_stable(product, share):
    """With too much integral action the way matters: no stage is worse than today or the limit."""
    fit = make_fit(lag=0.0)
    kp = share * 2.5
    loop = sluggish(kp=kp, ti=product / (0.05 * kp))
    advice = asked(loop, fit)
    if isinstance(advice, Withheld):
        return
    model = with_hold_delay(model_of(fit), PERIOD)
    today = float(peak_sensitivity(model, Settings(kp, loop.ti)))
    for stage in advice.stages:
        assert float(peak_sensitivity(model, stage)) <= max(loop.ms_max, today) + 1e-9
