"""What an archive does to samples: swinging-door compression, raw or interpolated, and exception reports."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def swinging_door(values: Array, deviation: float) -> NDArray[np.intp]:
    """Return which values are archived (E. H. Bristol, ISA Trans. 29 (1990) 89-97), the ends always."""
    kept = [0]
    low, high = -np.inf, np.inf
    for k in range(1, len(values)):
        start = kept[-1]
        steps = k - start
        low = max(low, (values[k] - deviation - values[start]) / steps)
        high = min(high, (values[k] + deviation - values[start]) / steps)
        if low > high:
            kept.append(k - 1)
            steps = 1
            low, high = values[k] - deviation - values[k - 1], values[k] + deviation - values[k - 1]
    if kept[-1] != len(values) - 1:
        kept.append(len(values) - 1)
    return np.array(kept)


def reports(values: Array, deadband: float) -> NDArray[np.intp]:
    """Return which values are reported: those that differ from the last report by more than the deadband."""
    kept = [0]
    for k in range(1, len(values)):
        if abs(values[k] - values[kept[-1]]) > deadband:
            kept.append(k)
    return np.array(kept)


def interpolated(values: Array, kept: NDArray[np.intp]) -> Array:
    """Draw straight lines between what is archived."""
    return np.interp(np.arange(len(values)), kept, values[kept])


def held(values: Array, kept: NDArray[np.intp]) -> Array:
    """Hold what is archived until the next."""
    return values[kept[np.searchsorted(kept, np.arange(len(values)), side="right") - 1]]
