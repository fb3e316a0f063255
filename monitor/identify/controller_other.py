"""Laws other than a PID's of the set point and the error as recorded: where one explains OP, it is named."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from monitor.compiled import jit
from monitor.contract.samples import Array

from .controller_fit import EXACT_SHARE, Known, Place, explained
from .controller_law import INTEGRAL, START, D, P, columns, compared, judged, products, solved, whitened
from .controller_rows import Rows

WEIGHTS = ((1.0, 0.0), (0.0, 0.0), (1.0, 1.0))
"""Set-point weights b and c of the usual structures: PI-D, I-PD, PID."""
GRID = 16
"""Rates, lags and widths that are tried first."""
INSIDE_REST_SHARE, INSIDE_EXPLAINED = 0.1, 0.9
"""Share (standard deviations) of what a set point that acts at once leaves of OP that one leaves which the block moves;
share of OP's moves that it must explain."""
AT_ONCE_LN = 5.0
"""By how much shorter a move is that is over at once."""
NOWHERE = Place(0.0, 0.0, 0.0)
LEAST_PERIODS = 3.0
"""Sample periods of a set point's move inside the block that is looked for."""
HALVINGS = 18
"""By how often the grid's width is halved around the best."""
FEWEST_SHARE, MOST_SHARE = 0.05, 0.98
"""Shares of the rows whose error lies inside of the narrowest gap that is tried, and of the widest."""
MUCH_BETTER = 0.05
"""Share of the squares of a linear law that one with a varying gain leaves, to be believed."""
WELL_EXPLAINED = 0.98
"""Share of OP's moves that it must explain."""
MOVED_SHARE = 0.003
"""Share of OP's moves that it may leave where the set point moves."""
LEAST_MOVING_SHARE = 0.7
"""Share of the rows at which OP moves where the controller runs at each."""
LINEAR_SHARE = 1e-3
"""Share of OP's moves of which a linear law may leave less, and be one."""
LEAST_ROWS = 60
"""Rows that show a varying gain."""
GAP_WIDTHS = 24
"""Widths of a gap that are tried first."""
LEAST_TF_PERIODS, TF_RANGE_LN = 0.05, 6.9
"""Shortest derivative filter that is tried, in sample periods, and how far from it the longest lies."""
ALL = np.array([P, INTEGRAL, D, START])
WIDTH_SHARE, WIDTH_NOISES, LEAST_SIDE_SHARE = 0.02, 3.0, 0.05
"""Share of the largest error, and standard deviations of PV's noise, that a gap is wide at the least; share of the rows
with errors on either side of its edge."""
SECOND_DIFFERENCE_SD = 1.652
"""Median size of white noise's second differences, over its standard deviation: sqrt(6) times 0.6745."""
GAP_GAIN_SHARE = 0.8
"""Most gain within a gap, as a share of that outside."""
RAMPED, FILTERED, UNFILTERED = 0, 1, 2
"""Other inputs of the law: a set point that the block ramps, or filters; PV before the historian's filter."""
SQUARED, GAP = 0, 1
"""Laws with a varying gain: it grows with the error; it is another one within a gap around zero."""


@dataclass(frozen=True, slots=True)
class Inside:
    """A set point that the block moves by itself."""

    rate: float
    """Most that it moves; 0 = at once [PV/s]."""
    lag: float
    """Of its filter [s]."""

    @property
    def words(self) -> str:
        """What the block does."""
        if self.rate:
            return f"the block ramps its set point by {self.rate:.3g} a second (no kick at the step)"
        return f"the block filters its set point over {self.lag:.3g} s (no kick at the step)"


@jit
def working_setpoint(time, sp, rate, lag):
    """Return the set point that a block works with: limited in its rate, or through a first-order filter; (n,) [PV]."""
    out = sp.copy()
    for k in range(1, len(sp)):
        dt = time[k] - time[k - 1]
        away = sp[k] - out[k - 1]
        out[k] = out[k - 1] + (
            min(max(away, -rate * dt), rate * dt) if rate > 0.0 else away * dt / (lag + dt)
        )
    return out


@jit
def unfiltered(time, pv, lag):
    """Return what went into a first-order filter (backward difference) of which PV came out; (n,) [PV]."""
    out = pv.copy()
    for k in range(1, len(pv)):
        out[k] = pv[k] + lag * (pv[k] - pv[k - 1]) / (time[k] - time[k - 1])
    return out


@jit
def _rest_inside(rows, law, gains, size, kind, at):
    """Return what known gains leave of OP (standard deviation), and the law's own movement, by other inputs.

    By kind: a set point that takes ``exp(at)`` seconds over a move of ``size``; one through a filter of that time
    constant; PV before such a filter.
    """
    time, sp, pv, op, use, fresh = rows
    seconds = math.exp(at)
    if kind == UNFILTERED:
        pv = unfiltered(time, pv, seconds)
    else:
        sp = working_setpoint(time, sp, size / seconds if kind == RAMPED else 0.0, seconds)
    x = columns(time, sp, pv, law, 0.0, 0)
    _, rest, _, moved, _ = compared(x, gains, op, use, fresh, math.inf, 0.0)
    return rest, moved


