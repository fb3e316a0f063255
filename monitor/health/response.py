"""Whether PV answers its controller at all: an error that stays while OP goes one way, or rests.

A controller with integral action moves OP for as long as there is an error, and PV comes back. Where OP has gone one
way for a long time and the error is as large as before, the way from OP to PV is shut, blocked, at its end or
overridden; or OP went so little that the integral is far too slow; where OP does not move at all, something holds it.
A load that grows just as fast as OP takes it away looks the same: that is undecidable.

Method and limits: our own (see the bench, ``tests/bench/swings.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import range_of
from monitor.compiled import jit

Array = NDArray[np.float64]

AVERAGES = 40
"""In a record: enough for a half to be told from a fifth, few enough for noise to be gone."""
LEAST_AVERAGES = AVERAGES // 2
"""In a stretch: half the record; a shorter one is a process on its way."""
AVERAGED_SAMPLES = 3
"""In the short mean whose difference from the samples is noise; two thirds of its variance is left in it."""
ONE_SIDE_SHARE = 0.95
"""Of a stretch's averages whose error has one sign."""
ERROR_SD, OP_SD = 4.0, 10.0
"""Least mean error, and least net way of OP, over the standard deviation of their noise."""
STRAIGHT_SHARE = 0.9
"""Least net way of OP over the way it went: it does not turn, as it would about an answer."""
RANGE_SHARE = 0.3
"""Least net way of OP over its range in the whole record: the stretch is not what is left of a larger move."""
LAST_SHARE, LATER_SHARE = 0.7, 0.8
"""Least error in the last fifth over that in the first; in the second half over the first: it does not come back."""
HARDLY_SHARE = 0.02
"""Of OP's span: net way below which the integral is called far too slow: OP could go fifty times as far."""
HELD_SHARE = 1e-6
"""Of OP's size: range within which it does not move at all; rounding of a historian's floats is 1e-7."""
RESTS_SHARE = 0.05
"""Of a record: end in which OP rests after its way, as at a limit."""

JUMP_SHARE = 0.7
"""Of the mean error, lost within two averages after the stretch: the valve stuck, and came free."""
Kind = Literal["no_answer", "slow_integral", "held"]


@dataclass(frozen=True, slots=True)
class NoResponse:
    """A stretch of a record in which PV stays away from its set point."""

    kind: Kind
    """`no_answer`: OP goes on and on; `slow_integral`: it hardly moves; `held`: it does not move at all."""
    start: int
    """First sample."""
    end: int
    """One past the last sample."""
    error: float
    """Mean, signed: above 0 where PV is below its set point [PV]."""
    op_way: float
    """Net way of OP, signed [OP]."""
    right_way: bool | None
    """Whether OP goes where it takes the error away; None where the controller's sign is not known, or OP rests."""
    at_extreme: bool
    """Whether OP ends at its highest or lowest of the record, and rests there."""


def no_response_of(
    sp: Array, pv: Array, op: Array, period: float, direction: int = 0, op_span: float = 100.0
) -> NoResponse | None:
    """Return the longest stretch in which PV does not answer OP; None where it does, or nothing asks it to.

    A stretch that ends in a jump of PV towards its set point is a sticking valve's, and not meant here.

    Parameters
    ----------
    sp, pv, op : ndarray
        (N,) samples equally spaced in time, in automatic, without a gap [PV], [PV], [OP].
    period : float
        Sample period; what is found does not depend on it [s].
    direction : {1, -1, 0}
        Sign of the controller's gain (OP over ``sp - pv``); 0 where it is not known.
    op_span : float
        Width of OP's range [OP].

    Returns
    -------
    NoResponse or None
    """
    n = len(pv)
    if n < AVERAGES or period <= 0.0:
        return None
    length, first, mean, way, held, at_extreme = _longest(sp, pv, op)
    if length == 0:
        return None
    a, b = first * n // AVERAGES, (first + length) * n // AVERAGES
    kind: Kind = "held" if held else "slow_integral" if abs(way) < HARDLY_SHARE * op_span else "no_answer"
    return NoResponse(kind, a, b, mean, way, goes_right(mean, way, direction), at_extreme)


def goes_right(error: float, op_way: float, direction: int) -> bool | None:
    """Return whether OP goes where it takes an error [PV] away; None where a sign is not known, or OP rests.

    Parameters
    ----------
    op_way
        Net way of OP, signed [OP].
    direction
        Sign of the controller's gain; 0 where it is not known.
    """
    return None if op_way == 0.0 or direction == 0 else op_way * error * direction > 0.0


