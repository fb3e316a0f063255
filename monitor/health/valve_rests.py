"""What PV does while a valve's element rests though OP moves: compiled.

A band that is real shows in stretches in which OP swings and PV does nothing (derived).
"""

from __future__ import annotations

import numpy as np

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


@jit
def rests_of(op, pv, v, w, shape, first, out):
    """Find where the path rests while OP swings.

    Fills `out`: number of such rests; their share of the time; median over them of PV's range in their later half over
    PV's range in the block; the path's way over the band; the third, where a straight line is taken out (what PV
    does behind an integrating process).
    """
    n = len(op)
    m = max(n // LEVELS, 1)
    means = np.empty(n // m)
    for i in range(len(means)):
        means[i] = pv[i * m : (i + 1) * m].mean()
    ordered = np.sort(means)
    edge = int(PV_EDGE_SHARE * len(means))
    pv_range = max(ordered[len(means) - 1 - edge] - ordered[edge], 1e-300)
    quiets, straights = np.empty(n), np.empty(n)
    idle, share, travel, begin = 0, 0, 0.0, 0
    for t in range(1, n + 1):
        if t < n and v[t] == v[t - 1]:
            continue
        if t < n and t >= first:
            travel += abs(v[t] - v[t - 1])
        length = t - begin
        if length >= LEAST_RUN_AVERAGES * m and t > first:
            if _swing(op[begin:t]) > SWING_SHARE[shape] * w:
                low, high = (begin + length // 2 + m - 1) // m, min(t // m, len(means))
                if high - low >= 2:
                    quiets[idle], straights[idle] = _range(means[low:high])
                    idle += 1
                    share += length
        begin = t
    out[0], out[1], out[3] = idle, share / n, travel / w
    out[2] = out[4] = 1.0
    if idle > 0:
        out[2] = np.median(quiets[:idle]) / pv_range
        out[4] = np.median(straights[:idle]) / pv_range


@jit
def _swing(op):
    """Range of OP without the ends."""
    if op.max() == op.min():
        return 0.0
    ordered = np.sort(op)
    edge = int(EDGE_SHARE * len(op))
    return ordered[len(op) - 1 - edge] - ordered[edge]


@jit
def _range(x):
    """Range of values, as they are and without the line through their ends' halves."""
    n = len(x)
    mean, middle = x.mean(), 0.5 * (n - 1)
    slope = norm = 0.0
    for i in range(n):
        slope += (i - middle) * (x[i] - mean)
        norm += (i - middle) ** 2
    slope /= norm
    low, high = np.inf, -np.inf
    for i in range(n):
        left = x[i] - mean - slope * (i - middle)
        low, high = min(low, left), max(high, left)
    return x.max() - x.min(), high - low