@jit
def _search_inside(rows, law, gains, size, kind, low, high):
    """Return where between ``low`` and ``high`` (ln s) such inputs leave least of OP."""
    step = (high - low) / (GRID - 1)
    best, least = low, math.inf
    for k in range(GRID):
        rest = _rest_inside(rows, law, gains, size, kind, low + k * step)[0]
        if rest < least:
            best, least = low + k * step, rest
    for _ in range(HALVINGS):
        step *= 0.5
        for at in (best - step, best + step):
            rest = _rest_inside(rows, law, gains, size, kind, at)[0]
            if rest < least:
                best, least = at, rest
    return best


def setpoint_inside(rows: Rows, known: Known) -> Inside | None:
    """Return how the block moves its set point, where the table's law then leaves nothing of OP."""
    moves = np.diff(rows.sp)
    size = float(np.max(np.abs(np.cumsum(moves)), initial=0.0))
    if size == 0 or np.count_nonzero(moves) > len(rows) // 8 or rows.stride > 1:
        return None
    told = (rows.time, rows.sp, rows.pv, rows.op, rows.use, rows.fresh)
    law, gains = known.law(rows), known.gains
    low, high = math.log(LEAST_PERIODS * rows.period), math.log(float(rows.time[-1] - rows.time[0]))
    at_once = _rest_inside(told, law, gains, size, RAMPED, low - AT_ONCE_LN)[0]
    found = []
    for kind in (RAMPED, FILTERED):
        at = _search_inside(told, law, gains, size, kind, low, high)
        left = _rest_inside(told, law, gains, size, kind, at)[0]
        inside = Inside(size / math.exp(at), 0.0) if kind == RAMPED else Inside(0.0, math.exp(at))
        moved = replace(rows, sp=working_setpoint(rows.time, rows.sp, inside.rate, inside.lag))
        if (
            left < INSIDE_REST_SHARE * at_once
            and explained(moved, known, gains, NOWHERE, 1.0) > INSIDE_EXPLAINED
        ):
            found.append((left, inside))
    return min(found, key=lambda f: f[0])[1] if found else None


def recorded_filter(rows: Rows, known: Known) -> float:
    """Return the time constant of a filter behind which PV is recorded, where that leaves nothing of OP [s]; or 0.

    The controller sees PV before that filter, which only the historian has.
    """
    if rows.stride > 1:
        return 0.0
    known_before = np.arange(len(rows)) > 0  # of the first row, what came before is not known
    told = (rows.time, rows.sp, rows.pv, rows.op, rows.use & known_before, rows.fresh)
    law, gains = known.law(rows), known.gains
    low, high = math.log(0.25 * rows.period), math.log(0.5 * float(rows.time[-1] - rows.time[0]))
    at = _search_inside(told, law, gains, 0.0, UNFILTERED, low, high)
    left, moved = _rest_inside(told, law, gains, 0.0, UNFILTERED, at)
    return math.exp(at) if left <= max(EXACT_SHARE * moved, 0.6 * rows.quantum) else 0.0


@jit
def varying_columns(time, e, x, kind, width):
    """Return the columns of a law whose gain varies with the error, from those of the linear one: (n, 7).

    The gain times P, times the error under the integral, times D; with the square of the error, the plain integral and
    D under the integral; with a gap, the same three outside of it, and the step at its edge.
    """
    n = len(e)
    out = np.zeros((n, 7))
    for k in range(n):
        inside = abs(e[k]) < width
        gain = abs(e[k]) if kind == SQUARED else (1.0 if inside else 0.0)
        dt = time[k] - time[k - 1] if k > 0 else 0.0
        out[k, 0] = gain * x[k, P]
        out[k, 1] = (out[k - 1, 1] if k > 0 else 0.0) + dt * gain * e[k]
        out[k, 2] = gain * x[k, D]
        if kind == SQUARED:
            out[k, 3] = x[k, INTEGRAL]
            out[k, 4] = (out[k - 1, 4] if k > 0 else 0.0) + dt * gain * x[k, D]
        else:
            out[k, 3] = 0.0 if inside else x[k, P]
            out[k, 4] = (out[k - 1, 4] if k > 0 else 0.0) + (0.0 if inside else dt * e[k])
            out[k, 5] = 0.0 if inside else x[k, D]
            out[k, 6] = 0.0 if inside else (1.0 if e[k] > 0.0 else -1.0)
    return out


@jit
def _left_by_varying(rows, law, walk, kind, width, active):
    """Return the squares that a free law of this kind leaves, those of OP, and its gains."""
    time, sp, pv, op, use, fresh = rows
    x = columns(time, sp, pv, law, 0.0, 0)
    more = varying_columns(time, sp - pv, x, kind, width)
    m = products(whitened(more, op, use, fresh, walk)[0])
    gains, left = solved(m, active)
    return left, m[7, 7], gains


