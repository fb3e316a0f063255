"""Where loops stand in the picture of a fleet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from monitor.contract.fleet import (
    BOTTOM,
    CI_TICKS,
    HEIGHT,
    LEFT,
    MS_TICKS,
    RIGHT,
    TOP,
    WIDTH,
    across,
    ci_and_ms,
    down,
)
from monitor.contract.records import LoopRow


def test_the_axes_are_logarithmic_and_end_at_the_margins() -> None:
    """Twice the index is the same way wherever it starts; what lies beyond stands at the edge."""
    ends = across(np.array([CI_TICKS[0], CI_TICKS[-1], 0.0, 9.0]))
    np.testing.assert_allclose(ends, [LEFT, WIDTH - RIGHT, LEFT, WIDTH - RIGHT])
    np.testing.assert_allclose(down(np.array([MS_TICKS[0], math.inf])), [HEIGHT - BOTTOM, TOP])
    assert across(0.4) - across(0.2) == pytest.approx(across(0.1) - across(0.05))
    assert np.isnan(across(math.nan))


def test_who_has_a_place() -> None:
    """The lower index counts; an unstable loop, whose Ms JSON cannot hold, stands at the top."""
    assert ci_and_ms(LoopRow(loop="a", ci_setpoint=0.5, ci_load=0.3, ms=1.5)) == (0.3, 1.5)
    assert ci_and_ms(LoopRow(loop="a", ci_setpoint=0.5, flags=("near_instability",))) == (0.5, math.inf)
    assert ci_and_ms(LoopRow(loop="a", ci_setpoint=0.5)) is None
    assert ci_and_ms(LoopRow(loop="a", ms=1.5)) is None
