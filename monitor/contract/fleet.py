"""Where loops stand in the picture of a fleet: the closed-loop index against the peak sensitivity, on log axes."""

from __future__ import annotations

import math

import numpy as np

from .evidence import Floats
from .loops import Loop
from .records import LoopRow

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 940, 430, 52, 14, 14, 42
"""Of the picture and its margins [px]."""
CI_LOW, CI_HIGH, MS_LOW, MS_HIGH = 0.02, 2.0, 1.0, 10.0
"""Ends of the axes; what lies beyond is drawn at the edge."""
CI_TICKS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.6, 1.0, 2.0)
MS_TICKS = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
MS_MARGIN_RATIO = 1.25
"""Over `ms_max`, from which a loop is flagged."""
_USUAL = Loop(name="usual")
CI_LEAST, MS_MOST = _USUAL.ci_min, MS_MARGIN_RATIO * _USUAL.ms_max
"""Where a loop is flagged by the loop table's defaults: slow below, fragile above."""


def ci_and_ms(row: LoopRow) -> tuple[float, float] | None:
    """Return the lower of a loop's indices and its Ms, inf for a loop that is unstable; None where one is not known."""
    indices = [ci for ci in (row.ci_setpoint, row.ci_load) if ci is not None]
    if not indices or (row.ms is None and "near_instability" not in row.flags):
        return None
    return min(indices), math.inf if row.ms is None else row.ms  # JSON has no infinity


def across(ci: float | Floats) -> Floats:
    """Return how far to the right an index stands [px]."""
    share = np.log(np.clip(ci, CI_LOW, CI_HIGH) / CI_LOW) / math.log(CI_HIGH / CI_LOW)
    return LEFT + np.asarray(share) * (WIDTH - LEFT - RIGHT)


def down(ms: float | Floats) -> Floats:
    """Return how far down a peak sensitivity stands [px]."""
    share = np.log(np.clip(ms, MS_LOW, MS_HIGH) / MS_LOW) / math.log(MS_HIGH / MS_LOW)
    return HEIGHT - BOTTOM - np.asarray(share) * (HEIGHT - TOP - BOTTOM)
