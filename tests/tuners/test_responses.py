"""Closed-loop responses against a time simulation that knows nothing of Fourier."""

import math

import numpy as np
import pytest

from tests.support.random_loops import draw_loops
from tuners.models import IntegratingModel, Plant, SelfRegulatingModel
from tuners.responses import closed_loop_response, step_figures
from tuners.robustness import peak_sensitivity
from tuners.settings import Settings
from tuners.simc import simc_pd, simc_pi, simc_pid

UNIT = IntegratingModel(1.0, 1.0)


def simulate(model, settings, kind, duration, steps=400):
    """Naive twin: `steps` steps a dead time, trapezoids, dead time as a shift; standard form."""
    standard = settings.to("standard")
    h = float(model.dead_time) / steps
    count = int(duration / h)
    setpoint, load = (1.0, 0.0) if kind == "setpoint" else (0.0, 1.0)
    kp, td, tf = float(standard.kp), float(standard.td), float(standard.filter_time)
    reset = 0.0 if math.isinf(standard.ti) else 1 / float(standard.ti)
    b, c = float(standard.b), float(standard.c)
    lags = [float(lag) for lag in model.lags if lag > 0]
    state, level, area = [0.0] * len(lags), 0.0, 0.0
    # The derivative acts on c r - y behind a first-order lag; r has stepped just before the first sample.
    held, last = 0.0, c * setpoint
    op, pv = np.zeros(count), np.zeros(count + 1)
    decay = math.exp(-h / tf) if tf > 0 else 0.0
    for k in range(count):
        slope = (last - held) / tf if tf > 0 else 0.0
        op[k] = kp * (b * setpoint - pv[k] + reset * area + td * slope)
        left = op[k - steps] + load if k >= steps else 0.0
        right = op[k - steps + 1] + load if k >= steps else 0.0
        for i, lag in enumerate(lags):
            old, fall = state[i], math.exp(-h / lag)
            # exact for an input that is straight between left and right
            ramp = (right - left) / h
            state[i] = left + ramp * (h - lag) + (old - left + ramp * lag) * fall
            left, right = old, state[i]
        if model.process == "integrating":
            level += (left + right) / 2 * h
        else:
            level = right
        pv[k + 1] = float(model.gain) * level
        area += h * (setpoint - (pv[k] + pv[k + 1]) / 2)
        new = c * setpoint - pv[k + 1]
        if tf > 0:
            rise = (new - last) / h
            held = last + rise * (h - tf) + (held - last + rise * tf) * decay
        last = new
    time = h * np.arange(count + 1)
    return time, pv, op, float(np.trapezoid(np.abs(setpoint - pv), time))


def comparable_loops(count):
    """Random stable loops with integral action that have settled within 150 dead times."""
    loops = []
    for model, settings in draw_loops(7 * count, seed=21, quick=True):
        if len(loops) == count:
            break
        if not peak_sensitivity(model, settings) < 5:
            continue
        if settings.td > 0 and not (
            any(lag > 0 for lag in model.lags) and settings.tf > 0.02 * model.dead_time
        ):
            continue  # the twin's steps do not resolve a kick that is shorter, or that no lag rounds off
        setpoint, load = (closed_loop_response(model, settings, kind) for kind in ("setpoint", "load"))
        if max(setpoint.time[-1], load.time[-1]) < 150 * model.dead_time:
            loops.append((model, settings.to("standard"), {"setpoint": setpoint.iae, "load": load.iae}))
    return loops


def simulate_iae(loops, kind, dead_times=150, *, steps):
    """The same twin for many loops side by side, in units of each loop's dead time: IAE (L,)."""
    theta = np.array([float(m.dead_time) for m, _, _ in loops])
    gain = np.array([float(m.gain) for m, _, _ in loops])
    integrating = np.array([m.process == "integrating" for m, _, _ in loops])
    lags = [np.array([float((*m.lags, 0.0)[i]) for m, _, _ in loops]) / theta for i in (0, 1)]
    kp, ti, td, tf = (np.array([float(getattr(s, f)) for _, s, _ in loops]) for f in ("kp", "ti", "td", "tf"))
    gain, ti, td, tf = np.where(integrating, gain * theta, gain), ti / theta, td / theta, tf / theta
    h, count = 1 / steps, dead_times * steps
    setpoint, load = (1.0, 0.0) if kind == "setpoint" else (0.0, 1.0)
    active = tf > 0
    tf = np.where(active, tf, 1.0)
    decay = np.exp(-h / tf)
    falls = [np.where(lag > 0, np.exp(-h / np.where(lag > 0, lag, 1.0)), 0.0) for lag in lags]
    op = np.zeros((count, len(loops)))
    pv, level, area, iae = (np.zeros(len(loops)) for _ in range(4))
    state = [np.zeros(len(loops)) for _ in lags]
    held, last = np.zeros(len(loops)), np.full(len(loops), setpoint)
    for k in range(count):
        op[k] = kp * (setpoint - pv + area / ti + td * np.where(active, (last - held) / tf, 0.0))
        left = op[k - steps] + load if k >= steps else 0.0 * pv
        right = op[k - steps + 1] + load if k >= steps else 0.0 * pv
        for i, (lag, fall) in enumerate(zip(lags, falls, strict=True)):
            ramp = (right - left) / h
            new = left + ramp * (h - lag) + (state[i] - left + ramp * lag) * fall
            left, right, state[i] = np.where(lag > 0, state[i], left), np.where(lag > 0, new, right), new
        level = np.where(integrating, level + (left + right) / 2 * h, right)
        before, pv = pv, gain * level
        area = area + h * (setpoint - (before + pv) / 2)
        iae += h * (np.abs(setpoint - before) + np.abs(setpoint - pv)) / 2
        new = setpoint - pv
        rise = (new - last) / h
        held = last + rise * (h - tf) + (held - last + rise * tf) * decay
        last = new
    return iae * theta


