"""Whether rows come by exception: told by their intervals and by the sizes of PV's changes (compiled)."""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .state import (
    BEAT_SHARE,
    BEAT_TIMES,
    IRREGULAR_RATIO,
    LEAST_BEAT_PERIODS,
    RATE_SHARE,
    TIGHT_CHANGES,
    TIGHT_RATIO,
)


@jit
def _period_of(steps, given):
    """Return the rate behind rows on change [ns]: what the table gives, else the shortest interval but one.

    One alone may be a glitch.
    """
    return given if given > 0 else max(steps[1], 1)


@jit
def _beat_of(steps, period):
    """Return the longest interval that comes again and again [ns], 0 where there is none: a row sent anyway."""
    n = len(steps)
    for k in range(n - 1, max(n - 3, BEAT_TIMES - 2), -1):
        if steps[k] < LEAST_BEAT_PERIODS * period:
            return 0
        if steps[k - BEAT_TIMES + 1] >= (1.0 - BEAT_SHARE) * steps[k]:
            return steps[k]
    return 0


@jit
def look(rows, known):
    """Look at rows; return (period [ns], 0: they do not come by exception; beat [ns]; dead band [PV]).

    ``known``: the period that the table gives [ns], 0 where it gives none.
    """
    n = len(rows) - 1
    in_order = steps_of(rows)
    period = _period_of(in_order, known)
    if in_order[int(0.9 * n)] < IRREGULAR_RATIO * period:
        return 0, 0, 0.0
    pv, op = np.zeros(3), np.zeros(3)
    for k in range(n):
        w, v = rows[k + 1], rows[k]
        _add_powers(pv, abs(w.pv - v.pv))
        if w.sp == v.sp:  # OP's jump with the set point is of any size
            _add_powers(op, abs(w.op - v.op))
    if pv[1] == 0.0 or (_is_loose(n, pv) and _is_loose(n, op)):
        return 0, 0, 0.0
    return period, _beat_of(in_order, period), pv[1] / pv[0]


@jit
def _add_powers(sums, d):
    """Add a change's size, its square and its cube to their sums."""
    sums[0] += d
    sums[1] += d * d
    sums[2] += d * d * d


@jit
def _is_loose(n, sums):
    """Whether ``n`` changes are of all sizes, told by the sums of their sizes, squares and cubes."""
    return sums[1] == 0.0 or sums[2] * sums[0] > (TIGHT_RATIO - TIGHT_CHANGES / n) * sums[1] * sums[1]


@jit
def is_regular(rows, period):
    """Whether rows come at a rate: nine in ten at intervals up to about ``period`` [ns]."""
    n = len(rows) - 1
    return steps_of(rows)[int(0.9 * n)] <= RATE_SHARE * period


@jit
def median_step(rows):
    """Return the median interval between rows [ns]."""
    return max(steps_of(rows)[len(rows) // 2], 1)


@jit
def steps_of(rows):
    """Return the intervals between rows [ns], the shortest first."""
    steps = np.empty(len(rows) - 1, np.int64)
    for k in range(len(steps)):
        steps[k] = rows[k + 1].time - rows[k].time
    return np.sort(steps)
