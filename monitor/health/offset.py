"""The error's mean and mean size in automatic, and whether it stays off zero for good."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from monitor.compiled import jit, jit_inlined

from .fields import halving

PERMANENT_SD = 2.0
"""Mean error over the standard deviation of its means over 64 samples, from which on it never goes away."""
NOTABLE_SD = 0.5
"""Least permanent offset, in standard deviations of noise or steps of PV."""
OFFSET_BLOCKS = 10.0
"""Blocks without which an offset is not called permanent."""

SUMS: list[Any] = [
    ("size", "f8"),  # [PV s] integral of the error's size
    ("error", "f8"),  # [PV s] integral of the error
    ("blocks", "f8"),  # blocks of 64 samples without a step of the set point
    ("means", "f8"),  # [PV] sum of their mean errors
    ("mean_squares", "f8"),  # [PV^2] and of these squared
]
RUNNING: list[Any] = []
KEPT: list[Any] = []
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)


@jit_inlined
def update(own, e, dt):
    """Take in the error ``e`` [PV] that held for ``dt`` [s] in automatic."""
    own.size += abs(e) * dt
    own.error += e * dt


@jit
def update_block(own, block):
    """Take in a block of errors [PV] in which the set point has not stepped."""
    mean = 0.0
    for e in block:
        mean += e
    mean /= len(block)
    own.blocks += 1.0
    own.means += mean
    own.mean_squares += mean * mean


def offset_of(own: Any, auto_time: float) -> float:
    """Return the mean error [PV] over the time in automatic [s]."""
    return float(own["error"]) / auto_time


def mean_size_of(own: Any, auto_time: float) -> float:
    """Return the mean size of the error [PV] over the time in automatic [s]."""
    return float(own["size"]) / auto_time


def is_permanent(own: Any, least: float) -> bool:
    """Whether the error's mean is far from zero for good: integral action would have brought it back.

    Parameters
    ----------
    own
        A loop's sums.
    least
        Standard deviation of PV's noise or its step, whichever is larger [PV].
    """
    n = float(own["blocks"])
    if n < OFFSET_BLOCKS:
        return False
    mean = float(own["means"]) / n
    spread = math.sqrt(max(float(own["mean_squares"]) / n - mean * mean, 0.0))
    return abs(mean) > max(PERMANENT_SD * spread, NOTABLE_SD * least) and mean != 0.0
