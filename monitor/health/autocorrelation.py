"""The autocorrelation of a loop's error at five levels of averaging, block by block (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .stiction import again, fade, fields, forget, track

LEVELS = 5
"""The samples, and averages over four steps of time, each four times the last and near a power of 4 seconds."""
SAME = 2.2
"""Factor by which the sample period must change for the levels to be laid out anew: one that wanders between two
values is no new one."""
BLOCK = 64
"""Averages in a block: three cycles of the longest period of a level. 4^3, so that one counter serves all levels."""
LAGS = 46
"""Lags kept: two of the longest cycles, and neighbours to interpolate."""
FULL = 0.7
"""Least mean size of the error over its standard deviation in a block: 0.9 for a sine, 0.87 for a triangle, 0.8
for noise, 1 for a square; below 0.5 for the pulses that steps leave."""
EVEN = 0.25
"""Least energy of a quarter of a block over the mean quarter's: an oscillation that lasts is everywhere, a
response that decays is not."""
SMOOTH = 0.2
"""Autocorrelation at lag 1 below which a level shows noise, and its cycles are not followed: those in sight have 0.7
times their share of the variance."""
HORIZON = 14 * 86400.0
"""Time after which sums are halved [s]: a loop is judged by its recent weeks."""

_f, _s, _i = np.float64, np.float32, np.int64
FIELDS = [
    ("clock", _f),
    ("spacing", _f),
    ("group", _i),
    ("taken", _i),
    ("filled", _i),
    ("grouped", _i),
    ("tainted", _i),
    ("carry", _f, (LEVELS,)),
    ("blocks", _f, (LEVELS,)),
    ("votes", _f, (LEVELS,)),
    ("power", _f, (LEVELS,)),
    ("acf", _s, (LEVELS, LAGS)),
    ("block", _s, (LEVELS, BLOCK)),
    *fields(LEVELS),
]
"""What is kept of a loop: about 3.6 kB, whatever its period."""


@jit
def space(h, period):
    """See that the levels suit the sample period [s]; samples are taken in every ``spacing`` then."""
    if h.taken & (BLOCK - 1) == 0 and not h.spacing / SAME <= period <= h.spacing * SAME:
        _divide(h, period)


@jit
def take(h, e):
    """Take in one sample."""
    _enter(h, 0, h.taken & (BLOCK - 1), e)
    h.taken += 1
    h.carry[0] += e
    h.filled += 1
    if h.filled < h.group:
        return
    n = h.grouped
    h.grouped = n + 1
    e = h.carry[0] / h.group
    h.carry[0] = 0.0
    h.filled = 0
    for k in range(1, LEVELS):
        _enter(h, k, n & (BLOCK - 1), e)
        h.carry[k] += e
        if n & 3 != 3:
            break
        e = 0.25 * h.carry[k]
        h.carry[k] = 0.0
        n >>= 2


@jit
def _enter(h, k, at, e):
    """Take an average into a level."""
    h.block[k, at] = e
    if h.acf[k, 1] >= SMOOTH * h.votes[k]:
        track(h, k, e, at)
    else:
        h.wave_at[k] = -1
    if at == BLOCK - 1:
        _weigh(h, k)


@jit
def _divide(h, period):
    """Lay the levels out for a sample period [s]: at any, they are near powers of 4 s, from two to four samples on."""
    best = 10.0
    for many in (4, 3, 2):
        exponent = np.log(many * period) / np.log(4.0)
        off = abs(exponent - np.floor(exponent + 0.5))
        if off < best - 1e-9:
            best = off
            h.group = many
    h.spacing = period
    _empty(h)
    h.blocks[:] = 0.0
    h.votes[:] = 0.0
    h.power[:] = 0.0
    h.acf[:] = 0.0
    forget(h)


@jit
def width(h, k):
    """Return the samples in an average of a level."""
    return 1.0 if k == 0 else h.group * 4.0 ** (k - 1)


@jit
def restart(h):
    """Begin all blocks anew, after a gap or a change of mode."""
    _empty(h)
    h.clock = 0.0
    again(h)


@jit
def _empty(h):
    """Forget the blocks and averages that are not full."""
    h.taken = h.filled = h.grouped = 0
    h.tainted = 0
    h.carry[:] = 0.0


@jit
def taint(h):
    """Leave out the blocks now open at every level: the set point has stepped."""
    h.tainted = (1 << LEVELS) - 1
    again(h)


@jit
def _weigh(h, k):
    """Let a full block vote on its level's autocorrelation."""
    if h.tainted >> k & 1:
        h.tainted -= 1 << k
        return
    if h.blocks[k] * BLOCK * width(h, k) * h.spacing > HORIZON:
        fade(h, k)
        h.blocks[k] *= 0.5
        h.votes[k] *= 0.5
        h.power[k] *= 0.5
        for lag in range(LAGS):
            h.acf[k, lag] *= 0.5
    h.blocks[k] += 1.0
    x = np.zeros(BLOCK + LAGS)
    energy = _without_trend(h.block[k], x)
    if not _lasts(x, energy):
        return
    h.votes[k] += 1.0
    h.power[k] += energy / BLOCK
    r = np.zeros(LAGS)
    products(x, r)
    for lag in range(LAGS):
        h.acf[k, lag] += BLOCK / energy * r[lag] / (BLOCK - lag)


@jit
def products(x, out):
    """Add the products of a block with itself, shifted by 0, 1, 2, ... samples; beyond the block ``x`` is zero."""
    for i in range(BLOCK):
        v, shifted = x[i], x[i : i + len(out)]
        for lag in range(len(out)):  # over lags the compiler takes eight at a time, over samples none
            out[lag] += v * shifted[lag]


@jit
def _without_trend(block, x):
    """Write a block without its mean and slope to ``x``; return its energy."""
    mean = slope = 0.0
    middle = 0.5 * (BLOCK - 1)
    for i in range(BLOCK):
        mean += block[i]
        slope += (i - middle) * block[i]
    mean /= BLOCK
    slope *= 12.0 / (BLOCK * (BLOCK * BLOCK - 1.0))
    energy = 0.0
    for i in range(BLOCK):
        x[i] = block[i] - mean - slope * (i - middle)
        energy += x[i] * x[i]
    # what is left of a constant or of a ramp is rounding
    return energy if energy > 1e-10 * BLOCK * (mean * mean + slope * slope) else 0.0


@jit
def _lasts(x, energy):
    """Whether the error moves all through the block, and to about the same extent."""
    if energy <= 0.0:
        return False
    total = 0.0
    least = energy
    for quarter in range(4):
        own = 0.0
        for i in range(quarter * BLOCK // 4, (quarter + 1) * BLOCK // 4):
            own += x[i] * x[i]
            total += abs(x[i])
        least = min(least, own)
    return least >= 0.25 * EVEN * energy and total * total >= FULL * FULL * BLOCK * energy
