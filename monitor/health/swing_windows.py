"""Where in a record a swing of some period repeats itself, window by window of five cycles (compiled).

The record is averaged over 1, 2, 4, ... samples, so that a cycle has 7 to 14 averages (from 4 at the finest). In a
window of five cycles of a period, freed of mean and slope, the record is held against itself, shifted by whole and by
half cycles: a swing is alike after a whole one, which counts twice, and opposite after a half. Sums of products over
any window are differences of two rows of a table of running sums, so that a window costs the same whatever its length.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit

Array = NDArray[np.float64]

WINDOW_CYCLES = 5.0
"""In a window: with fewer, noise of any colour looks regular too often."""
LEAST_WINDOW_CYCLES = 4.75
"""In the window of the longest periods, which is the whole record."""
PERIODS_AN_OCTAVE = 7
"""Periods tried, a factor of 1.104; each with one a third of that shorter and longer, so that halfway between two a
swing is shifted by 3 % of its cycle after two."""
FINEST_AVERAGES, COARSEST_AVERAGES = 3.9, 14.0
"""Averages in a cycle: the fewest at the finest level, the most at any, half as many the fewest at the others."""
NEAR = tuple(2.0 ** (k / (3.0 * PERIODS_AN_OCTAVE)) for k in (-1, 0, 1))
"""Periods looked at around the one tried, over it."""
LAGS = 32
"""Products in a row of the table: two of the longest cycles, and a neighbour to interpolate, rounded up to whole
vectors."""
LINES = 4
"""Sums in a row of the table before these."""
LEAST_SCORE = 0.5
"""Score of a window that counts: 1 for a sine, a triangle or a square, 0.83 for a sawtooth, 0 for noise, whose score
over five cycles has a deviation of 0.1 to 0.15."""
GATE_ACF = 0.2
"""Autocorrelation after a cycle, in whole averages, below which a period is not looked at in a window: the score asks
for 0.25 (were half a cycle's -1)."""
NEARLY = 0.2
"""By which the score of the period tried may lie below, where the best one near it reaches it."""
CYCLE_SHARE = 0.3
"""Least energy of each of the five cycles over their mean: what dies away or passes is no swing that lasts."""
FULL_SHARE = 0.65
"""Least mean size over the standard deviation: 0.9 for a sine, 0.87 for a sawtooth, 0.8 for noise, below 0.5 for the
pulses that a set point's steps to and fro leave in the error of a good loop."""
SETPOINT_TRAVEL = 1.0
"""Way of the set point in a cycle, over the swing's amplitude, from which on the swing is taken for its answer: a
set point that goes to and fro with the cycle travels twice its step, or four times its amplitude."""
SAME_PERIOD_RATIO = 1.2
"""Between periods of runs that are one oscillation: a limit cycle drifts that much."""
ROUNDING_SHARE = 1e-9
"""Of the error: what is left of a constant or of a ramp."""
RUN_COLUMNS = 7
MOST_RUNS = 256
"""Rows of results: runs of windows at one period. More than that in one record is noise."""


def runs_of(error: Array, sp: Array) -> Array:
    """Find the runs of windows that swing, at each period.

    Parameters
    ----------
    error, sp : ndarray
        (N,) samples of error and set point [PV].

    Returns
    -------
    ndarray
        (M, 7): first sample, one past the last, sum over windows of their period [samples], windows, sums of score
        and of amplitude [PV], and the lowest number of a run that is one oscillation with this one.
    """
    middle, power, x, sums = _scratch(len(error))
    own = error - error.mean()
    out = np.empty((MOST_RUNS, RUN_COLUMNS))
    return out[: _search(error, own, float(own @ middle) / power, sp, x, sums, out)]


@lru_cache(maxsize=4)
def _scratch(n: int) -> tuple[Array, float, Array, Array]:
    """Return places from a record's middle, their squares' sum, and room for both signals and for the table.

    New pages each time would cost as much as the search, which holds the GIL.
    """
    middle = np.arange(n, dtype=np.float64) - 0.5 * (n - 1)
    return middle, float(middle @ middle), np.empty((2, n + LAGS)), np.empty((n + 1, LINES + LAGS))


@jit
def _search(error, own, slope, sp, x, sums, out):
    """Go through the levels of averaging and their periods; return the number of runs.

    ``own``: the error less its mean; its slope is taken off, too, lest sums be differences of large numbers.
    """
    n, count, width = len(error), 0, 1
    x[:, n:] = 0.0
    x[0, :n] = own - (np.arange(n) - 0.5 * (n - 1)) * slope
    x[1, :n] = sp
    if np.abs(x[0]).max() <= ROUNDING_SHARE * np.abs(error).max():
        return 0
    while n >= LEAST_WINDOW_CYCLES * (FINEST_AVERAGES if width == 1 else 0.5 * COARSEST_AVERAGES):
        _sum_up(x, n, sums)
        for j in range(1, (2 if width == 1 else 1) * PERIODS_AN_OCTAVE + 1):
            p = COARSEST_AVERAGES * 2.0 ** (-j / PERIODS_AN_OCTAVE)
            if p >= FINEST_AVERAGES and n >= LEAST_WINDOW_CYCLES * p:
                count = _look(x, n, sums, p, width, out, count)
        n //= 2
        width *= 2
        _halve(x, n)
    for i in range(count):
        for k in range(i):
            if _is_same(out, i, k):
                _unite(out, count, i, k)
    return count


@jit
def _halve(x, n):
    """Average both signals over two samples, so that n are left, and zeros after them."""
    for row in range(2):
        for i in range(n):
            x[row, i] = 0.5 * (x[row, 2 * i] + x[row, 2 * i + 1])
        for i in range(n, n + LAGS):
            x[row, i] = 0.0


@jit
def _is_same(out, i, k):
    """Whether two runs overlap, or leave less than a cycle, at nearly the same period."""
    one, other = out[i, 2] / out[i, 3], out[k, 2] / out[k, 3]
    longer, shorter = max(one, other), min(one, other)
    gap = max(out[i, 0], out[k, 0]) - min(out[i, 1], out[k, 1])
    return longer <= SAME_PERIOD_RATIO * shorter and gap < shorter


@jit
def _unite(out, count, i, k):
    """Give the runs of two groups the lower of their numbers."""
    low, high = min(out[i, 6], out[k, 6]), max(out[i, 6], out[k, 6])
    for j in range(count if high > low else 0):
        if out[j, 6] == high:
            out[j, 6] = low


@jit
def _sum_up(x, n, sums):
    """Sum, before each average, x, place times x, x squared, the set point's way; and x times x 0, 1, 2, ... later."""
    sums[0] = 0.0
    for i in range(n):
        v = x[0, i]
        sums[i + 1, 0] = sums[i, 0] + v
        sums[i + 1, 1] = sums[i, 1] + i * v
        sums[i + 1, 2] = sums[i, 2] + v * v
        sums[i + 1, 3] = sums[i, 3] + (abs(x[1, i] - x[1, i - 1]) if i > 0 else 0.0)
        for lag in range(LAGS):
            sums[i + 1, LINES + lag] = sums[i, LINES + lag] + v * x[0, i + lag]


@jit
def _look(x, n, sums, p, width, out, count):
    """Look at a period, in windows half a cycle apart; add its runs to ``out``, and return how many there are."""
    length, at = min(round(WINDOW_CYCLES * p), n), round(p)
    last = -2
    for j in range(int(2.0 * (n - length) / p) + 1):
        start = int(0.5 * p * j)
        # as it stands: a mean and a slope only add to it
        energy = sums[start + length, 2] - sums[start, 2]
        if sums[start + length - at, LINES + at] - sums[start, LINES + at] < GATE_ACF * energy:
            continue
        score, period, amplitude = _window(x, sums, start, length, p, at)
        if score < LEAST_SCORE:
            continue
        if last != j - 1:
            if count == MOST_RUNS:
                return count
            out[count, 0], out[count, 6] = start * width, count
            for column in range(2, 6):
                out[count, column] = 0.0
            count += 1
        last = j
        row = count - 1
        out[row, 1] = (start + length) * width
        out[row, 2] += period * width
        out[row, 3] += 1.0
        out[row, 4] += score
        out[row, 5] += amplitude
    return count


@jit
def _window(x, sums, start, length, p, at):
    """Return a window's score, the best period near the one tried, the amplitude [PV]; 0 where it does not count.

    ``at``: the period as a whole number.
    """
    end = start + length
    middle = start + 0.5 * (length - 1)
    total = sums[end, 0] - sums[start, 0]
    mean = total / length
    slope = (sums[end, 1] - sums[start, 1] - middle * total) * 12.0 / (length * (length * length - 1.0))
    if _acf(sums, start, length, at, mean, slope) < GATE_ACF:
        return 0.0, 0.0, 0.0
    once = _swing(sums, start, length, p, 0.5 * p, mean, slope)
    if once < LEAST_SCORE - NEARLY:
        return 0.0, 0.0, 0.0
    best, period = 0.0, p
    for k in range(len(NEAR)):
        near = p * NEAR[k]
        score = once if NEAR[k] == 1.0 else _swing(sums, start, length, near, 0.5 * near, mean, slope)
        if score >= LEAST_SCORE:
            score = min(score, _swing(sums, start, length, 2.0 * near, 1.5 * near, mean, slope))
        if score > best:
            best, period = score, near
    if best < LEAST_SCORE:
        return 0.0, 0.0, 0.0
    rms = _lasts(x, start, length, mean, slope)
    amplitude = math.sqrt(2.0 * best) * rms
    if rms == 0.0 or sums[end, 3] - sums[start + 1, 3] > SETPOINT_TRAVEL * WINDOW_CYCLES * amplitude:
        return 0.0, 0.0, 0.0
    return best, period, amplitude


@jit
def _swing(sums, start, length, lag, opposite, mean, slope):
    """Return how alike a window is after one lag, and how opposite after another, which counts half (derived)."""
    swing = 0.0
    for other in range(2):
        at = opposite if other else lag
        first = int(at)
        weights = _cubic(at - first)
        for k in range(4):
            acf = _acf(sums, start, length, first - 1 + k, mean, slope)
            swing += (-1.0 if other else 2.0) / 3.0 * weights[k] * acf
        if swing < LEAST_SCORE - 1.0 / 3.0:  # whatever the other is
            return 0.0
    return swing


@jit
def _acf(sums, start, length, lag, mean, slope):
    """Correlate a window without its line with itself, a lag later; each part over its own energy (derived)."""
    n = length - lag
    middle = start + 0.5 * (length - 1)
    a, b, c, d = start, start + n, start + lag, start + length
    x1, x2 = sums[b, 0] - sums[a, 0], sums[d, 0] - sums[c, 0]
    ux1 = sums[b, 1] - sums[a, 1] - middle * x1
    ux2 = sums[d, 1] - sums[c, 1] - middle * x2
    own, shift = n * (n * n - 1.0) / 12.0, 0.25 * n * lag * lag
    square = n * mean * mean
    tilt = mean * slope * n * lag
    energy1 = sums[b, 2] - sums[a, 2] - 2.0 * (mean * x1 + slope * ux1) + square - tilt
    energy2 = sums[d, 2] - sums[c, 2] - 2.0 * (mean * x2 + slope * ux2) + square + tilt
    energy1 += slope * slope * (own + shift)
    energy2 += slope * slope * (own + shift)
    both = sums[b, LINES + lag] - sums[a, LINES + lag] - mean * (x1 + x2) + square
    both += slope * slope * (own - shift) - slope * (ux1 + lag * x1 + ux2 - lag * x2)
    return both / math.sqrt(energy1 * energy2) if energy1 > 0.0 and energy2 > 0.0 else 0.0


@jit
def _cubic(t):
    """Weights of four neighbours of a place between the second and the third (Catmull-Rom)."""
    return (
        0.5 * t * (t * (2.0 - t) - 1.0),
        1.0 + 0.5 * t * t * (3.0 * t - 5.0),
        0.5 * t * (1.0 + t * (4.0 - 3.0 * t)),
        0.5 * t * t * (t - 1.0),
    )


@jit
def _lasts(x, start, length, mean, slope):
    """Return a window's standard deviation about its line [PV]; 0 where a cycle is missing, or where it is pulses."""
    size = energy = 0.0
    least, cycles = math.inf, int(WINDOW_CYCLES)
    for k in range(cycles):
        own = 0.0
        for i in range(k * length // cycles, (k + 1) * length // cycles):
            v = x[0, start + i] - mean - slope * (i - 0.5 * (length - 1))
            own += v * v
            size += abs(v)
        energy += own
        least = min(least, own)
    if energy <= 0.0 or least < CYCLE_SHARE * energy / cycles:
        return 0.0
    return math.sqrt(energy / length) if size * size >= FULL_SHARE * FULL_SHARE * length * energy else 0.0
