"""How alike residuals that follow each other are."""

from __future__ import annotations

from monitor.contract.samples import Array


def correlation_time(residual: Array) -> float:
    """How many residuals carry the information of one (1 for white noise): 1 + 2 sum of autocorrelations.

    Summed until they first fall below 0.05 (initial positive sequence, after Geyer 1992).
    """
    n = len(residual)
    power = float(residual @ residual)
    if power == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, n // 3):
        r = float(residual[lag:] @ residual[:-lag]) / power
        if r < 0.05:
            break
        total += 2.0 * r
    return min(total, n / 8)
