"""Suggestions: safe for every model that the evidence allows, in the loop's own form, or withheld with a reason."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.advise.candidates import FURTHEST_RATIO
from monitor.advise.evidence import NO_DOUBT
from monitor.advise.region import uncertain_models
from monitor.advise.suggestion import Advice, Withheld, advise, renewed
from monitor.assess.reference import (
    model_of,
    reference_structure,
    settings_of,
    with_hold_delay,
)
from monitor.contract.loops import CONTROLLERS, OBJECTIVES, Loop
from monitor.contract.records import LOAD, SETPOINT
from monitor.identify.fit import Fit
from tests.monitor.advise.tools import PERIOD, asked, given_advice, product, sluggish
from tests.support.fits import make_fit
from tuners.models import SELF_REGULATING, IntegratingModel
from tuners.robustness import peak_sensitivity


@settings(max_examples=60)
@given(
    gain=st.floats(1e-3, 1.0),
    sign=st.sampled_from([-1.0, 1.0]),
    dead_time=st.floats(0.5, 30.0),
    ratio=st.one_of(st.just(0.0), st.floats(1e-3, 4.0)),
    sd=st.floats(0.005, 0.15),
    td=st.sampled_from([0.0, 1.0]),
    form=st.sampled_from(["standard", "series", "parallel"]),
    ms_max=st.floats(1.6, 3.0),
    seed=st.integers(0, 99),
)
def test_a_suggestion_is_safe_for_the_whole_interval(
    gain, sign, dead_time, ratio, sd, td, form, ms_max, seed
):
    """Ms stays at or below ms_max on models drawn from inside the 95 % region, not only on its corners."""
    fit = make_fit(
        gain=sign * gain,
        lag=ratio * dead_time,
        dead_time=dead_time,
        sd=(sd, 2 * sd * dead_time, 2 * sd * dead_time),
    )
    kp = sign * 0.3 / (gain * 2 * (1 + ratio / 2) * dead_time)
    loop = sluggish(kp=kp, ti=30 * dead_time, td=td * ratio * dead_time, form=form, ms_max=ms_max)
    advice = asked(loop, fit, noise=0.0)
    if isinstance(advice, Withheld):
        assert advice.reason
        return
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(300, 3))
    points *= np.sqrt(7.815) * rng.random((300, 1)) ** (1 / 3) / np.linalg.norm(points, axis=1)[:, None]
    slope = 2 * np.sqrt(fit.lag**2 + fit.cov[1, 1] / 2)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, slope, 0.0], [0.0, 1.0, 1.0]])
    points = points @ np.linalg.cholesky(turn @ fit.cov @ turn.T).T
    points = points[fit.lag**2 + points[:, 1] >= 0]
    lags = np.sqrt(fit.lag**2 + points[:, 1])
    dead_times = fit.lag + fit.dead_time + points[:, 2] - lags
    points, lags, dead_times = points[dead_times >= 0], lags[dead_times >= 0], dead_times[dead_times >= 0]
    models = IntegratingModel(fit.gain * np.exp(points[:, 0]), dead_times + PERIOD / 2, lags)
    many = np.maximum(*(np.asarray(peak_sensitivity(models, s)) for s in (advice.settings, advice.aim)))
    assert advice.ms_worst <= ms_max
    assert advice.ms <= ms_max + 1e-9
    # the surface is searched on its corners: what bulges between them is small
    assert many.max() <= 1.05 * ms_max
    assert float(advice.aim.kp) * gain * sign > 0
    assert advice.aim.form == form


@pytest.mark.parametrize("form", ["standard", "series", "parallel"])
@pytest.mark.parametrize(
    ("today", "structure"),
    [
        ({"kp": 0.3, "ti": 300.0}, "pi"),
        ({"kp": 0.3, "ti": 300.0, "td": 2.0}, "pid"),
        ({"kp": 0.3, "td": 2.0}, "pd"),
        ({"kp": 0.3}, "p"),
    ],
)
def test_structure_and_form_are_kept(today, structure, form):
    """PI stays PI, PID stays PID, P and PD stay without integral action, in the loop's own form."""
    new = given_advice(Loop(name="L", form=form, **today)).aim
    assert new.form == form
    assert math.isfinite(float(new.ti)) == (structure in {"pi", "pid"})
    assert (float(new.td) > 0) == (structure in {"pid", "pd"})


def test_the_same_controller_in_every_form():
    """Standard, series and parallel suggestions for one loop are one controller, but for their rounding."""
    omega = np.geomspace(1e-3, 1.0, 50)
    responses = [
        given_advice(sluggish(td=2.0, form=form), noise=0.0).aim.frequency_response(omega)
        for form in ("standard", "series", "parallel")
    ]
    for other in responses[1:]:
        np.testing.assert_allclose(np.abs(other / responses[0]), 1.0, atol=0.12)


