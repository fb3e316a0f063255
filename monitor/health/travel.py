"""How far the controller's output goes beyond its own noise, and how often it turns: the same at any sampling.

Noise makes path: the more samples, the more. So OP is averaged over 1, 2, 4, ... times a grid of time, and its path is
counted at each of these levels at once, behind a deadband as wide as the noise. Which level to believe is decided when
the figure is read: that in which OP's own movement, beyond the noise, has just become visible. Half the mean square of
the difference of neighbouring averages (D. W. Allan, Proc. IEEE 54 (1966) 221-230) tells: white noise has its variance
over the number of samples there; the rest is movement, whatever the sampling. The choice of the level, and the
deadband, are derived.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from monitor.compiled import jit, jit_inlined

from . import path
from .fields import clearing, halving
from .variance_jump import VARIANCE_JUMP_BLOCKS, blocks_in_jump, clipped

PATH_LEVELS = 14
"""Levels, each twice as long as the one before: 1 s to 2.3 hours for samples of 1 s."""
GRID_PERIODS = 0.9
"""Sample periods below which the finest level may not lie: it is the next power of two seconds."""
NEW_GRID_SHARE = 0.6
"""Difference between sample period and grid, as a share, from which on the levels begin anew."""
EARLY_PERIODS = 0.25
"""Sample periods by which a sample may come early and still end an average: they are never quite in time."""
FIRST_SAMPLES = 16
"""Samples after which a first guess at OP's noise is made."""
SEEN_SD, SEEN_SHARE = 2.0, 0.3
"""Level to believe: where OP moves this many standard deviations of its noise, or where its movement reaches this share
of the most at any level, whichever is shorter. The averages take about 5 % off a cycle then."""
TELLING_RATIO = 0.3
"""Movement over noise, as variances, from which on a level tells of the movement."""
AT_REST_RATIO = 0.2
"""Movement at its most, in variances of the noise, below which OP is at rest but for single moves."""
SWING_SD = 4.5
"""Standard deviations of the noise in a swing, on average, below which it is chance what counts as path."""
FEW_TURNS = 15.0
"""Turns below which it takes swings twice as large."""
LEAST_DIFFERENCES = 32
"""Differences of averages without which a level says nothing."""

NOISE_SUMS: list[Any] = [  # over blocks of 64 samples
    ("log_variance", "f8"),  # ln of the mean square of second differences [ln OP^2]
    ("acf_1", "f8"),  # autocorrelation of second differences at lag 1
    ("blocks", "f8"),
]
SUMS: list[Any] = [
    *NOISE_SUMS,
    ("time", "f8"),  # [s] in automatic, over which the path was counted
]
RUNNING: list[Any] = [
    ("squares", "f8"),  # [OP^2] second differences of the block that fills, squared
    ("products_1", "f8"),  # [OP^2] times the one before
    ("change", "f8"),  # [OP] last difference
    ("bend", "f8"),  # [OP] last second difference
    ("clock", "f8"),  # [s] into the finest average
    ("sum", "f8"),  # [OP] of the samples in it
    ("count", "f8"),  # samples in it
    ("averages", "i8"),  # of the finest level since the last break
]
KEPT: list[Any] = [
    ("noise", "f8"),  # [OP] standard deviation
    ("noise_known", "i8"),  # whether there is a first guess at it
    ("jump", "f8"),  # blocks in a row with too large a variance
    ("grid", "f8"),  # [s] finest average
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT, ("levels", path.DTYPE, (PATH_LEVELS,))])

_decay = halving(SUMS)
_forget_noise = clearing(NOISE_SUMS)
reset = clearing(RUNNING)


@jit
def decay(own):
    """Halve the sums, those of each level too."""
    _decay(own)
    for k in range(PATH_LEVELS):
        path.decay(own.levels[k])


@jit_inlined
def update(own, before, op, dt, period, samples):
    """Take in one sample in automatic.

    Parameters
    ----------
    before, op
        OP of the last sample and of this one [OP].
    dt
        Time between them [s].
    period
        Sample period [s], 0 before it is known.
    samples
        So far in automatic.
    """
    d = op - before
    dd = d - own.change
    own.squares += dd * dd
    own.products_1 += dd * own.bend
    own.change, own.bend = d, dd
    if period <= 0.0:
        return
    if abs(own.grid - period) > NEW_GRID_SHARE * own.grid:
        own.grid = 2.0 ** np.ceil(np.log2(GRID_PERIODS * period))
        _forget_path(own)
    if own.noise_known == 0 and samples >= FIRST_SAMPLES:
        own.noise = 0.5 * np.sqrt(max(-own.products_1 / FIRST_SAMPLES, 0.0))
        own.noise_known = 1
    if own.noise_known:
        own.time += dt
    own.sum += op
    own.count += 1.0
    own.clock += dt
    edge = own.grid - EARLY_PERIODS * period
    while own.clock >= edge:
        own.clock -= own.grid
        if own.count > 0.0:
            _add(own, own.sum / own.count, period)
            own.sum = own.count = 0.0
        else:
            _add(own, op, period)


