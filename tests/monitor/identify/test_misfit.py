"""The error of a model that a window shows: none in noise, a resonance where it is, whatever the record looks like."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from monitor.identify.direct import fit_window
from monitor.identify.misfit import ModelError, _responses, model_error
from monitor.identify.projection import Beside

GAIN, DEAD_TIME, LAG, FREQUENCY, DAMPING = 0.05, 6, 5.0, 0.6, 0.05


def second_order(u: Array, step: float, w: float, zeta: float) -> tuple[Array, Array]:
    """Naive twin: ``w^2/(s^2 + 2 zeta w s + w^2) u`` of held input and its slope over w, by small Euler steps."""
    fine, a, b = 4000, 0.0, 0.0
    out = np.zeros((2, len(u)))
    for k, held in enumerate(u):
        out[:, k] = a, b
        for _ in range(fine):
            a, b = a + step / fine * w * b, b + step / fine * w * (held - a - 2.0 * zeta * b)
    return out[0], out[1]


def stepped(
    share: float, noise: float, seed: int = 1, n: int = 500, dead_time: int = DEAD_TIME, lag: float = LAG,
    frequency: float = FREQUENCY,
) -> EventWindow:  # fmt: skip
    """A set-point step of an integrating loop beside which ``share`` of a resonance answers OP."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) - 100.0
    pv, op, sp = np.zeros(n), np.zeros(n), (time >= 0) * 1.0
    decay, late = math.exp(-1.0 / lag), [0.0] * dead_time
    root = math.sqrt(1.0 - DAMPING**2)
    fall = math.exp(-DAMPING * frequency)
    cos, sin = fall * math.cos(frequency * root), fall * math.sin(frequency * root) / root
    x = s = a = b = integral = 0.0
    for k in range(n):
        pv[k] = GAIN * s + share * a + noise * rng.normal()
        integral += (sp[k] - pv[k]) / 60.0
        op[k] = 0.4 * (sp[k] - pv[k] + integral)
        late.append(op[k])
        acts = late.pop(0)
        x = acts + (x - acts) * decay
        s += x
        away = a - op[k]
        a, b = op[k] + (cos + DAMPING * sin) * away + sin * b, (cos - DAMPING * sin) * b - sin * away
    return EventWindow(time, sp, pv, op, 100)


def seen(window: EventWindow, noise: float) -> ModelError:
    fit = fit_window(window, "integrating")
    assert fit is not None
    return model_error(window, fit, noise)


@settings(max_examples=10)
@given(w=st.floats(0.05, 2.0), zeta=st.floats(0.02, 0.6), seed=st.integers(0, 99))
def test_responses_are_those_of_the_differential_equation(w, zeta, seed):
    u = np.random.default_rng(seed).normal(size=12)
    naive = second_order(u, 0.7, w, zeta)
    fast = _responses(u, 0.7, np.array([w]), np.array([zeta]), Beside(False))
    np.testing.assert_allclose(fast, naive, atol=5e-3 * float(np.abs(naive).max()))


@pytest.mark.parametrize("noise", [0.003, 0.01, 0.03])
def test_noise_is_no_error_of_the_model(noise):
    assert sum(len(seen(stepped(0.0, noise, seed), noise).omega) for seed in range(8)) == 0


@pytest.mark.parametrize("dead_time", [2, 3])
def test_noise_that_the_controller_answers_is_no_error_of_the_model(dead_time):
    """Within a dead time of a few samples OP answers the noise: what lies ahead of it in the model's response is it."""
    windows = [stepped(0.0, 0.03, seed, 900, dead_time, 0.1) for seed in range(4)]
    assert sum(len(seen(window, 0.03).omega) for window in windows) == 0


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_resonance_is_found_where_it_is(noise):
    """Its share over twice its damping is what it adds to the process at its peak."""
    found = seen(stepped(0.1, noise), noise)
    k = int(np.argmax(found.chi))
    true = 0.1 / (2.0 * DAMPING)
    assert found.omega[k] == pytest.approx(FREQUENCY, rel=0.06)
    assert 0.7 * true < found.bound[k] < 2.0 * true


def test_parameters_are_no_error_of_the_model():
    """What another gain, dead time or lag would explain belongs to the region of the model."""
    window = stepped(0.0, 0.01)
    fit = fit_window(window, "integrating")
    assert fit is not None
    for other in (replace(fit, gain=1.03 * fit.gain), replace(fit, dead_time=fit.dead_time + 0.3)):
        assert model_error(window, other, 0.01).omega.size == 0


def test_long_and_uneven_windows_say_the_same():
    """Means over samples, lost samples: the resonance stays where it is, and as large."""
    whole = stepped(0.1, 0.01, n=1000)
    rng = np.random.default_rng(3)
    kept = np.sort(rng.choice(500, 470, replace=False))
    part = EventWindow(
        *(x[:500][kept] for x in (whole.time, whole.sp, whole.pv, whole.op)), int(np.sum(kept < 100))
    )
    for window in (whole, part):
        found = seen(window, 0.01)
        k = int(np.argmax(found.chi))
        assert found.omega[k] == pytest.approx(FREQUENCY, rel=0.1)
        assert 0.5 < found.bound[k] < 2.5


def test_long_windows_hide_nothing_fast():
    """A window of three times as many points as are looked at: what is faster than their means show is seen, too."""
    found = seen(stepped(0.1, 0.01, n=1300, frequency=1.3), 0.01)
    k = int(np.argmax(found.chi))
    assert found.omega[k] == pytest.approx(1.3, rel=0.06)
    nothing = seen(stepped(0.0, 0.01, n=1300), 0.01)
    assert nothing.omega.size == 0
    assert nothing.unseen.omega.max() > 2.0


def test_what_might_be_there_is_taken_for_as_large_as_it_looks():
    """A resonance half in the noise is not seen, but the bound of what is not excluded holds it."""
    sizes = []
    for seed in range(4):
        found = seen(stepped(0.012, 0.03, seed, n=700), 0.03)
        near = np.abs(found.unseen.omega / FREQUENCY - 1.0) < 0.15
        sizes.append(found.unseen.bound[near].max() if near.any() else found.bound.max())
    assert min(sizes) > 0.012 / (2.0 * DAMPING)


def test_too_short_a_window_says_nothing():
    window = stepped(0.1, 0.01)
    fit = fit_window(window, "integrating")
    assert fit is not None
    short = EventWindow(*(x[90:115] for x in (window.time, window.sp, window.pv, window.op)), 10)
    assert model_error(short, fit, 0.01).omega.size == 0
