"""The error in routine operation: its size, how long it lasts, and from which dead time on it cannot be smaller."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from monitor.health.harris import least_shares
from monitor.health.regulation import LITTLE_GAIN_SHARE, Regulation
from tests.monitor.health.tools import Array, health, noise


def routine(e: Array, **facts: float) -> Regulation | None:
    return health(50.0, 50 - e, 30 + e, **facts).regulation


def first_order(tau: float, n: int = 20_000, period: float = 1.0) -> Array:
    """An error of standard deviation 1 whose autocorrelation falls to 1/e in ``tau`` [s]."""
    phi = math.exp(-period / tau)
    return math.sqrt(1 - phi * phi) * lfilter([1], [1, -phi], noise(n))


@pytest.mark.parametrize("period", [1.0, 5.0])
@pytest.mark.parametrize("tau", [12.0, 30.0, 100.0, 400.0])
def test_how_long_an_error_lasts(tau, period):
    """Beyond the lags kept of the samples it is seen at the levels of averaging."""
    found = routine(first_order(tau * period, 40_000, period), period=period)
    assert found is not None
    assert found.memory == pytest.approx(tau * period, rel=0.3)
    assert found.error_sd == pytest.approx(1.0, rel=0.15)
    assert found.cycle is None


def test_noise_does_not_shorten_it():
    """White noise on top as large as the error itself."""
    found = routine(first_order(20.0, 40_000) + noise(40_000, 1))
    assert found is not None
    assert found.memory == pytest.approx(20.0, rel=0.25)


@pytest.mark.parametrize("period", [1.0, 10.0])
def test_from_which_dead_time_on_there_is_nothing_to_gain(period):
    """AR(1) with 0.9: the least share 1 - 0.9^(2 b) reaches 0.72 at b = 7 samples (0.77; at 6 it is 0.718)."""
    found = routine(first_order(-period / math.log(0.9), 40_000, period), period=period)
    assert found is not None
    assert found.tight_from / period in {6.0, 7.0}


def test_white_noise_leaves_nothing_to_gain():
    found = routine(noise(3000))
    assert found is not None
    assert found.tight_from == 0.0


def test_a_wandering_error_is_not_seen_to_die():
    """Nor is there a dead time that would excuse it."""
    found = routine(first_order(1e5, 3000))
    assert found is None or (math.isinf(found.memory) and math.isinf(found.tight_from))
    assert found is None or found.seen > 20.0


def test_a_cycle_comes_back():
    """Every three samples, as of a fast loop that is recorded too slowly."""
    t = np.arange(3000)
    found = routine(np.sin(2 * np.pi * t / 3.0) + 0.2 * noise())
    assert found is not None
    assert found.cycle is not None
    assert found.cycle % 3.0 == 0.0


def test_what_the_data_cannot_carry():
    """Too little of it; an error that does not move; a dead time that is known: the Harris index says it then."""
    e = first_order(10.0, 3000)
    assert routine(e[:400]) is None
    assert routine(np.zeros(3000)) is None
    assert health(50.0, 50 - e, 30 + e, dead_time=3.0).regulation is None
    assert routine(np.where(np.arange(3000) == 70, np.nan, e)) is not None


def test_least_shares_grow_with_the_dead_time():
    """Of AR(1) with 0.9: 1 - 0.9^(2 b)."""
    shares = least_shares(0.9 ** np.arange(30), 10)
    np.testing.assert_allclose(shares, 1 - 0.9 ** (2 * np.arange(1, 11)), rtol=1e-6)
    assert 0.0 < LITTLE_GAIN_SHARE < 1.0