@jit
def _search_gap(rows, law, walk, active, e):
    """Return the width of the gap that leaves least of OP's moves, and what; ``e`` is the sorted size of the errors.

    Between two errors that follow each other it makes no difference: coarse steps first, then each one near the best.
    """
    low, high = int(FEWEST_SHARE * len(e)), int(MOST_SHARE * len(e))
    best, least = 0, math.inf
    step = max((high - low) // GAP_WIDTHS, 1)
    while True:
        for k in range(low, high, step):
            left = _left_by_varying(rows, law, walk, GAP, 0.5 * (e[k] + e[k + 1]), active)[0]
            if left < least:
                best, least = k, left
        if step == 1:
            return 0.5 * (e[best] + e[best + 1]), least
        low, high = max(best - step, 0), min(best + step + 1, len(e) - 1)
        step = max(step // 4, 1)


def with_derivative(rows: Rows, known: Known, walk: float) -> Known:
    """Return the law with the derivative filter with which free gains leave least of OP."""
    told = (rows.time, rows.sp, rows.pv, rows.op, rows.use, rows.fresh)
    tf = _search_filter(told, known.law(rows), ALL, walk, math.log(LEAST_TF_PERIODS * rows.period))
    return replace(known, tf=float(tf), derivative=True)


@jit
def _search_filter(rows, law, active, walk, low):
    """Return the derivative filter that leaves least of OP: none, or from ``exp(low)`` [s] on."""
    _, b, c, present, middle = law
    free = np.full(4, np.nan)
    least = judged(rows, (0.0, b, c, present, middle), active, free, walk, (0.0, 0.0))
    step = TF_RANGE_LN / (GRID - 1)
    best = -math.inf
    for k in range(GRID):
        at = low + k * step
        left = judged(rows, (math.exp(at), b, c, present, middle), active, free, walk, (0.0, 0.0))
        if left < least:
            best, least = at, left
    for _ in range(HALVINGS if best > -math.inf else 0):
        step *= 0.5
        for at in (best - step, best + step):
            left = judged(rows, (math.exp(at), b, c, present, middle), active, free, walk, (0.0, 0.0))
            if left < least:
                best, least = at, left
    return math.exp(best)


def varying_gain(rows: Rows, known: Known, squares: float) -> str:
    """Say which law with a gain that depends on the error explains OP; empty where none does.

    Parameters
    ----------
    squares
        What the best linear law leaves of OP's moves.
    """
    moves = np.diff(rows.op) != 0
    if np.count_nonzero(rows.use) < LEAST_ROWS or rows.stride > 1 or np.mean(moves) < LEAST_MOVING_SHARE:
        return ""
    told = (rows.time, rows.sp, rows.pv, rows.op, rows.use, rows.fresh)
    law = known.law(rows)
    active = _active(known, SQUARED)
    left, every, gains = _left_by_varying(told, law, 1.0, SQUARED, 0.0, active)
    if squares < LINEAR_SHARE * every:
        return ""
    # a set point that acts otherwise than recorded bends the law, too, but no such law leaves nothing then
    most = min(
        MUCH_BETTER * squares, (MOVED_SHARE if np.any(np.diff(rows.sp)) else 1.0 - WELL_EXPLAINED) * every
    )
    if left < most and gains[0] * gains[1] >= 0.0:
        return "OP follows the square of the error (error-squared action), not a linear PID"
    e = np.unique(np.abs(rows.sp - rows.pv)[rows.use])
    if len(e) < LEAST_ROWS:
        return ""
    width, left = _search_gap(told, law, 1.0, _active(known, GAP), e)
    gains = _left_by_varying(told, law, 1.0, GAP, width, _active(known, GAP))[2]
    if left < most and _is_gap(rows, width, gains):
        return f"OP follows the error with another gain within {width:.3g} of the set point (gap action), no linear PID"
    return ""


def _is_gap(rows: Rows, width: float, gains: Array) -> bool:
    """Whether such a width is a gap: errors lie on both sides, it stands out of noise, its gain is the lower one."""
    e = np.abs(rows.sp - rows.pv)[rows.use]
    inside = float(np.mean(e < width))
    noise = float(np.median(np.abs(np.diff(rows.pv, 2)))) / SECOND_DIFFERENCE_SD
    wide = width > max(WIDTH_SHARE * float(np.max(e)), WIDTH_NOISES * noise)
    both = LEAST_SIDE_SHARE < inside < 1.0 - LEAST_SIDE_SHARE
    return wide and both and abs(gains[0]) < GAP_GAIN_SHARE * abs(gains[3])


def _active(known: Known, kind: int) -> Array:
    if kind == SQUARED:
        return np.array([0, 1, 2, 3, 4] if known.derivative else [0, 1, 3])
    return np.array([0, 1, 2, 3, 4, 5, 6] if known.derivative else [0, 1, 3, 4, 6])
