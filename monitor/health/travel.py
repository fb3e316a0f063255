"""How far the controller's output goes beyond its own noise, and how often it turns: the same at any sampling.

Noise makes way: the more samples, the more. So OP is averaged over 1, 2, 4, ... times a grid of time, and its way is
counted at each of these levels at once, behind a play as wide as the noise. Which level to believe is decided when the
figure is read: that in which OP's own movement, beyond the noise, has just become visible. Half the mean square of the
difference of neighbouring averages (D. W. Allan, Proc. IEEE 54 (1966) 221-230) tells: white noise has its variance
over the number of samples there; the rest is movement, whatever the sampling. The choice of the level, and the play,
are derived.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from monitor.compiled import jit

from .measurement import LOUDER, clipped, run_of_loud
from .saturation import never_moved

LEVELS = 14
"""Levels, each twice as long as the one before: 1 s to 2.3 hours for samples of 1 s."""
GRID = 0.9
"""Share of the sample period below which the finest level may not lie: it is the next power of two seconds."""
OTHER = 0.6
"""Change of the sample period, as a share, from which on the levels begin anew."""
PLAY = 1.5
"""Standard deviations of OP's noise to either side within which it does not move: swings of less than three are no
way."""
QUIET = 3.0
"""And standard deviations of what the averages leave of the noise."""
TOP = 0.2
"""Share of a way's averages that lie about as far out as its end."""
SEEN, VISIBLE = 2.0, 0.3
"""Level to believe: where OP moves this many standard deviations of its noise, or where its movement reaches this share
of the most at any level, whichever is shorter. The averages take about 5 % off a cycle then."""
CLEAR = 0.3
"""Movement over noise, as variances, from which on a level tells of the movement."""
HIDDEN = 0.2
"""Movement at its most, in variances of the noise, below which OP is at rest but for single moves."""
SWING = 4.5
"""Standard deviations of the noise in a swing, on average, below which it is chance what counts as way."""
FEW = 15.0
"""Turns below which it takes swings twice as large."""
FIRST = 16
"""Samples after which a first guess at OP's noise is made."""
AVERAGES = 32
"""Averages without which a level says nothing."""

_f, _s = np.float64, np.float32
FIELDS = [
    *[(n, _f) for n in "op_d op_dd op_q0 op_q1 op_log op_rho op_known op_loud op_noise".split()],
    *[(n, _f) for n in "op_time op_grid op_clock op_sum op_count".split()],
    *[(n, np.int64) for n in ("op_bins", "op_ready")],
    *[(n, _f, (LEVELS,)) for n in ("op_last", "op_diff", "op_y", "op_way")],
    *[(n, _s, (LEVELS,)) for n in ("op_diffs", "op_side", "op_since", "op_turns")],
]
"""What is kept: the noise's blocks, the finest average that fills; and a level's last average, the squares of its
differences, the middle of its play, and its way."""


@jit
def move(h, last, period, dt, op):
    """Take in OP of one sample in automatic."""
    d = op - last.op
    dd = d - h.op_d
    h.op_q0 += dd * dd
    h.op_q1 += dd * h.op_dd
    h.op_d, h.op_dd = d, dd
    if period <= 0.0:
        return
    if abs(h.op_grid - period) > OTHER * h.op_grid:
        _begin(h, period)
    if h.op_ready == 0 and h.op_seen >= FIRST:
        h.op_noise = 0.5 * np.sqrt(max(-h.op_q1 / FIRST, 0.0))
        h.op_ready = 1
    if h.op_ready:
        h.op_time += dt
    h.op_sum += op
    h.op_count += 1.0
    h.op_clock += dt
    edge = h.op_grid - 0.25 * period  # samples are never quite in time
    while h.op_clock >= edge:
        h.op_clock -= h.op_grid
        if h.op_count > 0.0:
            _level(h, h.op_sum / h.op_count, period)
            h.op_sum = h.op_count = 0.0
        else:
            _level(h, op, period)


@jit
def _begin(h, period):
    """Lay the grid for another sample period [s], and forget the way so far."""
    h.op_grid = 2.0 ** np.ceil(np.log2(GRID * period))
    _forget(h)


@jit
def _forget(h):
    """Forget the way so far: another grid, or another noise."""
    h.op_time = 0.0
    h.op_diff[:] = 0.0
    h.op_diffs[:] = 0.0
    h.op_way[:] = 0.0
    h.op_turns[:] = 0.0
    pause(h)


@jit
def _level(h, y, period):
    """Take in an average of the finest level, and those that it completes."""
    n = h.op_bins
    h.op_bins = n + 1
    share = min(period / h.op_grid, 1.0)
    for k in range(LEVELS):
        before = h.op_last[k]
        h.op_last[k] = y
        if n > 0:
            h.op_diff[k] += (y - before) * (y - before)
            h.op_diffs[k] += 1.0
        if n == 0 or h.op_ready == 0:
            h.op_y[k] = y
            h.op_side[k] = h.op_since[k] = 0.0
        else:
            _follow(h, k, y, np.sqrt(share) * h.op_noise)
        if n & 1 == 0:
            return
        y = 0.5 * (before + y)
        n >>= 1
        share *= 0.5


