"""Values by their size: the k-th, median, quantiles, range; as NumPy's.

The first four are for compiled code, and move the values about: NumPy's own cost ten seconds of the first start there.
The others are for columns: a median is asked for some fifty times in an event, of which NumPy's takes 30 to 60 us, its
quantiles 200.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

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


def median(values: ArrayLike) -> float:
    """Return the median; NaN of none, or where one is missing.

    Examples
    --------
    >>> median([3.0, 1.0, 2.0, 10.0])
    2.5
    """
    column: Any = np.array(values, dtype=np.float64)
    return float(median_of(column)) if _complete(column) else math.nan


def quantile(values: ArrayLike, *shares: float) -> list[float]:
    """Return the quantiles, straight between neighbours; NaN of none, or where a value is missing.

    Examples
    --------
    >>> quantile([3.0, 1.0, 2.0, 10.0], 0.0, 0.5)
    [1.0, 2.5]
    """
    column: Any = np.array(values, dtype=np.float64)
    complete = _complete(column)
    return [float(quantile_of(column, share)) if complete else math.nan for share in shares]


def _complete(column: Any) -> bool:
    return len(column) > 0 and not np.isnan(column).any()
