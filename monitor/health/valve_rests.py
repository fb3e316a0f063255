"""What PV does while a valve's element rests though OP moves.

A band that is real shows in stretches in which OP swings and PV does nothing (derived).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import median_of, nth
from monitor.compiled import jit

SWING_SHARE = (0.55, 0.38)
"""Of the band, by which OP swings while play, or stick, rests, for a rest to count."""
LEVELS = 150
"""Averages of PV in a block, of which ranges are taken: noise does not make them."""
LEAST_RUN_AVERAGES = 4
"""In a rest that counts: its later half has a range."""
EDGE_SHARE = 0.05
"""Of a rest's OP at either end of its range that does not count: impulses at set-point moves."""
PV_EDGE_SHARE = 0.02
"""The same of PV."""
RESTS = ("idle", "share", "quiet", "travel", "straight")


Array = NDArray[np.float64]


def means_of(pv: Array) -> tuple[Array, float]:
    """Return averages of PV, and the range that most of them have."""
    m = max(len(pv) // LEVELS, 1)
    means = pv[: len(pv) // m * m].reshape(-1, m).mean(axis=1)
    ordered = np.sort(means)
    edge = int(PV_EDGE_SHARE * len(means))
    return means, max(float(ordered[len(means) - 1 - edge] - ordered[edge]), 1e-300)


@jit
def rests_of(op, v, w, shape, pv_means):
    """Return what is seen where the path rests while OP swings: `RESTS`.

    That is the number of such rests; their share of the time; median over them of PV's range in their later half over
    PV's range in the block; the path's way over the band; the third, where a straight line is taken out (what PV does
    behind an integrating process).
    """
    means, pv_range = pv_means
    n, m = len(op), len(op) // len(means)
    quiet, straight = np.empty(len(means)), np.empty(len(means))
    idle, time, travel, begin = 0, 0, 0.0, 0
    for k in range(1, n + 1):
        if k < n and v[k] == v[k - 1]:
            continue
        late = means[-(-(begin + (k - begin) // 2) // m) : min(k // m, len(means))]
        if (
            k - begin >= LEAST_RUN_AVERAGES * m
            and _range_of(op[begin:k]) > SWING_SHARE[shape] * w
            and len(late) > 1
        ):
            quiet[idle], straight[idle] = late.max() - late.min(), _bend_of(late)
            idle += 1
            time += k - begin
        if k < n:
            travel += abs(v[k] - v[k - 1])
        begin = k
    if idle == 0:
        return 0.0, 0.0, 1.0, travel / w, 1.0
    middle = median_of(quiet[:idle]) / pv_range, median_of(straight[:idle]) / pv_range
    return float(idle), time / n, middle[0], travel / w, middle[1]


@jit
def _range_of(op):
    """Return a rest's range of OP without its edges."""
    moved = op.copy()
    edge = int(EDGE_SHARE * len(moved))
    return nth(moved, len(moved) - 1 - edge) - nth(moved, edge)


@jit
def _bend_of(late):
    """Return the range of some values beside a straight line through them."""
    middle, up, down = 0.5 * (len(late) - 1), 0.0, 0.0
    for i in range(len(late)):
        up += (i - middle) * late[i]
        down += (i - middle) * (i - middle)
    low, high = np.inf, -np.inf
    for i in range(len(late)):
        beside = late[i] - (i - middle) * (up / down)
        low, high = min(low, beside), max(high, beside)
    return high - low
