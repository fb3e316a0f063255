"""What may be suggested: rules by name, noise on OP, structures."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.advise.candidates import op_noise, rule_mismatch
from monitor.advise.evidence import NO_DOUBT
from monitor.advise.suggestion import Advice, Withheld, advise
from monitor.assess.reference import model_of
from monitor.contract.records import LOAD
from tests.monitor.advise.tools import PERIOD, asked, given_advice, product, sluggish
from tests.support.fits import make_fit
from tests.support.twins import noise_through
from tuners.models import SELF_REGULATING
from tuners.rules import RULES
from tuners.settings import Settings


@pytest.mark.parametrize(("td", "tf"), [(0.0, 0.0), (5.0, 0.5), (5.0, 0.05), (2.0, 2.0)])
@pytest.mark.parametrize("period", [0.2, 1.0])
def test_op_noise_is_that_of_a_simulated_controller(td, tf, period):
    """The formula against white noise through the sampled controller, within 3 %."""
    noise = np.random.default_rng(0).normal(0, 0.3, 40_000)
    simulated = noise_through(-2.0, td, tf, period, noise)
    formula = op_noise(Settings(-2.0, 50.0, td, tf), 0.3, period)
    assert formula == pytest.approx(simulated, rel=0.03)


def test_op_noise_limits_a_suggestion():
    """Where the span of OP is known, PV's noise may put only so much on it; else it is reported."""
    loop = sluggish(td=2.0, op_low=0.0, op_high=100.0)
    free = given_advice(msgspec.structs.replace(loop, op_high=None), noise=0.5)
    assert free.op_noise > 1.0
    held_back = given_advice(loop, noise=0.2)
    assert held_back.op_noise <= 1.0
    none = asked(loop, noise=50.0)
    assert isinstance(none, Withheld)
    assert "noise" in none.reason


def test_noise_takes_from_the_derivative_first():
    """Where noise on OP limits a PID, a shorter td buys gain; the ratio td/tf and the structure stay."""
    loop = sluggish(kp=0.4, td=6.0, op_low=0.0, op_high=100.0)
    fit = make_fit(lag=12.0)
    quiet, loud = given_advice(loop, fit, noise=0.0), given_advice(loop, fit, noise=0.15)
    assert loud.op_noise <= 1.0
    assert 0 < float(loud.aim.td) < 0.6 * float(quiet.aim.td)
    assert float(loud.aim.td) == pytest.approx(10 * float(loud.aim.tf))
    assert loud.before is not None
    assert loud.after.iae[LOAD] < 0.8 * loud.before.iae[LOAD]
    assert loud.ms_worst <= 2.2


@settings(max_examples=40)
@given(
    sd=st.tuples(st.floats(0.005, 0.4), st.floats(0.01, 3.0), st.floats(0.01, 3.0)),
    lag=st.floats(0.0, 20.0),
    td=st.sampled_from([0.0, 3.0]),
    objective=st.sampled_from(["both", "load", "setpoint"]),
    form=st.sampled_from(["standard", "series", "parallel"]),
)
def test_an_integrator_never_gets_too_much_integral_action(sd, lag, td, objective, form):
    """Kc K Ti of the suggestion stays well above 2, where a loop begins to roll."""
    loop = sluggish(kp=0.3, td=td, objective=objective, form=form)
    advice = asked(loop, make_fit(lag=lag, sd=sd))
    if isinstance(advice, Advice):
        assert product(advice) > 2.35


RULED = [
    ("imc-pi", {}, "imc-pi"),
    ("tyreus-luyben", {}, "tyreus-luyben"),
    ("amigo", {"td": 2.0}, "amigo"),
    ("chakraborty", {"td": 2.0, "b": 0.0, "c": 0.0}, "chakraborty"),
    ("amigo", {}, "simc-pi"),  # PI stays PI
    ("imc-pi", {"td": 2.0}, "simc-pid"),
    ("chakraborty", {"td": 2.0}, "simc-pid"),  # an I-PD rule is for an I-PD
    ("cohen-coon-pi", {}, "simc-pi"),  # not for integrating processes
    ("averaging", {}, "simc-pi"),  # what an objective asks for is no rule for every loop
]


