"""What the controller's output does: its way, its reversals, where it rests, and whether it is moved at all."""

from __future__ import annotations

from typing import Any

import numpy as np

from .sensor import clipped
from .state import jit

BAND = 4.0
"""Standard deviations of OP's noise to either side within which it does not count as moving: three are left behind
once in an hour at 10 s, a hundred times at 0.1 s."""
TOP = 0.2
"""Share of a way's samples that lie about as far out as its end."""
REST = 5
"""Samples for which OP must be exactly the same to count as resting at its extreme: a coarse OP dwells there by
chance."""
RANGE = 10.0
"""Least range of OP, in its own least steps, for which its extremes say something."""
HELD = 200
"""Samples of an OP exactly the same, away from its limits and extremes, while the error moves: nobody controls. A
resting loop with a coarse OP may hold for dozens."""
MOST_STILL = 0.5
"""Share of those samples at which the error may have stood still as well."""

_f, _i = np.float64, np.int64
FIELDS = [
    *[(n, _f) for n in ("op_y", "op_side", "op_way", "op_turns", "op_time")],
    *[(n, _f) for n in ("op_d", "op_dd", "op_q0", "op_q1", "op_log", "op_rho", "op_known", "op_noise")],
    *[(n, _f) for n in ("op_min", "op_max", "op_step", "low_time", "high_time", "limit_time", "held_time")],
    ("op_rest", _i),
    ("op_alive", _i),
    ("op_seen", _i),
    ("op_loose", _i),
    ("op_limited", _i),
    ("op_since", _i),
]


@jit
def move(h, s, p, dt, op, alive):
    """Take in OP of one sample in automatic; ``alive``: the error has moved with it."""
    if h.op_seen == 0:
        h.op_min = h.op_max = op
        h.op_loose = 1
        h.op_limited = p.op_low > -np.inf or p.op_high < np.inf
    h.op_seen += 1
    d = op - s.op
    dd = d - h.op_d
    h.op_q0 += dd * dd
    h.op_q1 += dd * h.op_dd
    h.op_d, h.op_dd = d, dd
    if s.op <= p.op_low or s.op >= p.op_high:
        h.limit_time += dt
    if d == 0.0:
        _rest(h, p, dt, op, alive)
        if h.op_known > 0.0:
            h.op_time += dt
            h.op_since += 1
        return
    h.op_rest = h.op_alive = 0
    if h.op_step == 0.0 or abs(d) < h.op_step:
        h.op_step = abs(d)
    if op < h.op_min:
        h.op_min, h.low_time = op, 0.0
    elif op > h.op_max:
        h.op_max, h.high_time = op, 0.0
    if h.op_known > 0.0:
        h.op_time += dt
        h.op_since += 1
        _follow(h, op)


@jit
def _follow(h, op):
    """Move a play of the noise's width along with OP."""
    if h.op_loose:
        h.op_y, h.op_side, h.op_loose = op, 0.0, 0
        return
    band = BAND * h.op_noise
    if op > h.op_y + band:
        way, side = op - band - h.op_y, 1.0
        h.op_y = op - band
    elif op < h.op_y - band:
        way, side = h.op_y - op - band, -1.0
        h.op_y = op + band
    else:
        return
    h.op_way += way
    if side != h.op_side:
        if h.op_side != 0.0:
            h.op_turns += 1.0
            # what the band cut off at both ends, less the noise's own peaks: the largest of n normal numbers is
            # 0.5 + 0.42 ln n (to 0.1 from 5 to 1000), so that a finer sampling does not lengthen the way
            peak = 0.5 + 0.42 * np.log(max(TOP * h.op_since, 1.0))
            h.op_way += 2.0 * max(BAND - peak, 0.0) * h.op_noise
        h.op_side = side
        h.op_since = 0


@jit
def _rest(h, p, dt, op, alive):
    """Account for a sample at which OP has not moved."""
    h.op_rest += 1
    if alive:
        h.op_alive += 1
    if h.op_rest >= REST:
        more = dt * REST if h.op_rest == REST else dt
        if op == h.op_min:
            h.low_time += more
        if op == h.op_max:
            h.high_time += more
    inside = (h.op_min < op < h.op_max or h.op_min == h.op_max) and p.op_low < op < p.op_high
    if h.op_rest >= HELD and inside and h.op_alive > MOST_STILL * h.op_rest:
        h.held_time += dt * HELD if h.op_rest == HELD else dt


@jit
def weigh_moves(h, n):
    """At the end of a block of ``n`` samples: learn OP's noise from second differences.

    Their autocovariance at lag 1 is -4 sigma^2 for white noise, and positive for what moves smoothly.
    """
    q0, q1 = h.op_q0 / n, h.op_q1 / n
    h.op_q0 = h.op_q1 = 0.0
    if q0 <= 0.0:
        return
    h.op_log += clipped(np.log(q0), h.op_log, h.op_known)
    h.op_known += 1.0
    h.op_rho += q1 / q0
    white = max(-h.op_rho / h.op_known, 0.0) * np.exp(h.op_log / h.op_known)
    h.op_noise = 0.5 * np.sqrt(white)


@jit
def pause(h):
    """Forget what ran, after a gap or a change of mode: OP may be anywhere now."""
    h.op_rest = h.op_alive = 0
    h.op_q0 = h.op_q1 = h.op_d = h.op_dd = 0.0
    h.op_loose = 1


@jit
def fade(h):
    """Halve the sums."""
    h.op_way *= 0.5
    h.op_turns *= 0.5
    h.op_time *= 0.5
    h.op_log *= 0.5
    h.op_rho *= 0.5
    h.op_known *= 0.5
    h.low_time *= 0.5
    h.high_time *= 0.5
    h.limit_time *= 0.5
    h.held_time *= 0.5


def travel_of(h: Any) -> tuple[float | None, float | None]:
    """Return way [OP/h] and reversals [1/h] of OP beyond the band of its own noise; None before that is known.

    Derived: a play operator. The way is the same at any sampling that follows the loop, unless most of it is the
    noise's; the reversals are those at the loop's own sampling.
    """
    if h["op_time"] <= 0.0:
        return (0.0, 0.0) if h["op_seen"] > HELD and h["op_min"] == h["op_max"] else (None, None)
    hours = float(h["op_time"]) / 3600.0
    return float(h["op_way"]) / hours, float(h["op_turns"]) / hours


def saturation_of(h: Any, time: float) -> float:
    """Return the share of time at the limits; where none are known, at rest exactly at OP's own extremes."""
    at = float(h["limit_time"])
    if not h["op_limited"]:
        wide = float(h["op_max"] - h["op_min"]) > RANGE * float(h["op_step"]) > 0.0
        at = float(h["low_time"] + h["high_time"]) if wide else 0.0
    return min(at / time, 1.0)
