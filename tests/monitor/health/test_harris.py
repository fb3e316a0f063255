"""The Harris index: against minimum variance, withheld without its conditions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from monitor.health.harris import least_shares
from tests.monitor.health.tools import health, noise


@pytest.mark.parametrize(("delay", "index"), [(1, 0.19), (2, 0.344), (3, 0.469), (5, 0.651)])
def test_minimum_variance_of_a_first_order_error(delay, index):
    """AR(1) with 0.9: 1 - 0.9^(2 b)."""
    e = lfilter([1], [1, -0.9], noise(40_000))
    assert health(50.0, 50 - e, 30 + e, dead_time=float(delay)).harris == pytest.approx(index, abs=0.02)
    assert health(50.0, 50 - e, 30 + e, dead_time=delay * 5.0, period=5.0).harris == pytest.approx(
        index, abs=0.02
    )


def test_the_index_is_withheld_without_its_conditions():
    """Unknown, unresolved or too long a dead time; too little data; a PV of a few steps."""
    e = lfilter([1], [1, -0.9], noise(5000))
    assert health(50.0, 50 - e, 30 + e).harris is None
    for dead_time in (0.2, 35.0):
        assert health(50.0, 50 - e, 30 + e, dead_time=dead_time).harris is None
    assert health(50.0, 50 - e[:500], 30 + e[:500], dead_time=2.0).harris is None
    assert health(50.0, np.round((50 - e) / 10) * 10, 30 + e, dead_time=2.0).harris is None


def test_a_trend_can_be_foretold():
    """Its autocovariance, from blocks, is no positive definite one: the share is nothing, and not everything."""
    assert least_shares(np.linspace(1.0, 1.2, 30), 5).max() == 0.0