@pytest.fixture(scope="module")
def random_loops():
    return comparable_loops(80)


@pytest.mark.parametrize("kind", ["setpoint", "load"])
def test_iae_agrees_with_a_time_simulation_on_80_random_loops(random_loops, kind):
    assert len(random_loops) == 80
    # The twin's error falls with the square of its step: extrapolate to none.
    expected = (
        4 * simulate_iae(random_loops, kind, steps=60) - simulate_iae(random_loops, kind, steps=30)
    ) / 3
    found = np.array([iae[kind] for _, _, iae in random_loops])
    np.testing.assert_allclose(found, expected, rtol=1e-3)


@pytest.mark.parametrize("kind", ["setpoint", "load"])
@pytest.mark.parametrize(
    ("model", "settings"),
    [
        (UNIT, Settings(0.5, 8.0)),
        (IntegratingModel(-0.2, 3.0, 4.0), Settings(-0.9, 30.0, 3.0, 0.3, "series")),
        (IntegratingModel(0.2, 3.0, 4.0), Settings(0.9, 30.0, 3.0, 0.3, b=0.0, c=0.0)),
        (IntegratingModel(0.2, 3.0, 4.0), Settings(0.9, 30.0, 3.0, 0.3, b=1.0, c=0.0)),
        (SelfRegulatingModel(2.0, 1.0, 5.0, 2.0), Settings(1.0, 6.0, 1.0, 0.1, "parallel", b=0.5)),
        (SelfRegulatingModel(2.0, 1.0, 5.0), Settings(0.8)),
    ],
)
def test_pv_and_op_agree_with_a_time_simulation(model, settings, kind):
    found = closed_loop_response(model, settings, kind, duration=30.0)
    time, pv, op, _ = simulate(model, settings, kind, 30.0)
    assert found.pv == pytest.approx(np.interp(found.time, time, pv), abs=2e-3 * np.abs(pv).max())
    later = found.time > 0.01  # OP jumps at 0
    held = np.interp(found.time, time[:-1], op)
    scale = np.abs(held).max()
    inside = later & (np.abs(found.time - model.dead_time) > 0.05) & (found.time < 29.8)
    assert found.op[inside] == pytest.approx(held[inside], abs=8e-3 * scale)


def test_kick_of_op():
    """First OP after a set-point step: b kp, and c kp td/tf more with derivative."""
    settings = Settings(0.5, 8.0, 0.4, 0.1, b=0.7, c=0.5)
    assert closed_loop_response(UNIT, settings).op[0] == pytest.approx(0.5 * (0.7 + 0.5 * 4), rel=2e-3)
    series = Settings(0.5, 8.0, 0.4, 0.1, "series")
    assert closed_loop_response(UNIT, series).op[0] == pytest.approx(0.5 * 4, rel=2e-3)


def test_integral_of_the_error_is_exact():
    """After a load step int e = -ti/kp; without undershoot that is the IAE."""
    settings = simc_pi(UNIT)
    found = closed_loop_response(UNIT, settings, "load")
    assert found.overshoot == pytest.approx(0, abs=1e-4)
    assert found.iae == pytest.approx(settings.ti / settings.kp, rel=1e-4)


@pytest.mark.parametrize("settings", [simc_pi(UNIT), Settings(0.3, 40.0), Settings(1.0, 8.0)])
def test_pv_is_zero_within_the_dead_time(settings):
    found = closed_loop_response(UNIT, settings)
    assert np.all(found.pv[found.time < 1] == 0)


def test_scaling_of_iae():
    """Time times k: IAE times k (set point), k^2 (load of an integrator, whose gain stays)."""
    model, slow = IntegratingModel(0.3, 2.0, 1.0), IntegratingModel(0.3, 14.0, 7.0)
    base = [closed_loop_response(model, simc_pid(model), kind).iae for kind in ("setpoint", "load")]
    seven = [closed_loop_response(slow, simc_pid(slow), kind).iae for kind in ("setpoint", "load")]
    assert seven == pytest.approx([7 * base[0], 49 * base[1]], rel=1e-4)


def test_stiff_loops_cost_and_cover_what_others_do():
    """Dead time four decades below the loop's own time: IAE_ld = ti/kp all the same."""
    model = IntegratingModel(1.0, 0.01)
    found = closed_loop_response(model, Settings(0.01, 400.0), "load")
    assert found.iae == pytest.approx(400 / 0.01, rel=1e-3)
    assert found.time.size < 600_000