def test_direct_acting_loops_keep_their_sign():
    """A negative process gain wants a negative controller gain of the same size."""
    plus, minus = given_advice(sluggish()), given_advice(sluggish(kp=-0.6), make_fit(gain=-0.05))
    assert float(minus.aim.kp) == -float(plus.aim.kp)
    assert minus.aim.ti == plus.aim.ti


def test_the_filter_keeps_the_loops_ratio():
    """td/tf of the loop, ten where it has none."""
    assert given_advice(sluggish(td=2.0, tf=0.5)).aim.td == pytest.approx(
        4 * given_advice(sluggish(td=2.0, tf=0.5)).aim.tf
    )
    new = given_advice(sluggish(controller="pid")).aim
    assert new.td == pytest.approx(10 * new.tf)


def test_set_point_weights_are_kept():
    """An I-PD stays an I-PD."""
    new = given_advice(sluggish(b=0.0, c=0.0)).aim
    assert (new.b, new.c) == (0.0, 0.0)


def test_numbers_are_what_one_types():
    """Three significant digits, and the robustness stated is that of what is typed."""
    advice = given_advice(sluggish(td=2.0))
    for name in ("kp", "ti", "td"):
        for typed in (advice.settings, advice.aim):
            value = float(getattr(typed, name))
            assert value == float(f"{value:.3g}")
    again = peak_sensitivity(with_hold_delay(model_of(make_fit()), PERIOD), advice.settings)
    assert advice.ms == pytest.approx(float(again), rel=1e-9)


def test_wide_intervals_make_slower_suggestions():
    """The less is known, the gentler the settings; in the end none, with the reason."""
    gains = [float(given_advice(sluggish(), make_fit(sd=(s, 1.0, 1.0))).aim.kp) for s in (0.01, 0.1, 0.25)]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 1.2 * gains[-1]
    none = asked(sluggish(), make_fit(sd=(3.0, 1.0, 1.0)))
    assert isinstance(none, Withheld)
    assert "Ms" in none.reason or "gain" in none.reason


def test_a_lower_ms_max_makes_slower_suggestions():
    """ms_max is honoured for the worst model."""
    one, two = (given_advice(sluggish(kp=1.0, ms_max=m)) for m in (1.5, 2.5))
    assert one.ms_worst <= 1.5 < two.ms_worst <= 2.5
    assert abs(float(one.aim.kp)) < abs(float(two.aim.kp))


def test_a_closed_loop_time_of_the_table_is_the_least():
    """A loop that is meant to be slow gets slow settings."""
    assert given_advice(sluggish(kp=0.05, closed_loop_time=60.0)).closed_loop_time == pytest.approx(60.0)


def test_nothing_to_be_gained_is_said():
    """A loop under its own reference is as tight as the evidence allows: no suggestion, and no reproach."""
    first = given_advice(sluggish())
    again = asked(sluggish(kp=float(first.aim.kp), ti=float(first.aim.ti)))
    assert isinstance(again, Withheld)
    assert again.fine_as_it_is


def test_a_change_of_more_than_ten_times_is_withheld():
    """The evidence was seen with today's settings; what is far from them is not known."""
    none = asked(
        sluggish(kp=0.005, ti=2000.0), make_fit(gain=0.05, dead_time=1.0, lag=0.0, sd=(0.01, 0.05, 0.05))
    )
    assert isinstance(none, Withheld)
    assert f"{FURTHEST_RATIO:g} times" in none.reason


def test_without_settings_a_pi_is_suggested_in_one_step():
    """Nothing is known of today: structure PI, no stages."""
    advice = given_advice(Loop(name="L"))
    assert advice.rule == "simc-pi"
    assert advice.stages == [advice.aim]


def test_a_self_regulating_process():
    """The first-order rule: integral time at most the lag, safe, faster than today."""
    fit = make_fit(gain=2.0, lag=20.0, dead_time=4.0, process=SELF_REGULATING, sd=(0.02, 0.5, 0.3))
    advice = given_advice(Loop(name="L", kp=0.3, ti=60.0), fit)
    assert advice.ms_worst <= 2.2
    assert float(advice.aim.ti) <= 20.3


def test_dead_time_alone_is_withheld():
    """A process without a lag has no settings by the rule: said, not raised."""
    fit = make_fit(gain=2.0, lag=0.0, dead_time=4.0, process=SELF_REGULATING)
    none = asked(Loop(name="L", kp=0.1, ti=5.0), fit)
    assert isinstance(none, Withheld)
    assert "lag" in none.reason


