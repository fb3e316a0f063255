"""What is seen of the measurement: noise, quantum, rest, compression, sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.monitor.health.tools import N, health, noise


@pytest.mark.parametrize("sigma", [1e-6, 0.1, 1e6])
def test_white_noise_is_measured_and_other_noise_is_not(sigma):
    """Within 5 %; a random walk and a fast lag have no white noise to speak of."""
    assert health(0.0, sigma * noise(), 30 + noise(seed=1)).noise == pytest.approx(sigma, rel=0.05)
    assert health(0.0, sigma * np.cumsum(noise()), 30.0).noise is None
    assert health(0.0, sigma * lfilter([1], [1, -0.8], noise()), 30.0).noise is None


def test_noise_is_that_of_the_quiet_time():
    """A few large steps of PV do not raise it."""
    pv = 50 + 0.1 * noise() + 20 * (np.arange(N) % 1000 > 500)
    assert health(50.0, pv, 30.0).noise == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("step", [0.25, 0.1, 1 / 3, 100 / 4096])
def test_the_transmitters_step_is_found(step):
    """Whatever its size, from doubles and from single precision."""
    pv = np.round((50 + 3 * step * noise()) / step) * step
    assert health(50.0, pv, 30.0).quantum == pytest.approx(step, rel=1e-3)
    assert health(50.0, pv.astype(np.float32), 30.0).quantum == pytest.approx(step, rel=1e-3)


def test_one_odd_value_does_not_hide_the_transmitters_step():
    """Nor does it make of a coarse PV that dwells a compressed one."""
    pv = np.round((50 + 0.5 * noise()) / 0.5) * 0.5
    pv[300] += 0.11
    found = health(50.0, pv, 30 - noise())
    assert found.quantum == pytest.approx(0.5, rel=1e-3)
    assert found.compression == 0


@pytest.mark.parametrize("first", [0.01, 0.1])
def test_a_short_first_interval_is_no_compression(first):
    """An export begins with its boundary's value."""
    time = np.r_[0.0, first + np.arange(799)]
    assert health(50.0, 50 + noise(800), 30 - noise(800), time=time).compression == pytest.approx(0, abs=0.02)


def test_a_dead_time_is_no_frozen_pv():
    """At the start of a short record without noise; a PV that stays frozen is one."""
    t = np.arange(700)
    op = 30 + 0.01 * np.maximum(t - 100, 0)
    assert not health(50.0, 50 + 0.01 * np.maximum(t - 180, 0), op).stuck
    assert health(50.0, 50.0, op).stuck


def test_a_pv_without_steps_has_none():
    """Nor one whose steps are those of single precision, far below its noise."""
    assert health(50.0, 50 + noise(), 30.0).quantum is None
    assert health(50.0, (50 + noise()).astype(np.float32), 30.0).quantum is None


def test_frozen_idle_and_coarse_are_told_apart():
    """PV rests while OP moves: stuck. All rest: idle. A coarse PV dwells: neither."""
    frozen = np.r_[50 + noise(1500), np.full(1500, 50.3)]
    assert health(50.0, frozen, 30 + np.cumsum(0.1 * noise())).stuck
    assert not health(50.0, frozen, 30 + np.cumsum(0.1 * noise())).idle
    assert health(50.0, np.full(N, 49.0), 30.0).idle
    assert not health(50.0, np.full(N, 49.0), 30.0).stuck
    slow = np.round(50 + 2 * np.sin(np.arange(N) / 300))
    coarse = health(50.0, slow, 30 + np.cumsum(0.01 * (50 - slow)))
    assert not coarse.stuck
    assert not coarse.idle