def test_lasting_offset_has_no_iae():
    model = SelfRegulatingModel(2.0, 1.0, 5.0)
    found = closed_loop_response(model, Settings(0.5))
    assert math.isinf(found.iae)
    assert found.pv[-1] == pytest.approx(0.5, abs=1e-3)
    assert math.isinf(closed_loop_response(UNIT, simc_pd(UNIT), "load").iae)
    assert closed_loop_response(UNIT, simc_pd(UNIT), "load").pv[-1] == pytest.approx(2.0, rel=1e-3)


def test_unstable_loop():
    found = closed_loop_response(UNIT, Settings(3.0, 8.0))
    assert (found.time.size, found.iae) == (0, math.inf)
    assert math.isnan(found.overshoot)


def test_duration_cuts_the_curves_only():
    settings = simc_pi(UNIT)
    short, whole = closed_loop_response(UNIT, settings, duration=5.0), closed_loop_response(UNIT, settings)
    assert short.time[-1] == pytest.approx(5.0, abs=0.05)
    assert short.iae == pytest.approx(whole.iae, rel=1e-4)


def test_overshoot_and_settling_time():
    """Second-order loop without dead time: overshoot and settling from the curve itself."""
    zeta, omega = 0.5, 0.2
    plant = Plant(omega**2, 0.0, (1 / (2 * zeta * omega),))
    found = closed_loop_response(plant, Settings(1 / (2 * zeta * omega)))
    assert found.overshoot == pytest.approx(math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), rel=2e-3)
    t = np.linspace(0, 100, 200_001)
    wave = omega * math.sqrt(1 - zeta**2) * t
    exact = np.exp(-zeta * omega * t) * (np.cos(wave) + zeta / math.sqrt(1 - zeta**2) * np.sin(wave))
    assert found.settling_time == pytest.approx(t[np.abs(exact) > 0.02][-1], rel=5e-3)


@pytest.mark.parametrize(
    ("kwargs", "match"),
    [({"kind": "noise"}, "kind"), ({"duration": 0.0}, "duration"), ({"duration": math.inf}, "duration")],
)
def test_wrong_use(kwargs, match):
    with pytest.raises(ValueError, match=match):
        closed_loop_response(UNIT, simc_pi(UNIT), **kwargs)
    with pytest.raises(ValueError, match="scalars"):
        closed_loop_response(IntegratingModel(1.0, np.array([1.0, 2.0])), Settings(0.2, 9.0))


def test_ideal_derivative_and_process_without_lag_still_answer():
    found = closed_loop_response(UNIT, Settings(0.3, 8.0, 0.3))
    assert found.iae == pytest.approx(
        closed_loop_response(UNIT, Settings(0.3, 8.0, 0.3, 0.0003)).iae, rel=1e-3
    )
    gain_only = SelfRegulatingModel(1.0, 1.0, 0.0)
    found = closed_loop_response(gain_only, Settings(0.2, 0.6))
    assert found.iae == pytest.approx(0.6 / 0.2, rel=0.01)


def test_figures_of_many_are_those_of_one_by_one():
    """IAE within 1 %, overshoot within half a percent of the step, for loops of every kind, side by side or alone."""
    compared = 0
    for model, settings in draw_loops(150, seed=4, quick=True):
        if not peak_sensitivity(model, settings) < 6:
            continue
        compared += 1
        other = Settings(0.7 * settings.kp, 1.4 * settings.ti, settings.td, settings.tf, settings.form)
        stack = {n: np.array([getattr(x, n) for x in (settings, other)]) for n in ("kp", "ti", "td", "tf")}
        found = step_figures(model, Settings(form=settings.form, **stack))
        for k, one in enumerate((settings, other)):
            setpoint, load = (closed_loop_response(model, one, kind) for kind in ("setpoint", "load"))
            assert found.iae_setpoint[k] == pytest.approx(setpoint.iae, rel=0.01), (model, one)
            assert found.iae_load[k] == pytest.approx(load.iae, rel=0.01), (model, one)
            assert found.overshoot[k] == pytest.approx(setpoint.overshoot, abs=5e-3), (model, one)
    assert compared > 100


def test_figures_of_loops_without_any():
    """Unstable: no overshoot, infinite errors; a lasting offset: an infinite error, stated beforehand or found out."""
    found = step_figures(UNIT, Settings(np.array([3.0, 0.5, 0.5]), np.array([8.0, 8.0, math.inf])))
    assert np.isnan(found.overshoot).tolist() == [True, False, False]
    assert np.isinf(found.iae_setpoint).tolist() == [True, False, False]
    assert np.isinf(found.iae_load).tolist() == [True, False, True]
    told = step_figures(UNIT, Settings(np.array([3.0, 0.5]), 8.0), np.array([False, True]))
    assert told.iae_load[1] == found.iae_load[1]
    assert math.isinf(told.iae_load[0])
    gain_only = step_figures(SelfRegulatingModel(2.0, 1.0, 5.0), Settings(0.5))
    assert math.isinf(gain_only.iae_setpoint[0])
