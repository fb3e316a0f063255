"""Whether OP takes two values nearly always: a relay, or pulse width, is recorded in place of a demand."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import median_of, quantile_of, range_of
from monitor.compiled import jit

LEAST_SAMPLES = 50
"""Without which nothing is said."""
LEVEL_SHARE = 0.05
"""Of the way between both levels: noise up to which a sample is at one of them."""
SWITCH_SAMPLES = 2
"""Samples on the way from one level to the other, that ramps and averages leave: they do not count against it."""
LEAST_SWITCHES = 6
"""A few moves of a set point, or of an operator, leave OP at two values, too."""
LEAST_LEVEL_SHARE = 0.02
"""Of the time, at each of the levels."""
TWO_SHARE = 0.97
"""Of the samples at two levels, or between them while it switches, from which on OP is two-valued: a controller that
saturates both ways spends more on its ways."""
LEAST_SWING_SHARE, LEAST_SWING = 0.1, 1.0 - 1e-6
"""Of the larger level, and [OP], what lies between them at least: OP in coarse steps wavers between two neighbours.
One OP is all of an output that is logged from 0 to 1."""
EDGE_SHARE = 0.005
"""Of the samples at either end that are none of the levels, for outliers."""


def two_valued(op: NDArray[np.float64]) -> float | None:
    """Return the share of samples at the two levels; None where OP is not two-valued, or samples are too few.

    Parameters
    ----------
    op : array (N,)
        In order, NaN where missing [OP].
    """
    share = float(_share_of_two(op))
    return None if math.isnan(share) else share


@jit
def _share_of_two(op):
    """Return the share of samples at two levels, NaN where there are no such."""
    x = op[np.isfinite(op)]
    if len(x) < LEAST_SAMPLES or range_of(x) < LEAST_SWING:
        return np.nan
    moved = x.copy()
    low, high = quantile_of(moved, EDGE_SHARE), quantile_of(moved, 1.0 - EDGE_SHARE)
    if high - low < LEAST_SWING:
        return np.nan
    middle = 0.5 * (low + high)
    below, above = median_of(x[x <= middle]), median_of(x[x > middle])
    swing = above - below
    if swing < max(LEAST_SWING, LEAST_SWING_SHARE * max(abs(below), abs(above))):
        return np.nan
    at = at_upper = switches = passed = 0
    last, was_upper = -1, False
    for i in range(len(x)):
        upper = x[i] > middle
        if abs(x[i] - (above if upper else below)) > LEVEL_SHARE * swing:
            continue
        if at > 0 and upper != was_upper:
            switches += 1
            passed += i - last - 1 if i - last - 1 <= SWITCH_SAMPLES else 0
        at += 1
        at_upper += upper
        last, was_upper = i, upper
    share = at_upper / at if at > 0 else 0.0
    if not LEAST_LEVEL_SHARE <= share <= 1.0 - LEAST_LEVEL_SHARE:
        return np.nan
    if switches < LEAST_SWITCHES or at + passed < TWO_SHARE * len(x):
        return np.nan
    return at / len(x)