def test_an_unstable_loop_today_gets_a_way_out():
    """Ms infinite today: a suggestion all the same, and its last stage is safe."""
    advice = given_advice(sluggish(kp=9.0, ti=10.0))
    assert advice.ms_worst <= 2.2
    assert advice.before is not None
    assert advice.before.overshoot is None
    assert advice.before.iae == {SETPOINT: math.inf, LOAD: math.inf}
    assert advice.after.overshoot is not None
    assert float(advice.aim.kp) < 9.0


def wide(**facts: Any) -> Fit:
    """A fit whose gain and times are so uncertain that the reference has to be slowed down."""
    return make_fit(**({"lag": 0.0, "sd": (0.15, 0.5, 1.5)} | facts))


def test_a_slow_suggestion_keeps_its_integral_action_for_the_load():
    """Where tc has to be raised, Ti is held back less for a load, not below Kc K Ti = 2.4; not for a set point."""
    setpoint, load, both = (
        given_advice(sluggish(kp=0.8, ti=120.0, objective=objective), wide())
        for objective in ("setpoint", "load", "both")
    )
    assert product(setpoint) == pytest.approx(4.0, rel=0.02)
    assert 2.35 < product(load) < 3.9
    assert load.after.iae[LOAD] < 0.9 * setpoint.after.iae[LOAD]
    assert setpoint.after.iae[SETPOINT] <= load.after.iae[SETPOINT]
    errors = [
        sum(advice.after.iae[k] / error for k, error in setpoint.after.iae.items())
        for advice in (both, setpoint)
    ]
    assert errors[0] <= errors[1] + 1e-9
    assert both.after.overshoot is not None
    assert both.after.overshoot < 0.5


def test_a_sharp_model_gets_the_rule_itself():
    """Where the reference is safe it is the suggestion: tc and Kc K Ti as the rule says."""
    fit = make_fit(lag=0.0, dead_time=4.0, sd=(0.001, 0.01, 0.01))
    advice = given_advice(sluggish(kp=1.4, ti=100.0), replace(fit, floor=np.zeros(3)))
    assert advice.closed_loop_time == pytest.approx(4.0)
    assert product(advice) == pytest.approx(4.0, rel=0.01)
    assert advice.ci == pytest.approx(1.0, abs=0.06)


def test_a_gain_of_the_other_sign_is_not_turned_round():
    """Today's settings could not run that process: the table or the model is wrong."""
    none = advise(sluggish(kp=-0.6), make_fit(), 0.0, PERIOD, None, NO_DOUBT)
    assert isinstance(none, Withheld)
    assert "sign" in none.reason


def test_an_averaging_level_keeps_its_structure():
    """Gain by load and room; damping 1 where there is integral action, and none added where there is not."""
    facts = {"kp": 0.7, "objective": "averaging", "max_load": 5.0, "max_deviation": 5.0}
    with_integral = given_advice(Loop(name="L", ti=250.0, **facts))
    assert float(with_integral.settings.kp) == 1.0
    assert product(with_integral) == pytest.approx(4.0, rel=0.01)
    assert math.isinf(float(given_advice(Loop(name="L", **facts)).aim.ti))
    far = asked(Loop(name="L", ti=400.0, **(facts | {"max_load": 100.0})))
    assert isinstance(far, Withheld)
    assert "10 times" in far.reason


def test_a_proportional_loop_is_left_alone_where_nothing_is_gained():
    """An offset that no gain takes away is no error that shrinks."""
    first = given_advice(Loop(name="L", kp=0.4))
    again = asked(Loop(name="L", kp=float(first.aim.kp)))
    assert isinstance(again, Withheld)
    assert again.fine_as_it_is