@pytest.mark.parametrize(("rule", "facts", "used"), RULED)
def test_a_rule_by_name(rule, facts, used):
    """Any rule that serves the loop's structure and process; the reference rule for other loops."""
    advice = advise(sluggish(ms_max=3.0, rule=rule, **facts), make_fit(), 0.0, PERIOD, None, NO_DOUBT)
    assert isinstance(advice, Advice), advice
    assert advice.rule == used
    assert advice.ms_worst <= 3.0
    assert (float(advice.aim.td) > 0) == bool(facts.get("td"))
    made = RULES[rule]
    if used == rule and "closed_loop_time" not in made.parameters:
        exact = made.function(model_of(make_fit())).to("standard")
        assert float(advice.aim.kp) == pytest.approx(float(exact.kp), rel=0.006)
        assert math.isnan(advice.closed_loop_time)


@pytest.mark.parametrize(
    ("rule", "facts", "process", "why"),
    [
        ("", {}, "integrating", ""),
        ("imc-pi", {}, "integrating", ""),
        ("imc-pi", {}, "auto", ""),
        ("imc-pi", {}, SELF_REGULATING, "for integrating processes, this one is self-regulating"),
        ("imc-pi", {"td": 2.0}, "auto", "for PI, this loop is a PID"),
        ("imc-pi", {"controller": "p"}, "auto", "for PI, this loop is a P"),
        ("amigo", {"kp": None}, "auto", "for PID, a loop without settings is taken for a PI"),
        ("chakraborty", {"td": 2.0}, "auto", "for I-PD, this loop is a PID"),
        ("chakraborty", {"td": 2.0, "b": 0.0, "c": 0.0}, "integrating", ""),
        ("averaging", {}, "auto", "for loops whose objective is averaging"),
        ("averaging", {"objective": "averaging"}, "auto", ""),
        ("imc-pi", {"objective": "averaging"}, "auto", "averaging has a rule of its own"),
    ],
)
def test_why_a_rule_by_name_is_not_used(rule, facts, process, why):
    """By structure, kind of process and objective, in plain words; nothing is said where it is used."""
    said = rule_mismatch(sluggish(rule=rule, **facts), process)
    assert why in said
    assert bool(why) == bool(said)


@pytest.mark.parametrize("name", [name for name, rule in RULES.items() if rule.default_time])
def test_a_rule_by_name_starts_at_its_own_closed_loop_time(name):
    """Its source's settings, where they are safe; the loop table's closed-loop time, where it has one."""
    rule = RULES[name]
    process = rule.processes[0]
    td = 2.0 if rule.structure == "PID" else 0.0
    fit = make_fit(process=process, sd=(0.005, 0.01, 0.01), dead_time=6.0, lag=12.0)
    printed = rule.function(model_of(fit)).to("standard")
    loop = sluggish(ms_max=4.0, kp=0.4 * float(printed.kp), rule=name, td=td)
    own = given_advice(loop, fit)
    assert own.closed_loop_time == pytest.approx(float(rule.default_time(model_of(fit))))
    assert float(own.aim.kp) == pytest.approx(float(printed.kp), rel=0.006)
    assert float(own.aim.td) == pytest.approx(float(printed.td), rel=0.006)
    asked_for = msgspec.structs.replace(loop, closed_loop_time=40.0)
    assert given_advice(asked_for, fit).closed_loop_time >= 40.0


def test_a_rule_by_name_is_not_exempt():
    """Ziegler-Nichols breaks the limit, and without a closed-loop time it cannot be slowed down."""
    none = advise(sluggish(kp=0.3, rule="ziegler-nichols-pi"), make_fit(), 0.0, PERIOD, None, NO_DOUBT)
    assert isinstance(none, Withheld)
    assert "Ms" in none.reason
    tight = sluggish(kp=0.3, closed_loop_time=0.5, rule="imc-pi")
    slowed = advise(tight, make_fit(), 0.0, PERIOD, None, NO_DOUBT)
    assert isinstance(slowed, Advice)
    assert slowed.closed_loop_time > 1.0


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_is_safe_or_withheld(rule):
    """Whatever is named, for every structure and kind of process: no exception, no broken limit, no new structure."""
    for process in ("integrating", SELF_REGULATING):
        fit = make_fit(lag=8.0, dead_time=3.0, process=process)
        for facts in ({}, {"td": 2.0}, {"ti": math.inf}, {"td": 2.0, "b": 0.0, "c": 0.0}):
            loop = sluggish(kp=0.5, form="series", rule=rule, **facts)
            advice = advise(loop, fit, 0.01, PERIOD, None, NO_DOUBT)
            if isinstance(advice, Withheld):
                assert advice.reason
            else:
                assert advice.ms_worst <= 2.2
                assert math.isfinite(float(advice.aim.ti)) == math.isfinite(loop.ti)
                assert not (float(advice.aim.td) > 0 and not facts.get("td"))
