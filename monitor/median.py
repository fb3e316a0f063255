"""The median of a few numbers: as NumPy's, without what its own costs around it.

It is asked for some fifty times in an event, of columns of some hundred values, of which NumPy's takes 30 to 60 us.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def median(values: ArrayLike) -> float:
    """Return the median; NaN of none, or where one is missing.

    Examples
    --------
    >>> median([3.0, 1.0, 2.0, 10.0])
    2.5
    """
    column: Any = np.asarray(values)
    n = len(column)
    if n == 0:
        return math.nan
    low, high = (n - 1) // 2, n // 2
    parted = np.partition(column, (low, high, n - 1))  # NaN come last
    return float(0.5 * (parted[low] + parted[high])) if parted[-1] == parted[-1] else math.nan
