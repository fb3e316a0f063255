"""How long a loop was watched: good time over wall time, and its share in manual."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit_inlined

from .fields import halving

COVERED_PERIODS = 1.5
"""Sample periods that a sample covers at most: a missed one is bridged, but was not seen."""

SLICE_GAP_S = 6 * 3600.0
"""A silence from which on data come in slices [s]: an export of Monday's and Thursday's has no missing Tuesday. A
shift's length: what is lost by faults of the line is shorter, or is seen as stale while it lasts."""

SUMS: list[Any] = [
    ("wall_time", "f8"),  # [s] from sample to sample, gaps too, without what lies between slices
    ("good_time", "f8"),  # [s] covered by samples
    ("manual_time", "f8"),  # [s] in manual, gaps left out
    ("auto_time", "f8"),  # [s] from one sample in automatic to the next
]
RUNNING: list[Any] = []
KEPT: list[Any] = []
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)


@jit_inlined
def update(own, dt, period, gap, was_auto, auto):
    """Take in the time since the last sample [s] and the mode before and after it; ``period`` is 0 if unknown [s]."""
    if gap and dt > SLICE_GAP_S:
        return
    own.wall_time += dt
    if gap:
        return
    own.good_time += dt if period == 0 else min(dt, COVERED_PERIODS * period)
    if not was_auto:
        own.manual_time += dt
    elif auto:
        own.auto_time += dt


def coverage_of(own: Any) -> float:
    """Return good time over wall time."""
    return min(float(own["good_time"]) / float(own["wall_time"]), 1.0)


def manual_of(own: Any) -> float:
    """Return the share of the time in manual."""
    return min(float(own["manual_time"]) / float(own["good_time"]), 1.0)
