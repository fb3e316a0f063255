"""Whether a loop oscillates, for how long a time, and how regularly: the autocorrelation of its error, block by block.

The error is averaged over 1, about 4, 16, 64 and 256 samples, at any sampling over about the same times, so that its
period is the same; at each of these levels blocks of 64 averages are freed of
their trend and give their autocorrelation, as a share of their own variance: one block, one vote. Noise on top only
touches lag 0, a disturbance that passes touches one block. Averaged over the blocks, the autocorrelation of an
oscillation swings on without fading (T. Miao, D. E. Seborg, J. Process Control 9 (1999) 253-262; of the crossings of
the autocorrelation: N. F. Thornhill, B. Huang, H. Zhang, J. Process Control 13 (2003) 91-100); that of noise, of a
random walk or of a well-damped loop fades within a cycle. Levels and votes are our own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from monitor.detect.state import jit

from .stiction import CHANCE, FINE, LONG, again, fade, fields, forget, likeness, track

LEVELS = 5
"""The samples, and averages over four steps of time, each four times the last and near a power of 4 seconds."""
SAME = 2.2
"""Factor by which the sample period must change for the levels to be laid out anew: one that wanders between two
values is no new one."""
BLOCK = 64
"""Averages in a block: three cycles of the longest period of a level. 4^3, so that one counter serves all levels."""
SHORTEST, LONGEST = 4.7, 20.5
"""Averages in a cycle that a level looks for; four times the first is below the second: no period falls between."""
FINEST, STEP, GRID = 2.2, 1.03, 77
"""Periods tried: from the first on [level samples], by this factor, so many of them (to 21.8)."""
NEARLY = 0.8
"""A shorter period that swings this much of the best counts as the cycle, the best as its multiple."""
LAGS = 46
"""Lags kept: two of the longest cycles, and neighbours to interpolate."""
FULL = 0.7
"""Least mean size of the error over its standard deviation in a block: 0.9 for a sine, 0.87 for a triangle, 0.8
for noise, 1 for a square; below 0.5 for the pulses that steps leave."""
EVEN = 0.25
"""Least energy of a quarter of a block over the mean quarter's: an oscillation that lasts is everywhere, a
response that decays is not."""
LEAST, UNSURE = 0.25, 0.5
"""Least share of the variance that must swing with the cycle; and by how much noise alone may seem to in one block."""
FADED = 0.55
"""Error of the fading by one block: with few blocks a damped loop may seem to swing on."""
MOST_IDLE = 0.5
"""Least share of a level's blocks in which the error moves throughout."""
BETWEEN = 0.3
"""And at the next finer level, whose blocks hold one to three cycles."""
LEAST_CYCLES = 5.0
"""Least number of cycles in all blocks."""
SMOOTH = 0.2
"""Autocorrelation at lag 1 below which a level shows noise, and its cycles are not followed: those in sight have 0.7
times their share of the variance."""
ECHO = 0.12
"""Least share of the variance that must swing with cycles that are alike, though their autocorrelation fades."""
MANY_ALIKE = 12.0
"""And the least number of them."""
APART = 0.2
"""Difference between the mean length of uneven cycles and the autocorrelation's period above which neither is given."""
TELLING, ALTERNATES = 5.0, -0.6
"""Blocks, and autocorrelation at lag 1, from which the sampling is too coarse for what swings; differences of white
noise have -0.5."""
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


@jit
def cycle(acf):
    """Find the cycle in an averaged autocorrelation (1 at lag 0): the shortest period that nearly swings most.

    Every odd multiple of a period swings as much. Periods too short for the level are looked at, lest a multiple of
    one is taken for it.

    Returns
    -------
    period
        [level samples]; 0 where there is none, or not within the level's range.
    strength
        Share of the variance that swings with it, at a mean lag of 3/4 of a period.
    fading
        What is left of that one period later: 1 for a sustained oscillation.
    """
    score = np.empty(GRID + 2)
    best = 0.0
    for i in range(GRID + 2):
        p = FINEST * STEP**i
        score[i] = _swing(acf, 1.0, p) + _swing(acf, 2.0, p)
        best = max(best, score[i])
    for i in range(1, GRID + 1):
        low, mid, high = score[i - 1], score[i], score[i + 1]
        if mid >= NEARLY * best and mid >= low and mid > high:
            period = FINEST * STEP ** (i + 0.5 * (high - low) / max(2.0 * mid - low - high, 1e-12))
            if not SHORTEST <= period <= LONGEST:
                return 0.0, 0.0, 0.0
            strength = _swing(acf, 1.0, period)
            return period, strength, min(max(_swing(acf, 2.0, period) / max(strength, 1e-9), 0.0), 1.0)
    return 0.0, 0.0, 0.0


