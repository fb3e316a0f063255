"""The path behind a deadband, beside plain formulas."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from monitor.health import path

Array = Any


def along(y: Array, op_noise: float, noise: float) -> Any:
    """A record after these averages."""
    own = np.zeros(1, path.DTYPE)[0]
    path.begin(own, y[0])
    for v in y[1:]:
        path.update(own, v, op_noise, noise)
    return own


def test_without_noise_the_path_is_all_that_op_moves():
    """And it turns as often as its moves change sign."""
    y = np.cumsum(np.random.default_rng(0).normal(size=500))
    for n in range(2, len(y), 7):
        own = along(y[:n], 0.0, 0.0)
        moves = np.diff(y[:n])
        assert own["path"] == pytest.approx(abs(moves).sum())
        assert own["turns"] == (np.diff(np.sign(moves)) != 0).sum()


def test_swings_within_the_deadband_are_no_path():
    """One and a half standard deviations to either side, or three of what the average leaves."""
    swing = np.tile([0.0, 1.0, 0.0, -1.0], 50)
    assert along(1.49 * swing, 1.0, 0.0)["path"] == 0.0
    assert along(2.99 * swing, 0.0, 1.0)["path"] == 0.0
    assert along(3.01 * swing, 0.0, 1.0)["path"] > 0.0


@pytest.mark.parametrize("size", [5.0, 20.0])
def test_what_the_deadband_cuts_off_is_added_at_each_turn(size):
    """A clean swing much slower than its averages goes its full path, but for the deadband at its ends."""
    y = size * np.sin(2 * np.pi * np.arange(20_000) / 2000)
    own = along(y, 1.0, 0.0)
    assert own["turns"] == 20
    assert own["path"] == pytest.approx(4 * size * 10, abs=2 * 1.5)