@jit
def _longest(sp, pv, op):
    """Return the longest stretch in which PV does not answer: averages in it (0: none), the first; what is seen in it.

    That is its mean error, the net way of OP, whether OP is held, and whether it ends and rests at its extreme.
    """
    none = 0, 0, 0.0, 0.0, False, False
    error, n = sp - pv, len(op)
    e, u = _averaged(error), _averaged(op)
    if not np.isfinite(e.sum() + u.sum()):
        return none
    sums, above = _sums(e), _sums((e > 0.0).astype(np.float64))
    least = max(ERROR_SD * _noise(error), 1e-12 * np.abs(e).max())
    op_sd = size = op_range = -1.0  # before it is known, which is seldom asked
    path = _sums(np.abs(u[1:] - u[:-1]))
    for length in range(AVERAGES, LEAST_AVERAGES - 1, -1):
        for first in range(AVERAGES - length + 1):
            last = first + length
            if not _stays(sums, above, first, last, least):
                continue
            if op_sd < 0.0:
                op_sd, size, op_range = _noise(op), np.abs(op).max(), range_of(op)
            held = range_of(op[first * n // AVERAGES : last * n // AVERAGES]) <= HELD_SHARE * size
            way = u[last - 1] - u[first]
            far = max(OP_SD * op_sd, RANGE_SHARE * op_range)
            goes_on = abs(way) >= max(STRAIGHT_SHARE * (path[last - 1] - path[first]), far) and way != 0.0
            if not (held or goes_on):
                continue
            mean = e[first:last].mean()
            if _jumps(e[last - 3 :], mean):
                return none
            return length, first, mean, 0.0 if held else way, held, _rests_at_extreme(op, op_sd)
    return none


@jit
def _averaged(x):
    """Return means over equal parts."""
    n, out = len(x), np.empty(AVERAGES)
    for k in range(AVERAGES):
        out[k] = x[k * n // AVERAGES : (k + 1) * n // AVERAGES].mean()
    return out


@jit
def _noise(x):
    """Return the standard deviation of a signal about a short mean of it, made good for what the mean takes along."""
    n = len(x) - AVERAGED_SAMPLES + 1
    half, beside = AVERAGED_SAMPLES // 2, np.empty(n)
    for i in range(n):
        beside[i] = x[i + half] - x[i : i + AVERAGED_SAMPLES].sum() / AVERAGED_SAMPLES
    return np.std(beside) / np.sqrt(1.0 - 1.0 / AVERAGED_SAMPLES)


@jit
def _stays(sums, above, first, last, least):
    """Whether an error keeps its side and its size in a stretch of averages; ``sums``, ``above``: before each place."""
    length = last - first
    fifth, half = length // 5, length // 2
    whole = (sums[last] - sums[first]) / length
    if abs(whole) < least or whole == 0.0:
        return False
    share = (above[last] - above[first]) / length
    if (share if whole > 0.0 else 1.0 - share) < ONE_SIDE_SHARE:
        return False
    side = np.sign(whole)
    begins, ends = (sums[first + fifth] - sums[first]) / fifth, (sums[last] - sums[last - fifth]) / fifth
    earlier, later = (
        (sums[first + half] - sums[first]) / half,
        (sums[last] - sums[first + half]) / (length - half),
    )
    return side * ends >= LAST_SHARE * side * begins and side * later >= LATER_SHARE * side * earlier


@jit
def _sums(x):
    """Return the sums before each place."""
    out = np.zeros(len(x) + 1)
    for i in range(len(x)):
        out[i + 1] = out[i] + x[i]
    return out


@jit
def _jumps(e, mean):
    """Whether an error that stayed is gone all at once, as where a valve comes free."""
    return (np.sign(mean) * (e[:-2] - e[2:])).max() >= JUMP_SHARE * abs(mean)


@jit
def _rests_at_extreme(op, sd):
    """Whether OP ends where it was highest or lowest, and has rested there."""
    last = op[len(op) - max(int(RESTS_SHARE * len(op)), 2) :]
    least = max(3.0 * sd, HELD_SHARE * np.abs(op).max())
    near = min(op.max() - last.min(), last.max() - op.min())
    return near <= min(least, 0.05 * range_of(op)) or range_of(op) == 0.0
