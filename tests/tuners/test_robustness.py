"""Ms, margins and stability against naive twins and python-control."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.support.random_loops import draw_loops
from tuners.models import IntegratingModel, Plant, SelfRegulatingModel
from tuners.robustness import margins, peak_sensitivity
from tuners.rules import RULES
from tuners.settings import Settings
from tuners.simc import simc_pid

UNIT = IntegratingModel(1.0, 1.0)


def naive_ms(model, settings):
    """Naive twin: a fine grid, and the winding of 1 + L counted by unwrapping."""
    theta = float(model.dead_time)
    omega = (
        np.unique(np.concatenate([np.geomspace(1e-6, 3e3, 20_000), np.linspace(0, 60, 20_001)[1:]])) / theta
    )
    back = 1 + model.frequency_response(omega) * settings.frequency_response(omega)
    poles = int(model.process == "integrating") + int(math.isfinite(settings.ti))
    turn = np.unwrap(np.angle(back))
    # 0 at infinity and -n pi/2 at 0+ for a stable loop
    stable = abs(turn[-1] - turn[0] - poles * math.pi / 2) < 0.5
    return float(1 / np.abs(back).min()) if stable else math.inf


@pytest.mark.parametrize("hard", [False, True], ids=["tame", "wild"])
def test_ms_agrees_with_the_naive_twin(hard):
    for model, settings in draw_loops(150, seed=11, hard=hard):
        expected, found = naive_ms(model, settings), peak_sensitivity(model, settings)
        if expected < 50:
            assert found == pytest.approx(expected, rel=1e-3), (model, settings)
        else:
            # Next to the limit the twin's grid and count are too coarse to be right.
            assert found > 20, (model, settings)


def control_loop(model, settings, order=8):
    """Loop gain for python-control, dead time as a high-order Padé, in units of the dead time."""
    theta = float(model.dead_time)
    s = control.tf("s")
    process = control.tf(*control.pade(1.0, order)) * float(model.gain)
    if model.process == "integrating":
        process *= theta / s
    for lag in model.lags:
        process *= 1 / (float(lag) / theta * s + 1)
    td, tf = settings.td / theta, settings.filter_time / theta
    integral = 1 + theta / (settings.ti * s) if math.isfinite(settings.ti) else 1
    if settings.form == "series":
        return process * settings.kp * integral * (td * s + 1) / (tf * s + 1)
    return process * settings.kp * (integral + td * s / (tf * s + 1))


def test_agrees_with_python_control_on_80_random_loops():
    """Stability from the closed-loop poles, Ms, Mt and margins within 0.5 %, dead time as Padé of order 8."""
    checked = 0
    for model, settings in draw_loops(80, seed=5):
        loop = control_loop(model, settings)
        found = margins(model, settings)
        poles = control.feedback(loop, 1).poles()
        assert found.stable == bool(np.all(poles.real < 0)), (model, settings)
        if not found.stable:
            assert math.isinf(found.ms)
            continue
        omega = np.geomspace(1e-5, 6, 20_000)  # Padé of order 8 is exact to 1e-4 below 6 rad a dead time
        response = loop(1j * omega)
        theta = float(model.dead_time)
        wide = np.geomspace(1e-5, 100, 40_000)
        exact = model.frequency_response(wide / theta) * settings.frequency_response(wide / theta)
        if wide[np.abs(1 + exact).argmin()] > 5 or found.ms > 1e3:
            continue  # beyond Padé's reach
        checked += 1
        assert found.ms == pytest.approx(np.abs(1 / (1 + response)).max(), rel=5e-3), (model, settings)
        assert found.mt == pytest.approx(np.abs(response / (1 + response)).max(), rel=5e-3), (model, settings)
        gains, phases, *_ = control.stability_margins(loop, returnall=True)
        gains = [g for g in gains if g > 1]
        if gains and found.gain_margin < 20:
            assert found.gain_margin == pytest.approx(min(gains), rel=5e-3), (model, settings)
        crossed = np.abs(response)
        if np.any(crossed > 1) and crossed[-1] < 1 and len(phases):
            assert found.phase_margin == pytest.approx(min(abs(p) for p in phases), rel=5e-3, abs=0.05)
            assert found.delay_margin / theta > 0
    assert checked > 60


def test_delay_and_gain_margin_are_the_limits_of_stability():
    for model, settings in draw_loops(60, seed=3):
        found = margins(model, settings)
        if not found.stable or found.ms > 1e3:
            continue
        for share, stable in ((0.999, True), (1.001, False)):
            if math.isfinite(found.gain_margin) and found.gain_margin < 1e3:
                changed = replace(settings, kp=settings.kp * found.gain_margin**share)
                assert math.isfinite(peak_sensitivity(model, changed)) == stable
            if math.isfinite(found.delay_margin):
                later = replace(model, dead_time=model.dead_time + found.delay_margin * share)
                assert math.isfinite(peak_sensitivity(later, settings)) == stable


@given(st.floats(0.05, 1.3), st.floats(1.5, 50), st.floats(0.0, 8), st.floats(0.0, 2), st.floats(1e-3, 1e3))
def test_scaling(tight, reset, lag, lead, k):
    """Gain times k and kp over k leave Ms; so does time times k; so does a change of both signs."""
    model, settings = IntegratingModel(1.0, 1.0, lag), Settings(tight, reset, lead, lead / 8)
    base = margins(model, settings)
    slow = Settings(tight / k, k * reset, k * lead, k * lead / 8)
    cases = {
        "gain": (IntegratingModel(k, 1.0, lag), replace(settings, kp=tight / k), 1.0),
        "time": (IntegratingModel(1.0, k, k * lag), slow, k),
        "sign": (IntegratingModel(-1.0, 1.0, lag), replace(settings, kp=-tight), 1.0),
    }
    for name, (other, changed, stretch) in cases.items():
        found = margins(other, changed)
        assert found.stable == base.stable, name
        if base.stable and base.ms < 1e3:
            assert found.ms == pytest.approx(base.ms, rel=1e-5), name
            assert found.gain_margin == pytest.approx(base.gain_margin, rel=1e-6), name
            assert found.delay_margin == pytest.approx(base.delay_margin * stretch, rel=1e-6), name


@given(st.floats(0.1, 10), st.floats(0.5, 30))
@example(2.5, 1.1015625)  # Ms of 551, found as 550
@example(1.046875, 1.037109375)  # of 880,000, found as 5,400
def test_ms_bounds_the_margins(tight, reset):
    """GM is at least Ms/(Ms - 1) and PM at least 2 arcsin(1/(2 Ms)); a peak of hundreds is found too low."""
    found = margins(UNIT, Settings(tight / 10, reset))
    if found.stable:
        assert found.ms >= 1
        if found.ms < 100:
            assert found.gain_margin >= found.ms / (found.ms - 1) * 0.999
            assert found.phase_margin >= math.degrees(2 * math.asin(1 / (2 * found.ms))) * 0.999


def test_stability_limit_of_an_integrator_under_pi_is_exact():
    """Di Ruscio 2010, exact: alpha up to arctan(c sqrt f)/sqrt f with c = alpha beta."""
    c = 4.0
    f = (1 + math.sqrt(1 + 4 / c**2)) / 2
    limit = math.atan(c * math.sqrt(f)) / math.sqrt(f)
    for share in (1 - 1e-9, 1 + 1e-9):
        found = peak_sensitivity(UNIT, Settings(limit * share, c / (limit * share)))
        assert math.isfinite(found) == (share < 1)


@pytest.mark.parametrize(
    ("model", "settings", "ms"),
    [
        pytest.param(UNIT, Settings(-0.5, 8.0), math.inf, id="positive feedback"),
        pytest.param(UNIT, Settings(-0.5), math.inf, id="positive feedback, P"),
        pytest.param(
            SelfRegulatingModel(1.0, 1.0, 5.0), Settings(-2.0), math.inf, id="positive feedback above 1"
        ),
        pytest.param(SelfRegulatingModel(1.0, 1.0, 5.0), Settings(-0.5), 2.0, id="positive feedback below 1"),
        pytest.param(UNIT, Settings(0.0), math.inf, id="no controller on an integrator"),
        pytest.param(
            SelfRegulatingModel(1.0, 1.0, 5.0), Settings(0.0), 1.0, id="no controller, self-regulating"
        ),
        pytest.param(IntegratingModel(1.0, 0.0), Settings(3.0), 1.0, id="P on a pure integrator"),
        pytest.param(UNIT, Settings(0.5, 8.0, 2.5), math.inf, id="ideal derivative above 1 at infinity"),
        # |L| falls to a circle of radius kp K td = .25, which dead time turns for ever; figure from a fine grid
        pytest.param(UNIT, Settings(0.1, math.inf, 2.5), 1.3373, id="ideal derivative below 1"),
        pytest.param(SelfRegulatingModel(1.0, 1.0, 0.0), Settings(0.5), 2.0, id="dead time alone, P"),
        pytest.param(
            SelfRegulatingModel(1.0, 1.0, 0.0), Settings(1.1), math.inf, id="dead time alone, too much P"
        ),
    ],
)
def test_edge_cases(model, settings, ms):
    assert peak_sensitivity(model, settings) == pytest.approx(ms, rel=2e-3)


def test_resonance_at_high_frequency_is_found():
    """A tiny filter leaves peaks at many radians of dead time; the twin sees them on a fine grid."""
    for n in (5, 20, 100, 1000):
        settings = Settings(0.5, 8.0, 0.9, 0.9 / n)
        omega = np.linspace(1e-3, 400, 2_000_001)
        back = 1 + UNIT.frequency_response(omega) * settings.frequency_response(omega)
        assert peak_sensitivity(UNIT, settings) == pytest.approx(1 / np.abs(back).min(), rel=1e-3)


def test_detuned_and_slow_loops():
    """Decades away from the dead time: slow rolling, sluggish gain, tiny and huge dead time."""
    # Without dead time: s^2 + kp s + kp/ti, whose Ms is known from the damping.
    for zeta in (0.05, 0.2, 0.5):
        kp = 1e-4
        ti = 4 * zeta**2 / kp
        x = np.geomspace(0.05, 20, 400_001)
        ms = np.max(x**2 / np.abs(1 - x**2 + 2j * zeta * x))
        for theta in (0.0, 1e-6 * ti):
            assert peak_sensitivity(IntegratingModel(1.0, theta), Settings(kp, ti)) == pytest.approx(
                ms, rel=1e-3
            )
    for kp in (1e-3, 1e-2, 0.05):
        settings = Settings(kp, 20.0 / kp)
        assert peak_sensitivity(UNIT, settings) == pytest.approx(naive_ms(UNIT, settings), rel=1e-3)


def test_huge_integral_time_is_no_integral():
    assert peak_sensitivity(UNIT, Settings(0.6, 1e12)) == pytest.approx(
        peak_sensitivity(UNIT, Settings(0.6)), rel=1e-6
    )


def test_forms_of_one_controller_have_one_ms():
    settings = Settings(0.6, 30.0, 3.0, 0.3, "series")
    model = IntegratingModel(0.2, 3.5, 4.5)
    values = [peak_sensitivity(model, settings.to(form)) for form in ("series", "standard", "parallel")]
    assert values == pytest.approx([values[0]] * 3, rel=1e-6)


def test_weights_do_not_matter():
    assert peak_sensitivity(UNIT, Settings(0.5, 8.0, b=0.0)) == peak_sensitivity(UNIT, Settings(0.5, 8.0))


def test_arrays_equal_scalars():
    loops = [pair for pair in draw_loops(80, seed=8) if isinstance(pair[0], SelfRegulatingModel)]
    series = [pair for pair in loops if pair[1].form == "series"]
    model = SelfRegulatingModel(
        *(np.array([getattr(m, f) for m, _ in series]) for f in SelfRegulatingModel.__slots__)
    )
    fields = ("kp", "ti", "td", "tf")
    settings = Settings(*(np.array([getattr(s, f) for _, s in series]) for f in fields), form="series")
    many = margins(model, settings)
    for i, pair in enumerate(series):
        one = margins(*pair)
        for figure in ("ms", "mt", "gain_margin", "phase_margin", "delay_margin"):
            expected = getattr(one, figure)
            assert getattr(many, figure)[i] == pytest.approx(expected, rel=2e-5, nan_ok=True), figure


def test_fields_broadcast_and_keep_their_shape():
    model = IntegratingModel(np.array([[1.0], [2.0]]), 1.0)
    assert peak_sensitivity(model, Settings(np.array([0.2, 0.3, 0.4]), 8.0)).shape == (2, 3)
    assert isinstance(peak_sensitivity(UNIT, Settings(0.5)), float)


def test_nan_in_nan_out():
    model = IntegratingModel(np.array([1.0, np.nan, 1.0]), np.array([1.0, 1.0, np.nan]))
    assert np.isnan(peak_sensitivity(model, Settings(0.5, 8.0))).tolist() == [False, True, True]
    assert np.isnan(peak_sensitivity(UNIT, Settings(0.5, np.array([8.0, np.nan])))).tolist() == [False, True]


def test_unstable_loops_have_no_margins():
    found = margins(UNIT, Settings(3.0, 8.0))
    assert not found.stable
    assert math.isinf(found.ms)
    assert all(math.isnan(v) for v in (found.gain_margin, found.phase_margin, found.delay_margin))


def test_third_order_plant():
    """Without dead time the closed-loop poles decide: s^4 + ... of 1/(s(s+1)^2) under PI."""
    plant = Plant(1.0, 0.0, (1.0, 1.0))
    for kp in (0.2, 0.5, 1.0, 1.8, 2.5):
        poles = np.roots([1.0, 2.0, 1.0, kp, kp / 6.0])
        assert math.isfinite(peak_sensitivity(plant, Settings(kp, 6.0))) == bool(np.all(poles.real < 0))


@pytest.mark.parametrize("name", RULES)
def test_every_rule_against_the_naive_twin(name):
    rule = RULES[name]
    model = (
        IntegratingModel(0.3, 4.0, 2.0)
        if "integrating" in rule.processes
        else SelfRegulatingModel(2.0, 4.0, 9.0, 1.0)
    )
    settings = rule.function(model, **dict.fromkeys(rule.required, 1.0))
    assert peak_sensitivity(model, settings) == pytest.approx(naive_ms(model, settings), rel=1e-3)


def test_larger_lag_with_filter_lowers_robustness():
    """The SIMC PID's filter costs more the more lag it cancels."""
    values = [
        peak_sensitivity(m, simc_pid(m))
        for m in (IntegratingModel(1.0, 1.0, float(r)) for r in (1, 4, 6, 10))
    ]
    assert values == sorted(values)
