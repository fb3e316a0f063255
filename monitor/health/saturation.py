"""Where the controller's output rests: at its limits, at its own extremes, or while the error moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit, jit_inlined

from .fields import clearing, halving

REST_SAMPLES = 5
"""Samples for which OP must be exactly the same to count as resting at its extreme: a coarse OP dwells there by
chance."""
RANGE_STEPS = 10.0
"""Least range of OP, in its own least steps, for which its extremes say something."""
HELD_SAMPLES = 200
"""Samples of an OP exactly the same, away from its limits and extremes, while the error moves: nobody controls. A
resting loop with a coarse OP may hold for dozens."""
ERROR_MOVES_SHARE = 0.5
"""Share of those samples at which the error must have moved."""

SUMS: list[Any] = [
    ("low_time", "f8"),  # [s] at rest at its own lowest
    ("high_time", "f8"),  # [s] at rest at its own highest
    ("limit_time", "f8"),  # [s] at or beyond its limits
    ("held_time", "f8"),  # [s] at rest elsewhere while the error moves
]
RUNNING: list[Any] = [
    ("rest", "i8"),  # samples for which OP has been exactly the same
    ("error_moved", "i8"),  # those of them at which the error was another
]
KEPT: list[Any] = [
    ("lowest", "f8"),  # [OP] ever in automatic
    ("highest", "f8"),  # [OP]
    ("least_step", "f8"),  # [OP] smallest change, 0 before any
    ("samples", "i8"),  # in automatic
    ("has_limits", "i8"),  # whether the table names one
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)
reset = clearing(RUNNING)


@jit_inlined
def update(own, before, op, dt, limits, error_moves):
    """Take in one sample in automatic.

    Parameters
    ----------
    before, op
        OP of the last sample and of this one [OP].
    dt
        Time between them [s].
    limits
        op_low, op_high, infinite where there is none.
    error_moves
        Whether the error has moved between them.
    """
    if own.samples == 0:
        own.lowest = own.highest = op
        own.has_limits = limits.op_low > -np.inf or limits.op_high < np.inf
    own.samples += 1
    if before <= limits.op_low or before >= limits.op_high:
        own.limit_time += dt
    d = op - before
    if d == 0.0:
        _rest(own, op, dt, limits, error_moves)
        return
    reset(own)
    if own.least_step == 0.0 or abs(d) < own.least_step:
        own.least_step = abs(d)
    if op < own.lowest:
        own.lowest, own.low_time = op, 0.0
    elif op > own.highest:
        own.highest, own.high_time = op, 0.0


@jit
def _rest(own, op, dt, limits, error_moves):
    """Account for a sample at which OP has not moved."""
    own.rest += 1
    if error_moves:
        own.error_moved += 1
    if own.rest >= REST_SAMPLES:
        more = dt * REST_SAMPLES if own.rest == REST_SAMPLES else dt
        if op == own.lowest:
            own.low_time += more
        if op == own.highest:
            own.high_time += more
    inside = (
        own.lowest < op < own.highest or own.lowest == own.highest
    ) and limits.op_low < op < limits.op_high
    if own.rest >= HELD_SAMPLES and inside and own.error_moved > ERROR_MOVES_SHARE * own.rest:
        own.held_time += dt * HELD_SAMPLES if own.rest == HELD_SAMPLES else dt


def never_moved(own: Any) -> bool:
    """Whether OP has been the same in automatic for so long that this says something."""
    return bool(own["samples"] > HELD_SAMPLES and own["lowest"] == own["highest"])


def saturation_of(own: Any, auto_time: float) -> float:
    """Return the share of time at the limits; where none are known, at rest exactly at OP's own extremes."""
    at = float(own["limit_time"])
    if not own["has_limits"]:
        wide = float(own["highest"] - own["lowest"]) > RANGE_STEPS * float(own["least_step"]) > 0.0
        at = float(own["low_time"] + own["high_time"]) if wide else 0.0
    return min(at / auto_time, 1.0)


def held_of(own: Any, auto_time: float) -> float:
    """Return the share of time in which OP rests while the error moves."""
    return min(float(own["held_time"]) / auto_time, 1.0)
