"""The verdict on a tuning, of index, Ms and objective alone."""

from __future__ import annotations

import math
from typing import Any

import pytest

from monitor.assess.tuning import integral_too_strong, judge
from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE
from tuners.models import IntegratingModel, SelfRegulatingModel

LEVEL = IntegratingModel(0.05, 4.0, 0.0)


def ci_pair(ci: float | None) -> Any:
    return (ci, None)


@pytest.mark.parametrize(
    ("ci", "ms", "verdict"),
    [
        (0.61, 1.7, GOOD),
        (0.59, 1.7, RETUNE),
        (1.50, 2.76, RETUNE),
        (1.50, 2.74, GOOD),
        (0.90, None, INCONCLUSIVE),
        (0.90, math.inf, RETUNE),
        (None, 1.7, INCONCLUSIVE),
        (None, 3.0, RETUNE),
    ],
)
def test_limits_of_the_verdict(ci, ms, verdict):
    """Flagged below ci_min, or above 1.25 ms_max; without an index nothing is called good."""
    found, reason = judge(Loop(name="L", kp=2.0, ti=40.0), LEVEL, ci_pair(ci), ms, 0.0)
    assert found == verdict
    assert (reason == "") == (verdict == GOOD)


@pytest.mark.parametrize(
    ("objective", "ci", "verdict"),
    [
        ("setpoint", (0.3, 0.9), RETUNE),
        ("setpoint", (0.9, 0.3), GOOD),
        ("load", (0.3, 0.9), GOOD),
        ("load", (0.9, 0.3), RETUNE),
        ("both", (0.9, 0.3), RETUNE),
        ("both", (None, 0.9), GOOD),
        ("load", (0.3, None), INCONCLUSIVE),
        ("setpoint", (None, 0.3), INCONCLUSIVE),
        ("load", (0.3, 0.3), RETUNE),
    ],
)
def test_the_objective_says_which_index_counts(objective, ci, verdict):
    """A loop that is there for loads is not judged, for good or bad, by a set-point step."""
    loop = Loop(name="L", kp=2.0, ti=40.0, objective=objective)
    found, reason = judge(loop, LEVEL, ci, 1.7, 0.0)
    assert found == verdict
    assert (reason == "") == (verdict == GOOD)
    if verdict == RETUNE:
        assert ("CI_ld" in reason) == (objective != "setpoint")


@pytest.mark.parametrize(
    ("objective", "ci", "predicted", "verdict", "words"),
    [
        (
            "both",
            (0.8, None),
            (0.8, 0.25),
            RETUNE,
            "follows well (CI_sp = 0.80) but would recover from a load slowly",
        ),
        (
            "both",
            (None, 0.8),
            (0.3, 0.8),
            RETUNE,
            "recovers well from a load (CI_ld = 0.80) but would follow",
        ),
        ("both", (0.8, None), (0.3, 0.8), GOOD, ""),
        ("both", (0.8, 0.8), (0.3, 0.3), GOOD, ""),
        ("both", (0.3, None), (0.8, 0.2), RETUNE, "slow to follow: CI_sp = 0.30"),
        ("setpoint", (0.8, None), (0.8, 0.25), GOOD, ""),
        ("load", (0.8, None), (0.8, 0.25), RETUNE, "would recover from a load slowly: CI_ld = 0.25"),
        ("load", (0.3, None), (0.3, 0.8), GOOD, "CI_ld = 0.80 predicted: none was measured"),
        (
            "both",
            (None, None),
            (0.7, 0.2),
            RETUNE,
            "would recover from a load slowly: CI_ld = 0.20 predicted",
        ),
        ("both", (None, None), (0.7, 0.8), GOOD, "CI_sp = 0.70, CI_ld = 0.80 predicted"),
    ],
)
def test_an_index_that_was_not_measured_is_predicted(objective, ci, predicted, verdict, words):
    """One kind of step seen: the other counts as the settings have it on the model; what was measured comes first."""
    loop = Loop(name="L", kp=2.0, ti=40.0, objective=objective)
    found, reason = judge(loop, LEVEL, ci, 1.7, 0.0, predicted)
    assert found == verdict
    assert reason.startswith(words)
    assert words or not reason


@pytest.mark.parametrize(("damped", "verdict"), [(True, GOOD), (None, INCONCLUSIVE), (False, INCONCLUSIVE)])
def test_good_needs_the_robustness(damped, verdict):
    """Without settings there is no Ms: a response seen to be well damped will do, and what is missing is said."""
    found, reason = judge(Loop(name="L"), LEVEL, ci_pair(0.9), None, 0.0, damped=damped)
    assert found == verdict
    assert ("its robustness is not known" in reason) == (verdict == INCONCLUSIVE)
    assert ("how it recovers from a load was not seen" in reason) == (verdict == GOOD)
    assert judge(Loop(name="L"), LEVEL, ci_pair(0.3), None, 0.0, damped=damped)[0] == RETUNE
    averaging = Loop(name="L", objective="averaging")
    assert judge(averaging, LEVEL, ci_pair(0.3), None, 0.0, damped=damped)[0] == verdict


def test_limits_are_the_loops_own():
    """ci_min and ms_max of the table count."""
    loop = Loop(name="L", kp=2.0, ti=40.0, ci_min=0.3, ms_max=1.4)
    assert judge(loop, LEVEL, ci_pair(0.31), 1.7, 0.0)[0] == GOOD
    assert judge(loop, LEVEL, ci_pair(0.31), 1.8, 0.0)[0] == RETUNE


def test_an_averaging_level_is_not_judged_by_speed():
    """A surge vessel that is slow on purpose is good; a rolling or unstable one is not."""
    loop = Loop(name="L", kp=0.02, ti=4000.0, objective="averaging")
    assert judge(loop, LEVEL, ci_pair(0.01), 1.1, 0.0)[0] == GOOD
    rolling = Loop(name="L", kp=0.02, ti=400.0, objective="averaging")
    assert judge(rolling, LEVEL, ci_pair(0.9), 1.1, 0.0)[0] == RETUNE
    assert judge(loop, LEVEL, ci_pair(0.9), 5.0, 0.0)[0] == RETUNE


@pytest.mark.parametrize(
    ("facts", "form", "caught"),
    [
        ({"kp": 0.4, "ti": 30.0}, "standard", True),
        ({"kp": 0.4, "ti": 30.0}, "parallel", True),
        ({"kp": 0.4, "ti": 105.0}, "standard", False),
        ({"kp": 0.4}, "standard", False),
        ({"kp": None}, "standard", False),
        # series: ti of the standard form is ti + td
        ({"kp": 0.4, "ti": 60.0, "td": 50.0, "tf": 1.0}, "series", False),
    ],
)
def test_the_integral_too_strong(facts, form, caught):
    """Kc K Ti below 2 on an integrator, in whatever form the settings are."""
    assert bool(integral_too_strong(Loop(name="L", form=form, **facts), LEVEL)) == caught


def test_the_trap_is_an_integrators():
    """On a self-regulating process the product means nothing."""
    assert integral_too_strong(Loop(name="L", kp=0.1, ti=1.0), SelfRegulatingModel(1.0, 1.0, 5.0)) == ""
