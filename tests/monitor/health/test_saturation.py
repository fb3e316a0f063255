"""Time at a limit, known or seen."""

from __future__ import annotations

import numpy as np
import pytest

from tests.monitor.health.tools import N, health, noise


def test_saturation_with_known_limits_is_time_at_them():
    """At or beyond either."""
    op = np.clip(30 + 20 * np.sin(np.arange(N) / 40), 15, 45)
    share = float(np.mean((op <= 15) | (op >= 45)))
    assert health(50.0, 50 + noise(), op, op_low=15.0, op_high=45.0).saturation == pytest.approx(
        share, abs=0.01
    )
    assert health(50.0, 50 + noise(), op, op_low=0.0, op_high=100.0).saturation == 0


def test_saturation_without_limits_is_rest_at_own_extremes():
    """Where OP rests exactly; a coarse OP that dwells at two values, or one that never rests, is not saturated."""
    op = np.clip(30 + 20 * np.sin(np.arange(N) / 40), 15, 45)
    share = float(np.mean((op <= 15) | (op >= 45)))
    assert health(50.0, 50 + noise(), op).saturation == pytest.approx(share, abs=0.02)
    assert health(50.0, 50 + noise(), 30 + noise()).saturation == 0
    coarse = np.round(30 + np.sin(np.arange(N) / 40))
    assert health(50.0, 50 + noise(), coarse).saturation == 0


def test_an_output_that_rests_while_the_error_moves_is_held():
    """From 200 samples on; not if it is at its limit."""
    e = np.cumsum(0.1 * noise())
    assert health(50.0, 50 - e, 30.0).held == pytest.approx(1, abs=0.1)
    assert health(50.0, 50 - e, 100.0, op_high=100.0).held == 0
    assert health(50.0, 50 - e, 30 + e).held == 0
