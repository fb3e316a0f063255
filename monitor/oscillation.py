"""Whether a loop oscillates, for how long a time, and how regularly: the autocorrelation of its error, block by block.

The error is averaged over 1, 4, 16, 64 and 256 samples; at each of these levels blocks of 64 averages are freed of
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

from .state import jit
from .stiction import CAP, ENOUGH, FINE, again, follow, forget, likeness, track
from .stiction import FIELDS as _WAVES

LEVELS = 5
"""Averages over 1, 4, 16, 64, 256 samples."""
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
FOLLOWED, NOT_YET, SETTLED = 0.12, 0.4, 8
"""Share of the variance that swings with a cycle from which on its shape is followed; in one block, by how much noise
seems to swing; blocks after which what swings less is no longer followed."""
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
MANY_ALIKE = 16.0
"""Cycles that speak for themselves if they are alike, though their autocorrelation fades."""
SURE, SHARP = 0.5, 0.75
"""Likeness from which on the mean length of the cycles is the period, unless the autocorrelation is as regular as the
second (noise may cut a cycle in two, which the autocorrelation does not mind; cycles of many lengths it does)."""
TELLING, ALTERNATES = 5.0, -0.6
"""Blocks, and autocorrelation at lag 1, from which the sampling is too coarse for what swings; differences of white
noise have -0.5."""
HORIZON = 14 * 86400.0
"""Time after which sums are halved [s]: a loop is judged by its recent weeks."""

_f, _s, _i = np.float64, np.float32, np.int64
FIELDS = [
    ("clock", _f),
    ("taken", _i),
    ("tainted", _i),
    ("carry", _f, (LEVELS,)),
    ("blocks", _f, (LEVELS,)),
    ("votes", _f, (LEVELS,)),
    ("power", _f, (LEVELS,)),
    ("period_at", _f, (LEVELS,)),
    ("power_at", _f, (LEVELS,)),
    ("acf", _s, (LEVELS, LAGS)),
    ("block", _s, (LEVELS, BLOCK)),
    *_WAVES,
]
"""What is kept of a loop: about 2.3 kB, whatever its period."""


@jit
def take(h, e, op, period):
    """Take in one sample."""
    if h.width > 0:
        track(h, e, op)
    n = h.taken
    h.taken = n + 1
    for k in range(LEVELS):
        at = n & (BLOCK - 1)
        h.block[k, at] = e
        if at == BLOCK - 1:
            _weigh(h, k, period)
            _choose(h, k)
        h.carry[k] += e
        if n & 3 != 3:
            break
        e = 0.25 * h.carry[k]
        h.carry[k] = 0.0
        n >>= 2


@jit
def _choose(h, k):
    """Look for the cycle at a level whose block is full, and follow the loop's strongest one."""
    n = int(h.votes[k])
    if n == 0 or (n > SETTLED and n & 7 != 0):  # it costs as much as a few blocks
        return
    period, strength, _ = cycle(h.acf[k] / np.float32(h.votes[k]))
    h.period_at[k] = period * 4.0**k
    clear = strength >= max(FOLLOWED, NOT_YET / np.sqrt(n)) and _full(h, k)
    h.power_at[k] = strength * h.power[k] / h.votes[k] if clear else 0.0
    best = 0
    for j in range(1, LEVELS):
        if h.power_at[j] > h.power_at[best]:
            best = j
    if h.power_at[best] == 0.0:
        if n >= SETTLED and h.width > 0:
            forget(h)
        return
    width = 4**best
    if best > 0 and h.period_at[best] < FINE * width:
        width //= 4
    if FINE * h.width <= h.period_at[best] <= 0.7 * CAP * h.width:
        width = h.width  # two levels see it: stay with the one that has cycles already
    follow(h, width, h.period_at[best], np.sqrt(2.0 * h.power_at[best]))


@jit
def _full(h, k):
    """Whether the error moves throughout at a level and at the next finer one.

    What only fills the time once it is averaged is pulses: a load that steps to and fro, answered each time.
    """
    if h.votes[k] < MOST_IDLE * h.blocks[k]:
        return False
    return k == 0 or h.votes[k - 1] >= BETWEEN * h.blocks[k - 1]


@jit
def restart(h):
    """Begin all blocks anew, after a gap or a change of mode."""
    h.taken = 0
    h.tainted = 0
    h.clock = 0.0
    again(h)
    for k in range(LEVELS):
        h.carry[k] = 0.0


@jit
def taint(h):
    """Leave out the blocks now open at every level: the set point has stepped."""
    h.tainted = (1 << LEVELS) - 1
    again(h)


@jit
def _weigh(h, k, period):
    """Let a full block vote on its level's autocorrelation."""
    if h.tainted >> k & 1:
        h.tainted -= 1 << k
        return
    if h.blocks[k] * BLOCK * 4.0**k * period > HORIZON:
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
    """[s]"""
    regularity: float
    """0 to 1: what is surely left of the autocorrelation after one more period; or, where that is more, how alike
    the cycles are in amplitude and length (a limit cycle that drifts in period, as that of a sticking valve)."""
    amplitude: float
    """Of the first harmonic [PV]."""


def strongest(h: Any, period: float) -> Oscillation | None:
    """Return the loop's strongest cycle, regular or not; None without a block of clean data or without a cycle.

    Parameters
    ----------
    h
        A loop's sums.
    period
        Sample period [s].
    """
    best, found = 0.0, None
    for k in range(LEVELS):
        n = float(h["votes"][k])
        if n < 1.0 or n < MOST_IDLE * h["blocks"][k]:
            continue
        if k > 0 and h["votes"][k - 1] < BETWEEN * h["blocks"][k - 1]:
            continue
        cycled, strength, fading = cycle(h["acf"][k].astype(np.float64) / n)
        if cycled == 0.0 or strength < max(LEAST, UNSURE / math.sqrt(n)) or n * BLOCK < LEAST_CYCLES * cycled:
            continue
        power = strength * float(h["power"][k]) / n
        if power > best:
            regularity = max(fading - FADED / math.sqrt(n), 0.0)
            best, found = power, Oscillation(cycled * 4.0**k * period, regularity, math.sqrt(2.0 * power))
    alike, n = likeness(h), float(h["cycles"])
    if alike == 0.0 or (found is None and n < MANY_ALIKE):
        return found
    cycle_time = float(h["length"]) / n * float(h["width"]) * period
    if found is None:
        return Oscillation(cycle_time, alike, math.sqrt(float(h["e_shape"][0]) / n))
    # two thirds to one and a half: the cycles are those that the autocorrelation sees
    same = n >= ENOUGH and alike >= SURE and 2.0 / 3.0 < cycle_time / found.period < 1.5
    same = same and found.regularity < SHARP
    return replace(
        found, period=cycle_time if same else found.period, regularity=max(alike, found.regularity)
    )


def too_fast(h: Any) -> bool:
    """Whether the error alternates from sample to sample, beyond what noise does: two or three samples a cycle."""
    n = float(h["votes"][0])
    return bool(n >= TELLING and h["acf"][0][1] < ALTERNATES * n)
