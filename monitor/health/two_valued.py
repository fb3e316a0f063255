"""Whether OP takes two values nearly always: a relay, or pulse width, is recorded in place of a demand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.median import median

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
    x = op[np.isfinite(op)]
    if len(x) < LEAST_SAMPLES:
        return None
    low, high = np.quantile(x, [EDGE_SHARE, 1.0 - EDGE_SHARE])
    if high - low < LEAST_SWING:
        return None
    upper = x > 0.5 * (low + high)
    levels = median(x[~upper]), median(x[upper])
    swing = levels[1] - levels[0]
    if swing < max(LEAST_SWING, LEAST_SWING_SHARE * max(abs(levels[0]), abs(levels[1]))):
        return None
    at = np.flatnonzero(np.abs(x - np.where(upper, levels[1], levels[0])) <= LEVEL_SHARE * swing)
    side = upper[at]
    if not LEAST_LEVEL_SHARE <= float(np.mean(side)) <= 1.0 - LEAST_LEVEL_SHARE:
        return None
    switches = side[1:] != side[:-1]
    between = np.diff(at) - 1
    passed = int(between[switches & (between <= SWITCH_SAMPLES)].sum())
    if int(switches.sum()) < LEAST_SWITCHES or len(at) + passed < TWO_SHARE * len(x):
        return None
    return len(at) / len(x)