@settings(max_examples=150)
@given(
    process=st.sampled_from(["integrating", SELF_REGULATING]),
    gain=st.floats(1e-6, 1e6),
    times=st.tuples(*[st.one_of(st.just(0.0), st.floats(1e-3, 1e3))] * 3),
    sd=st.tuples(*[st.one_of(st.just(0.0), st.floats(1e-6, 3.0))] * 3),
    turned=st.floats(-1.0, 1.0),
    kp=st.one_of(st.none(), st.floats(1e-3, 1e3)),
    ti=st.one_of(st.just(math.inf), st.floats(0.01, 1e4)),
    td=st.one_of(st.just(0.0), st.floats(1e-3, 1e3)),
    form=st.sampled_from(["standard", "series", "parallel"]),
    objective=st.sampled_from(OBJECTIVES),
    controller=st.sampled_from(["", *CONTROLLERS]),
    weights=st.sampled_from([(1.0, 1.0), (1.0, 0.0), (0.0, 0.0), (0.5, 0.0)]),
    noise=st.sampled_from([0.0, 1e-3, 10.0]),
    ms_max=st.floats(1.05, 4.0),
    rule=st.sampled_from(["", "", "imc-pid", "imc-pi", "kaya-iste", "ziegler-nichols", "lambda-pi"]),
    seed=st.integers(0, 99),
)
def test_nothing_that_comes_in_leads_to_harm(
    process,
    gain,
    times,
    sd,
    turned,
    kp,
    ti,
    td,
    form,
    objective,
    controller,
    weights,
    noise,
    ms_max,
    rule,
    seed,
):
    """Degenerate models and covariances, all settings: never an exception, a broken limit or another structure."""
    dead_time, lag, lag2 = times
    unit = max(sum(times), 1e-3)
    spread = np.array(sd) * [1.0, unit, unit]
    scatter = np.diag(spread**2)
    scatter[1, 2] = scatter[2, 1] = turned * spread[1] * spread[2]
    fit = replace(
        make_fit(-gain, lag, dead_time, process=process, lag2=lag2 if process == SELF_REGULATING else 0.0),
        scatter=scatter, floor=np.zeros(3),
    )  # fmt: skip
    size = gain * (unit if process == "integrating" else 1.0)
    loop = Loop(
        name="L", kp=None if kp is None else -kp / size, ti=ti * unit if kp else math.inf, td=td * unit if kp else 0.0,
        form=form, objective=objective, controller=controller, b=weights[0], c=weights[1], ms_max=ms_max,
        op_low=0.0, op_high=100.0, allow_pd=bool(seed % 2), max_load=5.0 if seed % 3 else None, max_deviation=2.0,
        rule=rule,
    )  # fmt: skip
    advice = advise(loop, fit, noise, 0.1 * unit, None, NO_DOUBT)
    if isinstance(advice, Withheld):
        assert advice.reason
        return
    new, structure = advice.aim, reference_structure(loop)
    region = uncertain_models(fit, 0.1 * unit)
    exact, led_to = (float(np.max(peak_sensitivity(region, s))) for s in (advice.settings, new))
    assert advice.ms_worst == pytest.approx(exact, rel=1e-9)
    assert led_to <= ms_max
    assert exact <= ms_max
    assert float(new.kp) < 0
    assert new.form == form
    assert (advice.stages[0], advice.stages[-1]) == (advice.settings, new)
    assert math.isfinite(float(new.ti)) == (structure in {"pi", "pid"})
    assert float(new.td) == 0 or structure in {"pd", "pid"}
    if loop.kp is not None:
        assert 0.099 < float(new.kp) / loop.kp < 10.1
        with_today = [settings_of(loop), *advice.stages]
        peaks = [float(peak_sensitivity(with_hold_delay(model_of(fit), 0.1 * unit), s)) for s in with_today]
        assert len(advice.stages) == 1 or max(peaks[1:]) <= max(ms_max, peaks[0]) * 1.001


@pytest.mark.parametrize("sd", [(0.05, 1.0, 2.0), (0.1, 2.0, 4.0), (0.15, 3.0, 8.0)])
def test_a_suggestion_that_stands_is_looked_at_on_each_new_model(sd):
    """A model inside each of the old intervals can be one that the settings are not safe for: they are given up."""
    loop = Loop(name="A", kp=0.3, ti=600.0)
    old = make_fit(gain=0.02, lag=0.0, dead_time=40.0, sd=sd)
    advice = advise(loop, old, 0.05, 1.0, 5.0, NO_DOUBT)
    assert isinstance(advice, Advice)
    same = renewed(advice, loop, old, 0.05, 1.0, NO_DOUBT)
    assert same is not None
    assert (same.settings, same.aim, same.ms_worst) == (advice.settings, advice.aim, advice.ms_worst)
    assert same.ci == pytest.approx(advice.ci)
    corner = make_fit(
        gain=0.02 * math.exp(1.9 * sd[0]),
        lag=0.0,
        dead_time=40.0 + 1.9 * sd[2],
        sd=tuple(0.5 * s for s in sd),
    )
    assert renewed(advice, loop, corner, 0.05, 1.0, NO_DOUBT) is None
    surer = renewed(advice, loop, replace(old, scatter=old.scatter / 9.0), 0.05, 1.0, NO_DOUBT)
    assert surer is not None
    assert surer.ms_worst < advice.ms_worst