@jit
def _swing(acf, cycles, period):
    """Half the way from the trough before a number of cycles to the peak after them."""
    return 0.5 * (_at(acf, cycles * period) - _at(acf, (cycles - 0.5) * period))


@jit
def _at(acf, lag):
    """Autocorrelation between lags, by the cubic through four neighbours (Catmull-Rom)."""
    i = min(int(lag), LAGS - 3)
    t = lag - i
    a, b, c, d = acf[i - 1], acf[i], acf[i + 1], acf[i + 2]
    return b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))


@dataclass(frozen=True, slots=True)
class Oscillation:
    """The loop's strongest cycle."""

    period: float
    """[s], the autocorrelation's."""
    regularity: float
    """0 to 1: what is surely left of the autocorrelation after one more period; or, where that is more, how alike
    the cycles are in amplitude and length (a limit cycle that drifts in period, as that of a sticking valve)."""
    amplitude: float
    """Of the first harmonic [PV]."""
    level: int = 0
    """At which its cycles are seen best."""
    uneven: bool = False
    """Whether its cycles are of such lengths that their mean is another than the period: neither is to be relied on."""


def strongest(h: Any) -> Oscillation | None:
    """Return the strongest cycle of a loop's sums, regular or not; None without a clean block or without a cycle."""
    shown = _shown(h)
    seen = max((c.found for c in shown if c.clear), key=lambda found: found.amplitude, default=None)
    alike, at = max((_alike(h, k, seen), k) for k in range(LEVELS))
    if alike == 0.0:
        return seen
    if seen is not None and alike <= seen.regularity:
        return replace(seen, level=at)
    if seen is not None:
        uneven = abs(_mean_cycle(h, at) / seen.period - 1.0) > APART
        return replace(seen, regularity=alike, level=at, uneven=uneven)
    length = _mean_cycle(h, at)
    echoes = [c for c in shown if c.strength >= ECHO and 0.5 < c.found.period / length < 2.0]
    if not echoes or h["cycles"][at] < MANY_ALIKE:
        return None
    return replace(max(echoes, key=lambda c: c.strength).found, regularity=alike, level=at)


@dataclass(frozen=True, slots=True)
class _Cycle:
    """What the autocorrelation of a level shows."""

    found: Oscillation
    strength: float
    """Share of the variance that swings with it."""
    clear: bool
    """Whether that, and the number of cycles, is more than chance."""


def _shown(h: Any) -> list[_Cycle]:
    """Return the cycle that each level's autocorrelation shows, however faintly."""
    shown = []
    for k in filter(lambda k: _full(h, k), range(LEVELS)):
        n = float(h["votes"][k])
        cycled, strength, fading = cycle(h["acf"][k].astype(np.float64) / n)
        if cycled == 0.0 or strength <= 0.0:
            continue
        regularity = max(fading - FADED / math.sqrt(n), 0.0)
        amplitude = math.sqrt(2.0 * strength * float(h["power"][k]) / n)
        clear = strength >= max(LEAST, UNSURE / math.sqrt(n)) and n * BLOCK >= LEAST_CYCLES * cycled
        shown.append(_Cycle(Oscillation(cycled * _seconds(h, k), regularity, amplitude, k), strength, clear))
    return shown


def _alike(h: Any, k: int, seen: Oscillation | None) -> float:
    """Return how alike a level's cycles are; 0 where it is not the level to see them."""
    n = float(h["cycles"][k])
    if n < 1.0 or not _full(h, k):
        return 0.0
    length = float(h["length"][k]) / n
    if (k > 0 and length < FINE) or length > LONG:
        return 0.0
    # two thirds to one and a half: the cycles are those that the autocorrelation sees
    if seen is not None and not 2.0 / 3.0 < _mean_cycle(h, k) / seen.period < 1.5:
        return 0.0
    return likeness(h, k, CHANCE if seen is None else 0.0)


def _mean_cycle(h: Any, k: int) -> float:
    """Return the mean length of a level's cycles [s]."""
    return float(h["length"][k] / h["cycles"][k]) * _seconds(h, k)


def _seconds(h: Any, k: int) -> float:
    """Return the time of an average of a level [s]."""
    return float(width(h, k) * h["spacing"])


def _full(h: Any, k: int) -> bool:
    """Whether the error moves throughout at a level and at the next finer one.

    What only fills the time once it is averaged is pulses: a load that steps to and fro, answered each time.
    """
    if h["votes"][k] < max(MOST_IDLE * h["blocks"][k], 1.0):
        return False
    return k == 0 or bool(h["votes"][k - 1] >= BETWEEN * h["blocks"][k - 1])


def too_fast(h: Any) -> bool:
    """Whether the error alternates from sample to sample, beyond what noise does: two or three samples a cycle."""
    n = float(h["votes"][0])
    return bool(n >= TELLING and h["acf"][0][1] < ALTERNATES * n)
