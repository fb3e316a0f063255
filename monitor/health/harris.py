"""How much of the error's variance no controller could remove: the minimum-variance share of T. J. Harris.

T. J. Harris, Can. J. Chem. Eng. 67 (1989) 856-861; the noise's impulse response from an autoregressive model
(L. Desborough, T. J. Harris, Can. J. Chem. Eng. 70 (1992) 1186-1197).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from monitor.compiled import jit

from .autocorrelation import BLOCK, products

LAGS = 30
"""Autocovariances kept, the first the variance."""
ORDER = 20
"""Of the autoregressive model."""
LEAST = 16.0
"""Blocks without which nothing is said: a thousand samples."""

_f = np.float64
FIELDS = [("har_n", _f), ("har_sum", _f), ("har_cov", _f, (LAGS,))]


@jit
def correlate(h):
    """Add the block of the error that is full."""
    x = np.zeros(BLOCK + LAGS)
    total = 0.0
    for i in range(BLOCK):
        x[i] = h.block[0, i]
        total += x[i]
    h.har_n += 1.0
    h.har_sum += total
    r = np.zeros(LAGS)
    products(x, r)
    for lag in range(LAGS):
        h.har_cov[lag] += r[lag] / (BLOCK - lag)


@jit
def fade(h):
    """Halve the sums."""
    h.har_n *= 0.5
    h.har_sum *= 0.5
    for i in range(LAGS):
        h.har_cov[i] *= 0.5


def harris_of(h: Any, delay: int) -> float | None:
    """Return the minimum variance over that of the error, 1 where a controller can do no better.

    Parameters
    ----------
    h
        A loop's sums.
    delay
        Dead time in whole samples. The index holds for the loop's own sampling.
    """
    n = float(h["har_n"])
    if n < LEAST or not 1 <= delay < LAGS:
        return None
    mean = float(h["har_sum"]) / (n * BLOCK)
    cov = h["har_cov"] / n - mean * mean
    if not cov[0] > 1e-9 * mean * mean:
        return None
    model, left = _levinson(cov / cov[0])
    response = np.zeros(delay)
    response[0] = 1.0
    for k in range(1, delay):
        m = min(k, ORDER)
        response[k] = float(model[:m] @ response[k - m : k][::-1])
    share = float(left * (response @ response))
    return min(max(share, 0.0), 1.0) if math.isfinite(share) else None


def _levinson(acf: Any) -> tuple[Any, float]:
    """Solve the Yule-Walker equations; return the coefficients and the share of the variance that is left."""
    a = np.zeros(ORDER)
    left = 1.0
    for k in range(ORDER):
        reflection = (acf[k + 1] - a[:k] @ acf[k:0:-1]) / left
        if abs(reflection) >= 1.0:  # an estimate that is not positive definite: stop at the order before
            break
        a[:k] -= reflection * a[:k][::-1].copy()
        a[k] = reflection
        left *= 1.0 - reflection * reflection
    return a, left
