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

from monitor.compiled import jit

from .autocorrelation import ACF_LEVELS, seconds_of
from .block import BLOCK_LENGTH
from .level import ACF_LAGS
from .stiction import CHANCE_LN, SHAPE_AVERAGES, likeness_of, mean_length_of

SHORTEST_AVERAGES, LONGEST_AVERAGES = 4.7, 20.5
"""Averages in a cycle that a level looks for; four times the first is below the second: no period falls between."""
FIRST_AVERAGES, PERIOD_FACTOR, PERIODS_TRIED = 2.2, 1.03, 77
"""Periods tried: from the first on [level samples], by this factor, so many of them (to 21.8)."""
NEARLY_SHARE = 0.8
"""A shorter period that swings this much of the best counts as the cycle, the best as its multiple."""
SWINGING_SHARE, CHANCE_SHARE = 0.25, 0.5
"""Least share of the variance that must swing with the cycle; and by how much noise alone may seem to in one block."""
FADING_ERROR_SHARE = 0.55
"""Error of the fading by one block: with few blocks a damped loop may seem to swing on."""
MOVING_SHARE = 0.5
"""Least share of a level's blocks in which the error moves throughout."""
FINER_MOVING_SHARE = 0.3
"""And at the next finer level, whose blocks hold one to three cycles."""
LEAST_CYCLES = 5.0
"""Least number of cycles in all blocks."""
ECHO_SHARE = 0.12
"""Least share of the variance that must swing with cycles that are alike, though their autocorrelation fades."""
ALIKE_CYCLES = 12.0
"""And the least number of them."""
MEAN_AVERAGES = 38.0
"""Averages in a mean cycle at most: from there on the next coarser level sees it, and longer ones, whole."""
UNEVEN_PERIOD_SHARE = 0.2
"""Difference between the mean length of uneven cycles and the autocorrelation's period above which neither is given."""
ALTERNATING_BLOCKS, ALTERNATING_ACF = 5.0, -0.6
"""Blocks, and autocorrelation at lag 1, from which the sampling is too coarse for what swings; differences of white
noise have -0.5."""


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
    score = np.empty(PERIODS_TRIED + 2)
    best = 0.0
    for i in range(PERIODS_TRIED + 2):
        p = FIRST_AVERAGES * PERIOD_FACTOR**i
        score[i] = _swing(acf, 1.0, p) + _swing(acf, 2.0, p)
        best = max(best, score[i])
    for i in range(1, PERIODS_TRIED + 1):
        low, mid, high = score[i - 1], score[i], score[i + 1]
        if mid >= NEARLY_SHARE * best and mid >= low and mid > high:
            period = FIRST_AVERAGES * PERIOD_FACTOR ** (
                i + 0.5 * (high - low) / max(2.0 * mid - low - high, 1e-12)
            )
            if not SHORTEST_AVERAGES <= period <= LONGEST_AVERAGES:
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
    i = min(int(lag), ACF_LAGS - 3)
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


def strongest(own: Any) -> Oscillation | None:
    """Return the strongest cycle of an error's autocorrelation, regular or not; None without a clean block or cycle."""
    shown = _shown(own)
    seen = max((c.found for c in shown if c.clear), key=lambda found: found.amplitude, default=None)
    alike, at = max((_alike(own, k, seen), k) for k in range(ACF_LEVELS))
    if alike == 0.0:
        return seen
    if seen is not None and alike <= seen.regularity:
        return replace(seen, level=at)
    if seen is not None:
        uneven = abs(_mean_cycle(own, at) / seen.period - 1.0) > UNEVEN_PERIOD_SHARE
        return replace(seen, regularity=alike, level=at, uneven=uneven)
    length = _mean_cycle(own, at)
    echoes = [c for c in shown if c.strength >= ECHO_SHARE and 0.5 < c.found.period / length < 2.0]
    if not echoes or own["levels"][at]["cycles"]["cycles"] < ALIKE_CYCLES:
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


def _shown(own: Any) -> list[_Cycle]:
    """Return the cycle that each level's autocorrelation shows, however faintly."""
    shown = []
    for k in filter(lambda k: _full(own, k), range(ACF_LEVELS)):
        level = own["levels"][k]
        n = float(level["votes"])
        cycled, strength, fading = cycle(level["acf"].astype(np.float64) / n)
        if cycled == 0.0 or strength <= 0.0:
            continue
        regularity = max(fading - FADING_ERROR_SHARE / math.sqrt(n), 0.0)
        amplitude = math.sqrt(2.0 * strength * float(level["power"]) / n)
        enough = n * BLOCK_LENGTH >= LEAST_CYCLES * cycled
        clear = enough and strength >= max(SWINGING_SHARE, CHANCE_SHARE / math.sqrt(n))
        shown.append(
            _Cycle(Oscillation(cycled * seconds_of(own, k), regularity, amplitude, k), strength, clear)
        )
    return shown


def _alike(own: Any, k: int, seen: Oscillation | None) -> float:
    """Return how alike a level's cycles are; 0 where it is not the level to see them."""
    cycles = own["levels"][k]["cycles"]
    if cycles["cycles"] < 1.0 or not _full(own, k):
        return 0.0
    length = mean_length_of(cycles)
    if (k > 0 and length < SHAPE_AVERAGES) or length > MEAN_AVERAGES:
        return 0.0
    # two thirds to one and a half: the cycles are those that the autocorrelation sees
    if seen is not None and not 2.0 / 3.0 < _mean_cycle(own, k) / seen.period < 1.5:
        return 0.0
    return likeness_of(cycles, CHANCE_LN if seen is None else 0.0)


def _mean_cycle(own: Any, k: int) -> float:
    """Return the mean length of a level's cycles [s]."""
    return mean_length_of(own["levels"][k]["cycles"]) * seconds_of(own, k)


def _full(own: Any, k: int) -> bool:
    """Whether the error moves throughout at a level and at the next finer one.

    What only fills the time once it is averaged is pulses: a load that steps to and fro, answered each time.
    """
    levels = own["levels"]
    if levels[k]["votes"] < max(MOVING_SHARE * levels[k]["blocks"], 1.0):
        return False
    return k == 0 or bool(levels[k - 1]["votes"] >= FINER_MOVING_SHARE * levels[k - 1]["blocks"])


def any_block(own: Any) -> bool:
    """Whether a block of samples is full and clean."""
    return bool(own["levels"][0]["blocks"] > 0)


def too_fast(own: Any) -> bool:
    """Whether the error alternates from sample to sample, beyond what noise does: two or three samples a cycle."""
    finest = own["levels"][0]
    n = float(finest["votes"])
    return bool(n >= ALTERNATING_BLOCKS and finest["acf"][1] < ALTERNATING_ACF * n)
