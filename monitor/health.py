"""What a loop's samples say of its health, beside its events: shares of time, offset, noise, travel.

`observe` takes in one good sample, compiled, with a few additions and O(1) memory a loop; `figures` reads the
sums. A figure that the data cannot carry is None.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .state import jit

_f = np.float64
HEALTH = np.dtype([(name, _f) for name in ("wall_time", "good_time", "manual_time", "limit_time", "travel")])
"""A loop's running sums: times [s], way of OP [OP]."""


@jit
def observe(h, s, p, time, dt, gap, sp, pv, op, auto):  # noqa: ARG001 (what the figures to come need)
    """Account for one good sample and the time ``dt`` [s] since the last; ``s`` still holds the last sample."""
    h.wall_time += dt
    if gap:
        return
    # a missed sample is bridged, but does not count as covered
    h.good_time += dt if s.period == 0 else min(dt, 1.5 * s.period)
    if not s.auto:
        h.manual_time += dt
    if s.op <= p.op_low or s.op >= p.op_high:
        h.limit_time += dt
    h.travel += abs(op - s.op)


@dataclass(frozen=True, slots=True)
class Health:
    """A loop's health so far; the fields are columns of the loop's row, None where nothing was seen."""

    coverage: float | None = None
    """Good time / wall time."""
    manual: float | None = None
    """Share of time."""
    saturation: float | None = None
    """Share of time."""
    offset: float | None = None
    """[PV]"""
    noise: float | None = None
    """Standard deviation [PV]."""
    quantum: float | None = None
    """Least change [PV]."""
    travel_per_hour: float | None = None
    """[OP/h]"""


def figures(h: Any, s: Any) -> Health:
    """Read a loop's health from its running sums ``h`` (dtype `HEALTH`) and state ``s`` (dtype `STATE`)."""
    wall, good = float(h["wall_time"]), float(h["good_time"])
    if wall <= 0 or good <= 0:
        return Health()
    known = s["warm"] > 0
    return Health(
        coverage=min(good / wall, 1.0),
        manual=float(h["manual_time"]) / good,
        saturation=float(h["limit_time"]) / good,
        offset=float(s["mean_e"]) if known else None,
        noise=math.sqrt(float(s["var_d"]) / 6.0) if known else None,
        quantum=float(s["quantum"]) or None,
        travel_per_hour=float(h["travel"]) / good * 3600.0,
    )