@jit
def _follow(h, k, y, noise):
    """Move the play of a level along with its average, whose noise is ``noise`` [OP]."""
    h.op_since[k] += 1.0
    band = max(PLAY * h.op_noise, QUIET * noise)
    if y > h.op_y[k] + band:
        way, side = y - band - h.op_y[k], 1.0
        h.op_y[k] = y - band
    elif y < h.op_y[k] - band:
        way, side = h.op_y[k] - y - band, -1.0
        h.op_y[k] = y + band
    else:
        return
    h.op_way[k] += way
    if side != h.op_side[k]:
        if h.op_side[k] != 0.0:
            h.op_turns[k] += 1.0
            # what the play cut off at both ends, less the noise's own peaks: the largest of n normal numbers is
            # 0.5 + 0.42 ln n (to 0.1 from 5 to 1000)
            peak = 0.5 + 0.42 * np.log(max(TOP * h.op_since[k], 1.0))
            h.op_way[k] += 2.0 * max(band - peak * noise, 0.0)
        h.op_side[k] = side
        h.op_since[k] = 0.0


@jit
def weigh_moves(h, n):
    """At the end of a block of ``n`` samples: learn OP's noise from second differences.

    Their autocovariance at lag 1 is -4 sigma^2 for white noise, and positive for what moves smoothly.
    """
    q0, q1 = h.op_q0 / n, h.op_q1 / n
    h.op_q0 = h.op_q1 = 0.0
    if q0 <= 0.0:
        return
    loudness = np.log(q0)
    h.op_loud = run_of_loud(h.op_loud, loudness, h.op_log, h.op_known, counts=True)
    if h.op_loud >= LOUDER:  # the noise is another one
        h.op_log = h.op_rho = h.op_known = h.op_loud = 0.0
        _forget(h)
    h.op_log += clipped(loudness, h.op_log, h.op_known)
    h.op_known += 1.0
    h.op_rho += q1 / q0
    white = max(-h.op_rho / h.op_known, 0.0) * np.exp(h.op_log / h.op_known)
    h.op_noise = 0.5 * np.sqrt(white)


@jit
def pause(h):
    """Forget what ran, after a gap or a change of mode: OP may be anywhere now."""
    h.op_q0 = h.op_q1 = h.op_d = h.op_dd = 0.0
    h.op_clock = h.op_sum = h.op_count = 0.0
    h.op_bins = 0


@jit
def fade(h):
    """Halve the sums."""
    h.op_log *= 0.5
    h.op_rho *= 0.5
    h.op_known *= 0.5
    h.op_time *= 0.5
    for k in range(LEVELS):
        h.op_diff[k] *= 0.5
        h.op_diffs[k] *= 0.5
        h.op_way[k] *= 0.5
        h.op_turns[k] *= 0.5


def travel_of(h: Any, period: float) -> tuple[float | None, float | None]:
    """Return way [OP/h] and reversals [1/h] of OP, of swings of more than three standard deviations of its noise.

    Zero for an OP that hardly leaves its noise. None before the noise is known, and where most swings are about as
    large as the noise: chance decides then which of them count.

    Parameters
    ----------
    h
        A loop's sums.
    period
        Sample period [s].
    """
    if h["op_time"] <= 0.0:
        return (0.0, 0.0) if never_moved(h) else (None, None)
    known = h["op_diffs"] >= AVERAGES
    if not known[0]:
        return None, None
    sigma = float(h["op_noise"])
    noise = sigma**2 * np.minimum(period / float(h["op_grid"]), 1.0) * 0.5 ** np.arange(LEVELS)[known]
    movement = 0.5 * h["op_diff"][known] / h["op_diffs"][known] - noise
    level = _level_to_believe(movement, noise, sigma)
    way, turns = (float(np.interp(level, np.arange(LEVELS), h[n])) for n in ("op_way", "op_turns"))
    swing = SWING * sigma if turns >= FEW else 2.0 * SWING * sigma
    if way < swing * max(turns, 1.0):
        rests = max(movement) < HIDDEN * sigma**2
        return (0.0, 0.0) if rests else (None, None)
    hours = float(h["op_time"]) / 3600.0
    return way / hours, turns / hours


def _level_to_believe(movement: Any, noise: Any, sigma: float) -> float:
    """Return it, between two levels where need be; ``movement``, ``noise``: variances at each level."""
    most = int(np.argmax(movement))
    if movement[most] < HIDDEN * sigma**2:
        return float(most)
    visible = min(0.5 * SEEN**2 * sigma**2, VISIBLE * _peak(movement, most))
    k = int(np.argmax((movement >= visible) & (movement > CLEAR * noise)))
    if k == 0:
        return 0.0
    if movement[k - 1] > CLEAR * noise[k - 1]:
        return k - math.log(movement[k] / visible) / math.log(movement[k] / movement[k - 1])
    return k - min(
        0.5 * math.log2(movement[k] / visible), 1.0
    )  # what moves smoothly: by the square of the time


def _peak(movement: Any, most: int) -> float:
    """Return the top of a parabola through the largest value and its neighbours, all logarithmic."""
    around = movement[max(most - 1, 0) : most + 2]
    if len(around) < 3 or min(around) <= 0.0:
        return float(movement[most])
    a, b, c = (math.log(v) for v in around)
    bend = a - 2.0 * b + c
    return math.exp(b - (a - c) ** 2 / (8.0 * bend)) if bend < 0.0 else math.exp(b)
