"""Values by their size: the k-th of some, the middle one, one at a share (compiled).

NumPy's own, compiled, cost ten seconds of the first start.
"""

from __future__ import annotations

from monitor.compiled import jit


@jit
def nth(x, k):
    """Return the k-th of some values by size, which are moved about (C. A. R. Hoare 1961)."""
    low, high = 0, len(x) - 1
    while low < high:
        pivot, i, j = x[(low + high) // 2], low, high
        while i <= j:
            while x[i] < pivot:
                i += 1
            while x[j] > pivot:
                j -= 1
            if i <= j:
                x[i], x[j] = x[j], x[i]
                i, j = i + 1, j - 1
        low, high = (low, j) if k <= j else (i, high) if k >= i else (k, k)
    return x[k]


@jit
def median_of(x):
    """Return the median of some values, which are moved about."""
    return 0.5 * (nth(x, (len(x) - 1) // 2) + nth(x, len(x) // 2))


@jit
def quantile_of(x, share):
    """Return what a share of some values lie below, which are moved about: between two neighbours, as NumPy's."""
    at = share * (len(x) - 1)
    k = int(at)
    part = at - k
    low, high = nth(x, k), nth(x, min(k + 1, len(x) - 1))
    way = high - low
    return low + way * part if part < 0.5 else high - way * (1.0 - part)


@jit
def range_of(x):
    """Return the largest less the smallest of some values."""
    low = high = x[0]
    for v in x:
        low, high = min(low, v), max(high, v)
    return high - low
