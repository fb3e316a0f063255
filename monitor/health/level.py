"""One level of averaging of a loop's error: the autocorrelation on which its blocks vote, and its cycles (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit

from . import stiction
from .block import BLOCK_LENGTH, HORIZON_S, add_products
from .fields import clearing, halving

ACF_LAGS = 46
"""Lags kept: two of the longest cycles, and neighbours to interpolate."""
FULL_SHARE = 0.7
"""Least mean size of the error over its standard deviation in a block: 0.9 for a sine, 0.87 for a triangle, 0.8
for noise, 1 for a square; below 0.5 for the pulses that steps leave."""
QUARTER_SHARE = 0.25
"""Least energy of a quarter of a block over the mean quarter's: an oscillation that lasts is everywhere, a
response that decays is not."""
SMOOTH_ACF = 0.2
"""Autocorrelation at lag 1 below which a level shows noise, and its cycles are not followed: those in sight have 0.7
times their share of the variance."""

SUMS: list[Any] = [
    ("blocks", "f8"),  # full ones without a step of the set point
    ("votes", "f8"),  # those in which the error moves throughout
    ("power", "f8"),  # [PV^2] their variances
    ("acf", "f4", (ACF_LAGS,)),  # their autocorrelations, each 1 at lag 0
]
RUNNING: list[Any] = [
    ("carry", "f8"),  # [PV] errors that wait for the next level's average
    ("tainted", "i8"),  # whether the set point has stepped in the block that fills
]
KEPT: list[Any] = [
    ("block", "f4", (BLOCK_LENGTH,)),  # [PV] last averages of the error
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT, ("cycles", stiction.DTYPE)])

_decay = halving(SUMS)
_reset = clearing(RUNNING)
_forget = clearing([*SUMS, *RUNNING, *KEPT])


@jit
def decay(own):
    """Halve the sums, those over cycles too."""
    _decay(own)
    stiction.decay(own.cycles)


@jit
def reset(own):
    """Forget the block that fills and the cycle that runs."""
    _reset(own)
    stiction.reset(own.cycles)


@jit
def forget(own):
    """Forget all: the averages are of another length now."""
    _forget(own)
    stiction.forget(own.cycles)


@jit
def taint(own):
    """Leave out the block that fills and the cycle that runs: the set point has stepped."""
    own.tainted = 1
    stiction.reset(own.cycles)


@jit
def update(own, e, at):
    """Take in an average of the error [PV]; ``at``: its place in the block."""
    own.block[at] = e
    if own.acf[1] >= SMOOTH_ACF * own.votes:
        stiction.update(own.cycles, own.block, e, at)
    else:
        stiction.break_off(own.cycles)


@jit
def update_block(own, width, period):
    """Let a full block of averages of ``width`` samples, each of ``period`` [s], vote on the autocorrelation."""
    if own.tainted:
        own.tainted = 0
        return
    if own.blocks * BLOCK_LENGTH * width * period > HORIZON_S:
        decay(own)
    own.blocks += 1.0
    x = np.zeros(BLOCK_LENGTH + ACF_LAGS)
    energy = _without_trend(own.block, x)
    if not _lasts(x, energy):
        return
    own.votes += 1.0
    own.power += energy / BLOCK_LENGTH
    r = np.zeros(ACF_LAGS)
    add_products(x, r)
    for lag in range(ACF_LAGS):
        own.acf[lag] += BLOCK_LENGTH / energy * r[lag] / (BLOCK_LENGTH - lag)


@jit
def _without_trend(block, x):
    """Write a block without its mean and slope to ``x``; return its energy."""
    mean = slope = 0.0
    middle = 0.5 * (BLOCK_LENGTH - 1)
    for i in range(BLOCK_LENGTH):
        mean += block[i]
        slope += (i - middle) * block[i]
    mean /= BLOCK_LENGTH
    slope *= 12.0 / (BLOCK_LENGTH * (BLOCK_LENGTH * BLOCK_LENGTH - 1.0))
    energy = 0.0
    for i in range(BLOCK_LENGTH):
        x[i] = block[i] - mean - slope * (i - middle)
        energy += x[i] * x[i]
    # what is left of a constant or of a ramp is rounding
    return energy if energy > 1e-10 * BLOCK_LENGTH * (mean * mean + slope * slope) else 0.0


@jit
def _lasts(x, energy):
    """Whether the error moves all through the block, and to about the same extent."""
    if energy <= 0.0:
        return False
    total = 0.0
    least = energy
    for quarter in range(4):
        own = 0.0
        for i in range(quarter * BLOCK_LENGTH // 4, (quarter + 1) * BLOCK_LENGTH // 4):
            own += x[i] * x[i]
            total += abs(x[i])
        least = min(least, own)
    even = least >= 0.25 * QUARTER_SHARE * energy
    return even and total * total >= FULL_SHARE * FULL_SHARE * BLOCK_LENGTH * energy
