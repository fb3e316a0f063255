"""What PV does while a valve's element rests though OP moves.

A band that is real shows in stretches in which OP swings and PV does nothing (derived).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.median import median

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


def rests_of(op: Array, v: Array, w: float, shape: int, pv_means: tuple[Array, float]) -> tuple[float, ...]:
    """Return what is seen where the path rests while OP swings: `RESTS`.

    That is the number of such rests; their share of the time; median over them of PV's range in their later half over
    PV's range in the block; the path's way over the band; the third, where a straight line is taken out (what PV does
    behind an integrating process).
    """
    n, (means, pv_range) = len(op), pv_means
    m = n // len(means)
    moves = np.diff(v)
    travel = float(np.abs(moves).sum()) / w
    ends = np.concatenate([[0], np.flatnonzero(moves) + 1, [n]])
    begins = ends[:-1]
    # what is left of a range without its edges is no larger than all of it
    ranges = np.maximum.reduceat(op, begins) - np.minimum.reduceat(op, begins)
    long = np.flatnonzero((np.diff(ends) >= LEAST_RUN_AVERAGES * m) & (ranges > SWING_SHARE[shape] * w))
    quiet, straight, share = [], [], 0
    for begin, end in zip(ends[long].tolist(), ends[long + 1].tolist(), strict=True):
        ordered = np.sort(op[begin:end])
        edge = int(EDGE_SHARE * len(ordered))
        if ordered[len(ordered) - 1 - edge] - ordered[edge] <= SWING_SHARE[shape] * w:
            continue
        late = means[-(-(begin + (end - begin) // 2) // m) : min(end // m, len(means))]
        if len(late) < 2:
            continue
        quiet.append(float(late.max() - late.min()))
        at = np.arange(len(late)) - 0.5 * (len(late) - 1)
        late = late - at * (float(at @ late) / float(at @ at))
        straight.append(float(late.max() - late.min()))
        share += end - begin
    if not quiet:
        return 0.0, 0.0, 1.0, travel, 1.0
    return (
        len(quiet),
        share / n,
        median(quiet) / pv_range,
        travel,
        median(straight) / pv_range,
    )
