"""Where the controller's output rests: at its limits, at its own extremes, or while the error moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit

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
_TIMES = ("low_time", "high_time", "limit_time", "held_time")
FIELDS = [
    *[(n, _f) for n in ("op_min", "op_max", "op_step", *_TIMES)],
    *[(n, _i) for n in ("op_rest", "op_alive", "op_seen", "op_limited")],
]


@jit
def rest(h, last, limits, dt, op, alive):
    """Take in OP of one sample in automatic; ``alive``: the error has moved with it."""
    if h.op_seen == 0:
        h.op_min = h.op_max = op
        h.op_limited = limits.op_low > -np.inf or limits.op_high < np.inf
    h.op_seen += 1
    if last.op <= limits.op_low or last.op >= limits.op_high:
        h.limit_time += dt
    d = op - last.op
    if d == 0.0:
        _stay(h, limits, dt, op, alive)
        return
    h.op_rest = h.op_alive = 0
    if h.op_step == 0.0 or abs(d) < h.op_step:
        h.op_step = abs(d)
    if op < h.op_min:
        h.op_min, h.low_time = op, 0.0
    elif op > h.op_max:
        h.op_max, h.high_time = op, 0.0


@jit
def _stay(h, limits, dt, op, alive):
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
    inside = (h.op_min < op < h.op_max or h.op_min == h.op_max) and limits.op_low < op < limits.op_high
    if h.op_rest >= HELD and inside and h.op_alive > MOST_STILL * h.op_rest:
        h.held_time += dt * HELD if h.op_rest == HELD else dt


@jit
def get_up(h):
    """Forget what ran, after a gap or a change of mode: OP may be anywhere now."""
    h.op_rest = h.op_alive = 0


@jit
def fade(h):
    """Halve the sums."""
    h.low_time *= 0.5
    h.high_time *= 0.5
    h.limit_time *= 0.5
    h.held_time *= 0.5


def never_moved(h: Any) -> bool:
    """Whether OP has been the same in automatic for so long that this says something."""
    return bool(h["op_seen"] > HELD and h["op_min"] == h["op_max"])


def saturation_of(h: Any, time: float) -> float:
    """Return the share of time at the limits; where none are known, at rest exactly at OP's own extremes."""
    at = float(h["limit_time"])
    if not h["op_limited"]:
        wide = float(h["op_max"] - h["op_min"]) > RANGE * float(h["op_step"]) > 0.0
        at = float(h["low_time"] + h["high_time"]) if wide else 0.0
    return min(at / time, 1.0)
