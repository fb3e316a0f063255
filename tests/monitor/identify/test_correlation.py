"""How many residuals carry the information of one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from monitor.identify.correlation import correlation_time


def coloured(rho: float, seed: int, n: int = 20_000) -> NDArray[np.float64]:
    """A first-order process; white noise where ``rho`` is 0."""
    found = np.random.default_rng(seed).normal(size=n)
    for k in range(1, n):
        found[k] += rho * found[k - 1]
    return found


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("rho", "expected"), [(0.0, 1.0), (0.8, 9.0), (0.9, 19.0)])
def test_a_first_order_process(rho, expected, seed):
    """(1 + rho)/(1 - rho) within chance: 1 for white noise."""
    assert correlation_time(coloured(rho, seed)) == pytest.approx(expected, rel=0.15)


def test_how_large_residuals_are_does_not_matter():
    residual = coloured(0.8, 0, 2000)
    assert correlation_time(1e-6 * residual) == pytest.approx(correlation_time(residual), rel=1e-9)


def test_what_alternates_is_no_more_than_white():
    """One residual carries no more than its own information: what cancels is not counted on."""
    assert correlation_time(np.resize([1.0, -1.0], 200)) == 1.0


def test_of_no_residuals_each_carries_its_own():
    assert correlation_time(np.zeros(100)) == 1.0


def test_never_more_than_an_eighth_of_the_data():
    assert correlation_time(np.ones(80)) == 10.0