@jit
def _forget_path(own):
    """Forget the path so far: another grid, or another noise."""
    own.time = 0.0
    for k in range(PATH_LEVELS):
        path.forget(own.levels[k])
    reset(own)


@jit
def _add(own, y, period):
    """Take in an average of the finest level, and those that it completes."""
    n = own.averages
    own.averages = n + 1
    share = min(period / own.grid, 1.0)
    for k in range(PATH_LEVELS):
        level = own.levels[k]
        before = level.last
        level.last = y
        if n > 0:
            level.squares += (y - before) * (y - before)
            level.differences += 1.0
        if n == 0 or own.noise_known == 0:
            path.begin(level, y)
        else:
            path.update(level, y, own.noise, np.sqrt(share) * own.noise)
        if n & 1 == 0:
            return
        y = 0.5 * (before + y)
        n >>= 1
        share *= 0.5


@jit
def update_block(own, n):
    """Learn OP's noise from the second differences of a block of ``n`` samples.

    Their autocovariance at lag 1 is -4 sigma^2 for white noise, and positive for what moves smoothly.
    """
    q0, q1 = own.squares / n, own.products_1 / n
    own.squares = own.products_1 = 0.0
    if q0 <= 0.0:
        return
    variance = np.log(q0)
    own.jump = blocks_in_jump(own.jump, variance, own.log_variance, own.blocks, counts=True)
    if own.jump >= VARIANCE_JUMP_BLOCKS:
        own.jump = 0.0
        _forget_noise(own)
        _forget_path(own)
    own.log_variance += clipped(variance, own.log_variance, own.blocks)
    own.blocks += 1.0
    own.acf_1 += q1 / q0
    white = max(-own.acf_1 / own.blocks, 0.0) * np.exp(own.log_variance / own.blocks)
    own.noise = 0.5 * np.sqrt(white)


def noise_of(own: Any) -> float | None:
    """Return the standard deviation of OP's white noise [OP], None before a block is full."""
    return float(own["noise"]) if own["blocks"] > 0 else None


def travel_of(own: Any, period: float, never_moved: bool) -> tuple[float | None, float | None]:
    """Return path [OP/h] and reversals [1/h] of OP, of swings of more than three standard deviations of its noise.

    Zero for an OP that hardly leaves its noise. None before the noise is known, and where most swings are about as
    large as the noise: chance decides then which of them count.

    Parameters
    ----------
    own
        A loop's sums.
    period
        Sample period [s].
    never_moved
        Whether OP has been the same for long: its noise is never known then.
    """
    if own["time"] <= 0.0:
        return (0.0, 0.0) if never_moved else (None, None)
    levels = own["levels"]
    known = levels[levels["differences"] >= LEAST_DIFFERENCES]
    if levels["differences"][0] < LEAST_DIFFERENCES:
        return None, None
    sigma = float(own["noise"])
    noise = sigma**2 * np.minimum(period / float(own["grid"]), 1.0) * 0.5 ** np.arange(len(known))
    movement = 0.5 * known["squares"] / known["differences"] - noise
    level = _level_to_believe(movement, noise, sigma)
    moved, turns = (float(np.interp(level, np.arange(PATH_LEVELS), levels[n])) for n in ("path", "turns"))
    swing = SWING_SD * sigma if turns >= FEW_TURNS else 2.0 * SWING_SD * sigma
    if moved < swing * max(turns, 1.0):
        rests = max(movement) < AT_REST_RATIO * sigma**2
        return (0.0, 0.0) if rests else (None, None)
    hours = float(own["time"]) / 3600.0
    return moved / hours, turns / hours


def _level_to_believe(movement: Any, noise: Any, sigma: float) -> float:
    """Return it, between two levels where need be; ``movement``, ``noise``: variances at each level."""
    most = int(np.argmax(movement))
    if movement[most] < AT_REST_RATIO * sigma**2:
        return float(most)
    visible = min(0.5 * SEEN_SD**2 * sigma**2, SEEN_SHARE * _peak(movement, most))
    k = int(np.argmax((movement >= visible) & (movement > TELLING_RATIO * noise)))
    if k == 0:
        return 0.0
    if movement[k - 1] > TELLING_RATIO * noise[k - 1]:
        return k - math.log(movement[k] / visible) / math.log(movement[k] / movement[k - 1])
    # what moves smoothly: by the square of the time
    return k - min(0.5 * math.log2(movement[k] / visible), 1.0)


def _peak(movement: Any, most: int) -> float:
    """Return the top of a parabola through the largest value and its neighbours, all logarithmic."""
    around = movement[max(most - 1, 0) : most + 2]
    if len(around) < 3 or min(around) <= 0.0:
        return float(movement[most])
    a, b, c = (math.log(v) for v in around)
    bend = a - 2.0 * b + c
    return math.exp(b - (a - c) ** 2 / (8.0 * bend)) if bend < 0.0 else math.exp(b)
