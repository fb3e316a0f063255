"""Plants: exact under a held input, against the closed form by partial fractions."""

import math

import numpy as np
import pytest
from scipy import signal

from sim_plants.plants import Plant, discretise, hold, state_space

PLANTS = [
    Plant("integrating", 0.7, 0.0),
    Plant("integrating", -0.02, 4.5),
    Plant("integrating", 0.2, 3.0, (4.0, 1.0)),
    Plant("integrating", 1.3, 2.35, (7.0, 3.0, 0.4)),
    Plant("integrating", 0.5, 1.2, (5.0, 2.0), inverse=(1.5,)),
    Plant("self-regulating", 2.0, 3.7, (6.0,)),
    Plant("self-regulating", -1.5, 0.25, (12.0, 5.0, 2.0, 0.9)),
    Plant("self-regulating", 3.0, 0.0, (9.0, 4.0, 1.0), inverse=(2.0, 0.5)),
]


def step_response(plant, times):
    """Unit step response [PV] by partial fractions of the transfer function over s."""
    numerator = np.array([plant.gain])
    for zero in plant.inverse:
        numerator = np.polymul(numerator, [-zero, 1.0])
    denominator = np.array([1.0, 0.0, 0.0] if plant.integrating else [1.0, 0.0])
    for lag in plant.lags:
        denominator = np.polymul(denominator, [lag, 1.0])
    residues, poles, _ = signal.residue(numerator, denominator)
    late = np.maximum(np.asarray(times) - plant.dead_time, 0.0)
    total = np.zeros(late.shape, complex)
    power = 0
    for i, (residue, pole) in enumerate(zip(residues, poles, strict=True)):
        power = power + 1 if i and abs(pole - poles[i - 1]) < 1e-6 else 0
        total += residue * late**power / math.factorial(power) * np.exp(pole * late)
    return np.where(np.asarray(times) > plant.dead_time, total.real, 0.0)


def sampled(plant, period, inputs):
    """PV at the samples, from the discrete step alone."""
    step = discretise(plant, period)
    x, line, pv = np.zeros(plant.order), [0.0] * (step.delay + 1), []
    for w in inputs:
        pv.append(x[-1])
        line.append(w)
        older, newer = line[-step.delay - 2], line[-step.delay - 1]
        x = step.phi @ x + step.older * older + step.newer * newer
    return np.array(pv)


@pytest.mark.parametrize("period", [0.1, 1.0, 2.5])
@pytest.mark.parametrize("plant", PLANTS, ids=str)
def test_exact_at_every_sample_of_a_held_input(plant, period):
    w = np.random.default_rng(1).normal(size=60)
    times = np.arange(60) * period
    moves = np.diff(w, prepend=0.0)
    expected = sum(move * step_response(plant, times - at) for move, at in zip(moves, times, strict=True))
    np.testing.assert_allclose(sampled(plant, period, w), expected, rtol=1e-7, atol=1e-9 * abs(plant.gain))


@pytest.mark.parametrize(
    ("dead_time", "period", "delay"), [(0.1 + 0.2, 0.1, 3), (0.7, 0.1, 7), (1.0, 0.1, 10)]
)
def test_a_rounding_error_beside_a_multiple_makes_no_sample(dead_time, period, delay):
    step = discretise(Plant("integrating", 1.0, dead_time), period)
    assert step.delay == delay
    assert not step.older.any()


def test_dead_time_below_a_period_splits_it():
    step = discretise(Plant("integrating", 2.0, 0.25), 1.0)
    assert step.delay == 0
    np.testing.assert_allclose([step.older[0], step.newer[0]], [0.5, 1.5])


def test_hold_agrees_with_scipy_signal():
    plant = PLANTS[7]
    a, b = state_space(plant)
    c = np.eye(plant.order)[-1:]
    phi, gamma, *_ = signal.cont2discrete((a, b[:, None], c, np.zeros((1, 1))), 0.7)
    np.testing.assert_allclose(hold(plant, 0.7)[0], phi, atol=1e-13)
    np.testing.assert_allclose(hold(plant, 0.7)[1], gamma[:, 0], atol=1e-13)


@pytest.mark.parametrize("plant", PLANTS, ids=str)
def test_state_space_has_the_frequency_response(plant):
    a, b = state_space(plant)
    for omega in (0.01, 0.3, 5.0):
        s = 1j * omega
        direct = np.linalg.solve(s * np.eye(plant.order) - a, b)[-1] * np.exp(-plant.dead_time * s)
        np.testing.assert_allclose(direct, plant.response(np.array([omega]))[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("plant", "dead_time", "lag"),
    [
        (Plant("integrating", 1.0, 1.0), 1.0, 0.0),
        (Plant("integrating", 1.0, 0.0, (1.0, 1.0)), 0.5, 1.5),
        (Plant("integrating", 0.2, 3.0, (1.0, 4.0)), 3.5, 4.5),
        (Plant("self-regulating", 1.0, 0.1, (2.0, 1.0, 0.4, 0.2), (0.3,)), 1.5, 2.5),
    ],
)
def test_half_rule_skogestad_2003(plant, dead_time, lag):
    np.testing.assert_allclose(plant.half_rule(), (dead_time, lag))
    assert plant.t0 == pytest.approx(dead_time + lag)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("integral", 1.0), "process: 'integral', expected one of integrating, self-regulating"),
        (("integrating", 0.0), "gain: 0.0, expected a finite number other than 0"),
        (("integrating", math.nan), "gain: nan"),
        (("integrating", 1.0, -1.0), "dead_time: -1.0, expected"),
        (("integrating", 1.0, 1.0, (2.0, 0.0)), r"lags: \[2.0, 0.0\], expected"),
        (("self-regulating", 1.0), "at least one lag"),
        (("integrating", 1.0, 0.0, (1.0,), (1.0, 2.0)), "fewer zeros than poles"),
    ],
)
def test_a_bad_plant_is_refused_by_field_and_value(arguments, message):
    with pytest.raises(ValueError, match=message):
        Plant(*arguments)
