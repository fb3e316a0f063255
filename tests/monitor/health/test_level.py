"""A level's blocks: which of them vote, and for what."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from monitor.health import level
from monitor.health.block import BLOCK_LENGTH, HORIZON_S

AT = np.arange(BLOCK_LENGTH)


def after(*blocks: Any, period: float = 1.0) -> Any:
    """A record after these blocks of averages, each of one sample."""
    own = np.zeros(1, level.DTYPE)[0]
    for block in blocks:
        for at, e in enumerate(block):
            level.update(own, float(e), at)
        level.update_block(own, 1.0, period)
    return own


def test_a_sine_votes_for_its_autocorrelation():
    """Whatever its size, and whatever ramp and offset lie below it."""
    for size in (0.1, 1.0, 1e6):
        own = after(size * (np.sin(2 * np.pi * AT / 8) + 5 + 0.1 * AT))
        assert own["votes"] == own["blocks"] == 1
        assert own["power"] == pytest.approx(0.5 * size**2, rel=0.02)
        assert own["acf"] == pytest.approx(np.cos(2 * np.pi * np.arange(level.ACF_LAGS) / 8), abs=0.05)


@pytest.mark.parametrize(
    "block", [np.zeros(BLOCK_LENGTH), 3.0 + 0.1 * AT, 1.0 * (AT == 20), np.exp(-AT / 5) * np.cos(AT)]
)
def test_what_does_not_move_throughout_has_no_vote(block):
    """Nothing, a ramp, a spike, a response that decays."""
    own = after(block)
    assert own["blocks"] == 1
    assert own["votes"] == 0


def test_a_block_with_a_step_of_the_set_point_is_left_out():
    """It alone."""
    own = after(np.cos(AT))
    level.taint(own)
    level.update_block(own, 1.0, 1.0)
    assert own["blocks"] == 1
    level.update_block(own, 1.0, 1.0)
    assert own["blocks"] == 2


def test_sums_are_halved_after_two_weeks():
    """The level's own: blocks of an hour."""
    n = int(HORIZON_S / 3600.0)
    own = after(*[np.cos(AT)] * (n + 1), period=3600.0 / BLOCK_LENGTH)
    assert own["blocks"] == n + 1
    own = after(*[np.cos(AT)] * (n + 2), period=3600.0 / BLOCK_LENGTH)
    assert own["blocks"] == own["votes"] == 0.5 * (n + 1) + 1
