"""The error's mean, and an offset that never goes away."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from monitor.health import offset
from tests.monitor.health.tools import health, noise


def test_a_permanent_offset_is_one_that_never_goes_away():
    """On one side for good, and more than noise; a wandering error and a small bias are none."""
    assert health(50.0, 47 + noise(), 30.0).settled_offset
    assert health(50.0, 47 + noise(), 30.0).offset == pytest.approx(3.0, abs=0.1)
    assert not health(50.0, 50.2 + noise(), 30.0).settled_offset
    wander = 50 + lfilter([1], [1, -0.98], noise())
    assert not health(50.0, wander, 30.0).settled_offset


def test_an_offset_takes_ten_blocks():
    """And more than the noise or the quantum of PV."""
    own = np.zeros(1, offset.DTYPE)[0]
    for _ in range(9):
        offset.update_block(own, np.full(64, 3.0, np.float32))
    assert not offset.is_permanent(own, 0.0)
    offset.update_block(own, np.full(64, 3.0, np.float32))
    assert offset.is_permanent(own, 5.9)
    assert not offset.is_permanent(own, 6.1)
