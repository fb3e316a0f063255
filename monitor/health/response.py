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
_LENGTHS = np.arange(AVERAGES, LEAST_AVERAGES - 1, -1)
FIRST = np.concatenate([np.arange(AVERAGES - length + 1) for length in _LENGTHS])
LAST = FIRST + np.repeat(_LENGTHS, AVERAGES - _LENGTHS + 1)
"""Stretches of averages, half-open, the longest first."""

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
    if n < AVERAGES or period <= 0.0 or not all(np.isfinite(x).all() for x in (sp, pv, op)):
        return None
    edges = np.arange(AVERAGES + 1) * n // AVERAGES
    error = np.asarray(sp - pv, dtype=np.float64)
    e, u = _averaged(error, edges), _averaged(op, edges)
    stays = _stays(e, _noise(error))
    if not stays.any():
        return None
    op_sd, size = _noise(op), float(np.max(np.abs(op)))
    goes = _goes_on(u, op_sd, float(np.ptp(op)))
    for i in np.flatnonzero(stays):
        first, last = int(FIRST[i]), int(LAST[i])
        a, b = int(edges[first]), int(edges[last])
        held = float(np.ptp(op[a:b])) <= HELD_SHARE * size
        if not (held or goes[i]):
            continue
        mean = float(np.mean(e[first:last]))
        if _jumps(e[last - 3 :], mean):
            return None
        way = 0.0 if held else float(u[last - 1] - u[first])
        kind: Kind = "held" if held else "slow_integral" if abs(way) < HARDLY_SHARE * op_span else "no_answer"
        return NoResponse(
            kind, a, b, mean, way, goes_right(mean, way, direction), _rests_at_extreme(op, op_sd)
        )
    return None


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


def _averaged(x: Array, edges: NDArray[np.int64]) -> Array:
    """Return means between edges."""
    return np.asarray(np.add.reduceat(x, edges[:-1]) / np.diff(edges))


def _noise(x: Array) -> float:
    """Return the standard deviation of a signal about a short mean of it, made good for what the mean takes along."""
    short = np.convolve(x, np.full(AVERAGED_SAMPLES, 1.0 / AVERAGED_SAMPLES), "valid")
    half = AVERAGED_SAMPLES // 2
    return float(np.std(x[half:-half] - short)) / float(np.sqrt(1.0 - 1.0 / AVERAGED_SAMPLES))


def _stays(e: Array, sd: float) -> NDArray[np.bool_]:
    """Whether an error keeps its side and its size, for each stretch of averages."""
    sums, above = _sums(e), _sums((e > 0.0).astype(np.float64))
    length, fifth, half = LAST - FIRST, (LAST - FIRST) // 5, (LAST - FIRST) // 2

    def mean(first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
        return (sums[last] - sums[first]) / (last - first)

    whole = mean(FIRST, LAST)
    share = (above[LAST] - above[FIRST]) / length
    side = np.sign(whole)
    return np.asarray(
        (np.abs(whole) >= max(ERROR_SD * sd, 1e-12 * float(np.max(np.abs(e)))))
        & (whole != 0.0)
        & (np.where(whole > 0.0, share, 1.0 - share) >= ONE_SIDE_SHARE)
        & (side * mean(LAST - fifth, LAST) >= LAST_SHARE * side * mean(FIRST, FIRST + fifth))
        & (side * mean(FIRST + half, LAST) >= LATER_SHARE * side * mean(FIRST, FIRST + half))
    )


def _goes_on(u: Array, sd: float, op_range: float) -> NDArray[np.bool_]:
    """Whether OP goes one way, and far, for each stretch of averages."""
    way, path = np.abs(u[LAST - 1] - u[FIRST]), _sums(np.abs(np.diff(u)))
    least = max(OP_SD * sd, RANGE_SHARE * op_range)
    return np.asarray((way >= STRAIGHT_SHARE * (path[LAST - 1] - path[FIRST])) & (way >= least) & (way > 0.0))


def _sums(x: Array) -> Array:
    """Return the sums before each place."""
    return np.concatenate([[0.0], np.cumsum(x)])


def _jumps(e: Array, mean: float) -> bool:
    """Whether an error that stayed is gone all at once, as where a valve comes free."""
    return len(e) > 2 and bool(np.max(np.sign(mean) * (e[:-2] - e[2:])) >= JUMP_SHARE * abs(mean))


def _rests_at_extreme(op: Array, sd: float) -> bool:
    """Whether OP ends where it was highest or lowest, and has rested there."""
    last = op[-max(int(RESTS_SHARE * len(op)), 2) :]
    least = max(3.0 * sd, HELD_SHARE * float(np.max(np.abs(op))))
    near = min(float(np.max(op) - np.min(last)), float(np.max(last) - np.min(op)))
    return near <= min(least, 0.05 * float(np.ptp(op))) or float(np.ptp(op)) == 0.0
