"""Oscillation and stiction: what swings on is found, with its period; what passes, wanders or fades is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from monitor.health.block import BLOCK_LENGTH
from monitor.health.level import ACF_LAGS
from monitor.health.oscillation import cycle
from sim_plants.specs import Steps
from tests.monitor.health.cycles import FLOW, LEVEL, health, noise, of_error, simulated


@pytest.mark.parametrize("cycle_time", [6, 9, 15.5, 20.6, 21, 40, 83, 84, 300, 1000, 2500])
@pytest.mark.parametrize("ratio", [1.5, 20.0])
def test_a_sine_is_found_with_its_period(cycle_time, ratio):
    """From six samples to thousands, in noise up to two thirds of its amplitude; at gaps between two levels too."""
    n = 20_000 if cycle_time < 1000 else 100_000
    e = ratio * np.sin(2 * np.pi * np.arange(n) / cycle_time) + noise(n)
    found = of_error(e, 2.0)
    assert found.oscillating
    assert found.oscillation_period == pytest.approx(2.0 * cycle_time, rel=0.02)
    assert found.oscillation_regularity is not None
    assert found.oscillation_regularity > 0.75


def test_an_oscillation_is_found_after_some_cycles():
    """Not in four, but in fifteen."""
    e = np.sin(2 * np.pi * np.arange(300) / 20) + 0.1 * noise(300)
    assert not of_error(e[:70]).oscillating
    assert of_error(e).oscillating


def test_an_oscillation_on_a_ramp_and_an_offset_is_found():
    """The trend of each block is taken away."""
    t = np.arange(5000)
    found = of_error(40 + 0.01 * t + np.sin(2 * np.pi * t / 50) + 0.3 * noise(5000))
    assert found.oscillation_period == pytest.approx(50, rel=0.02)


@pytest.mark.parametrize("n", [300, 1000, 5000, 30_000])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "kind", ["white", "walk", "double walk", "lag", "long lag", "ramp", "walk in noise", "constant", "damped"]
)
def test_what_does_not_swing_on_is_no_oscillation(kind, seed, n):
    """Noise of any colour, walks, ramps; a resonance as damped as that of a loop with Ms 1.6."""
    w = noise(n, seed)
    damped = np.exp(-0.4 * 2 * np.pi / 30)
    e = {
        "white": w,
        "walk": np.cumsum(w),
        "double walk": np.cumsum(np.cumsum(w)),
        "lag": lfilter([1], [1, -0.9], w),
        "long lag": lfilter([1], [1, -0.99], w),
        "ramp": 0.01 * np.arange(n) + 0.1 * w,
        "walk in noise": 0.3 * np.cumsum(w) + noise(n, seed + 100),
        "constant": np.zeros(n),
        "damped": lfilter([1], [1, -2 * damped * np.cos(0.92 * 2 * np.pi / 30), damped**2], w),
    }[kind]
    assert not of_error(e).oscillating


def test_decaying_responses_are_no_oscillation():
    """To a load step now and then; nor regular pulses."""
    t = np.arange(8000)
    ringing = np.exp(-(t % 1000) / 100) * np.sin(2 * np.pi * t / 40)
    assert not of_error(ringing + 0.02 * noise(8000)).oscillating
    pulses = (t % 200 < 12) - 1.0 * ((t + 100) % 200 < 12)
    assert not of_error(pulses + 0.02 * noise(8000)).oscillating


@pytest.mark.parametrize("plant", [LEVEL, FLOW])
def test_healthy_loops_do_not_oscillate(plant):
    """In noise, under a wandering load, with steps of the set point at irregular times, with regular ones."""
    irregular = Steps((900.0, 2050.0, 2600.0, 4700.0, 6300.0), (5.0, -5.0, 4.0, -8.0, 4.0))
    regular = Steps((200.0, 400.0), (5.0, -5.0), 400.0)
    for seed in range(3):
        assert not simulated(plant, noise=0.1, seed=seed).oscillating
        assert not simulated(plant, noise=0.1, wander=0.1, seed=seed).oscillating
        assert not simulated(plant, noise=0.1, wander=0.02, setpoint=irregular, seed=seed).oscillating
        assert not simulated(plant, noise=0.1, setpoint=regular, seed=seed).oscillating


def test_a_quantised_pv_that_flips_is_no_oscillation():
    """Between two neighbouring values."""
    pv = np.round(50.45 + 0.1 * np.sin(2 * np.pi * np.arange(4000) / 40) + 0.02 * noise(4000))
    assert not health(50.0, pv, 30.0 - 0.01 * np.cumsum(pv - 50.45)).oscillating


def test_an_error_that_alternates_is_undersampled():
    """Two samples a cycle; white noise is not."""
    assert health(
        50.0, 50 + np.cos(np.pi * 0.97 * np.arange(3000)) + 0.1 * noise(3000), 30 + noise(3000)
    ).undersampled
    assert not health(50.0, 50 + noise(3000), 30 - noise(3000)).undersampled


def test_the_cycle_in_an_exact_autocorrelation():
    """The shortest of all periods that fit, and how it fades."""
    lags = np.arange(ACF_LAGS)
    for period in (5.0, 7.3, 12.0, 20.0):
        found, strength, fading = cycle(np.cos(2 * np.pi * lags / period))
        assert found == pytest.approx(period, rel=0.02)
        assert strength == pytest.approx(1, abs=0.05)
        assert fading == pytest.approx(1, abs=0.05)
    half = 0.5 ** (lags / 12.0) * np.cos(2 * np.pi * lags / 12.0)
    assert cycle(half)[2] == pytest.approx(0.5, abs=0.03)
    assert cycle(np.cos(2 * np.pi * lags / 3.0))[0] == 0
    assert cycle(np.cos(2 * np.pi * lags / (2 * BLOCK_LENGTH)))[0] == 0
