"""Verdicts: what is flagged and what is not, what the evidence cannot carry, and the words for it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from monitor.assess.evidence import is_explained
from monitor.assess.tuning import integral_too_strong, judge
from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE, Assessment
from monitor.contract.samples import Samples
from monitor.detect.event import LOAD_STEP, SETPOINT_STEP
from monitor.engine import Engine
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.support.detection import closed_event
from tests.support.fits import make_fit
from tests.support.plants import pi_loop, samples_of, times
from tests.support.runs import Seen, run
from tuners.models import IntegratingModel, SelfRegulatingModel

LEVEL = IntegratingModel(0.05, 4.0, 0.0)


def stepped(n: int = 900, at: int = 200, size: float = 4.0, **facts: Any) -> Samples:
    sp = np.full(n, 50.0)
    sp[at:] += size
    pv, op = pi_loop(sp, **facts)
    return Samples.of(0, times(n), sp, pv, op)


def assessed(samples: Samples, **facts: Any) -> tuple[Assessment, Engine, Seen]:
    engine, seen = run(Loop(**({"name": "L", "kp": 2.0, "ti": 40.0} | facts)), samples)
    return next(a for a in seen.assessments if a.kind == "setpoint"), engine, seen


def test_a_good_loop():
    """Fast and robust: `good`, without a word, with an index near 1."""
    found, _, _ = assessed(stepped(noise=0.02))
    assert (found.verdict, found.reason) == (GOOD, "")
    assert found.process == "integrating"
    assert found.ci is not None
    assert 0.8 < found.ci < 1.2
    assert found.ms is not None
    assert 1.4 < found.ms < 2.2
    assert found.gain == pytest.approx(0.05, rel=0.03)
    assert found.coverage == pytest.approx(1.0)


def test_a_sluggish_loop():
    """A fifth of the gain: `retune` for speed, the index in the reason."""
    found, _, _ = assessed(stepped(4000, kp=0.4, ti=300.0, noise=0.02), kp=0.4, ti=300.0)
    assert found.verdict == RETUNE
    assert found.ci is not None
    assert found.ci < 0.4
    assert f"CI_sp = {found.ci:.2f}" in found.reason
    assert "instability" not in found.reason


def test_an_aggressive_loop():
    """Close to instability: `retune` for robustness, whatever the speed."""
    found, _, _ = assessed(stepped(kp=4.4, ti=20.0, noise=0.02), kp=4.4, ti=20.0)
    assert found.verdict == RETUNE
    assert "instability" in found.reason
    assert found.ms is not None
    assert found.ms > 2.75


def test_a_rolling_loop_is_told_the_integral_too_strong():
    """Too much integral action for the gain: the cure is a longer Ti or a higher gain, not a lower one."""
    found, _, _ = assessed(stepped(3000, kp=0.4, ti=30.0, noise=0.02), kp=0.4, ti=30.0)
    assert found.verdict == RETUNE
    assert "a lower gain makes it worse" in found.reason
    assert "Kc K Ti = 0.6" in found.reason


def test_the_index_is_of_the_signal_not_of_the_noise():
    """Three percent of noise over a long window changes CI by less than a tenth."""
    clean, _, _ = assessed(stepped(1500, seed=1))
    noisy, _, _ = assessed(stepped(1500, noise=0.12, seed=1))
    assert clean.ci is not None
    assert noisy.ci == pytest.approx(clean.ci, rel=0.1)


def test_units_do_not_change_a_verdict():
    """Other units of PV and OP, another operating point: CI and Ms the same, gain scaled."""
    samples = stepped(noise=0.03, seed=4)
    other = replace(samples, sp=2.5 * samples.sp - 40, pv=2.5 * samples.pv - 40, op=0.1 * samples.op + 7)
    first, _, _ = assessed(samples)
    second, _, _ = assessed(other, kp=2.0 * 0.1 / 2.5)
    assert second.ci == pytest.approx(first.ci, rel=1e-4)
    assert second.ms == pytest.approx(first.ms, rel=1e-3)
    assert first.gain is not None
    assert second.gain == pytest.approx(first.gain * 25.0, rel=1e-4)
    assert (second.verdict, second.reason) == (first.verdict, first.reason)


def test_a_direct_acting_loop():
    """Negative gains on both sides are as good as positive ones."""
    samples = stepped(noise=0.02)
    found, _, _ = assessed(replace(samples, op=100 - samples.op), kp=-2.0)
    assert found.verdict == GOOD
    assert found.gain == pytest.approx(-0.05, rel=0.03)


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


def test_a_load_step_on_a_self_regulating_loop():
    """Shows its gain, the load's size and when it came; the loop is told that it is slow, its kind given or not."""
    plant = Plant("self-regulating", 2.0, 5.0, (40.0, 6.0))
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=Controller(0.6, 46.0),
        load=Steps((150.4,), (5.0,)),
        noise=0.02,
        seed=1,
    )
    samples = samples_of(Simulation([spec]).advance(1800.0))
    for process in ("self-regulating", "auto"):
        engine, seen = run(Loop(name="L", kp=0.6, ti=46.0, process=process), samples)
        (found,) = seen.assessments
        assert (found.kind, found.process, found.verdict) == ("load", "self-regulating", RETUNE)
        assert "slow to recover" in found.reason
        assert found.gain_lo is not None
        assert found.gain_hi is not None
        assert found.gain_lo <= 2.0 <= found.gain_hi < 2.0 * found.gain_lo
        assert found.amplitude == pytest.approx(5.0, rel=0.05)
        assert (found.start - int(samples.time[0])) / 1e9 == pytest.approx(150.4, abs=5.0)
        new = engine.row(0)
        assert new.new_kp is not None
        assert new.new_kp > 0.6


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


def test_a_loop_without_settings_has_no_ms():
    """Nothing is known of the controller: the index is given, Ms is not."""
    found, _, _ = assessed(stepped(noise=0.02), kp=None, ti=math.inf)
    assert found.ms is None
    assert found.ci is not None
    assert found.method == "direct"


def test_integrals_check_the_fit():
    """The running integrals give gain and T0 beside the fit, for a settled event from rest."""
    found, _, _ = assessed(stepped(1500, noise=0.005))
    assert found.gain_integrals == pytest.approx(0.05, rel=0.02)
    assert found.t0_integrals == pytest.approx(4.5, rel=0.25)


# ---------------------------------------------------------------------------------------------------
# judging by itself


def ci_pair(ci: float | None) -> Any:
    return (ci, None)


@pytest.mark.parametrize(
    ("ci", "ms", "verdict"),
    [
        (0.61, 1.7, GOOD),
        (0.59, 1.7, RETUNE),
        (1.50, 2.76, RETUNE),
        (1.50, 2.74, GOOD),
        (0.90, None, GOOD),
        (0.90, math.inf, RETUNE),
        (None, 1.7, INCONCLUSIVE),
        (None, 3.0, RETUNE),
    ],
)
def test_limits_of_the_verdict(ci, ms, verdict):
    """Flagged below ci_min, or above 1.25 ms_max; without an index nothing is called good."""
    found, reason = judge(Loop(name="L", kp=2.0, ti=40.0), LEVEL, ci_pair(ci), ms, 0.0)
    assert found == verdict
    assert (reason == "") == (verdict == GOOD and ms is not None)


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
