"""How much of the error's variance no controller could remove: the minimum-variance share of T. J. Harris.

T. J. Harris, Can. J. Chem. Eng. 67 (1989) 856-861; the noise's impulse response from an autoregressive model
(L. Desborough, T. J. Harris, Can. J. Chem. Eng. 70 (1992) 1186-1197).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from monitor.compiled import jit

from .block import BLOCK_LENGTH, add_products
from .fields import halving

COVARIANCE_LAGS = 30
"""Autocovariances kept, the first the variance."""
MODEL_ORDER = 20
"""Of the autoregressive model."""
HARRIS_BLOCKS = 16.0
"""Blocks without which nothing is said: a thousand samples."""

SUMS: list[Any] = [
    ("blocks", "f8"),  # blocks of 64 samples without a step of the set point
    ("error", "f8"),  # [PV] of their samples
    ("covariance", "f8", (COVARIANCE_LAGS,)),  # [PV^2] mean products of errors 0, 1, 2, ... samples apart
]
RUNNING: list[Any] = []
KEPT: list[Any] = []
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)


@jit
def update_block(own, block):
    """Add a block of errors [PV] in which the set point has not stepped."""
    x = np.zeros(BLOCK_LENGTH + COVARIANCE_LAGS)
    total = 0.0
    for i in range(BLOCK_LENGTH):
        x[i] = block[i]
        total += x[i]
    own.blocks += 1.0
    own.error += total
    r = np.zeros(COVARIANCE_LAGS)
    add_products(x, r)
    for lag in range(COVARIANCE_LAGS):
        own.covariance[lag] += r[lag] / (BLOCK_LENGTH - lag)


def harris_of(own: Any, delay: int) -> float | None:
    """Return the minimum variance over that of the error, 1 where a controller can do no better.

    Parameters
    ----------
    own
        A loop's sums.
    delay
        Dead time in whole samples. The index holds for the loop's own sampling.
    """
    if own["blocks"] < HARRIS_BLOCKS or not 1 <= delay < COVARIANCE_LAGS:
        return None
    cov = covariance_of(own)
    if cov is None:
        return None
    share = float(least_shares(cov, delay)[-1])
    return min(max(share, 0.0), 1.0) if math.isfinite(share) else None


def covariance_of(own: Any) -> Any:
    """Return the error's autocovariance (COVARIANCE_LAGS,), from lag 0 on [PV^2]; None where the error is constant."""
    n = float(own["blocks"])
    if n == 0.0:
        return None
    mean = float(own["error"]) / (n * BLOCK_LENGTH)
    cov = own["covariance"] / n - mean * mean
    return cov if cov[0] > 1e-9 * mean * mean else None


def least_shares(cov: Any, most: int) -> Any:
    """Return the share of the variance that no controller takes away, for dead times of 1 to ``most`` samples (most,).

    Parameters
    ----------
    cov
        Autocovariance from lag 0 on [PV^2].
    """
    model, left = _levinson(cov / cov[0])
    response = np.zeros(most)
    response[0] = 1.0
    for k in range(1, most):
        m = min(k, MODEL_ORDER)
        response[k] = float(model[:m] @ response[k - m : k][::-1])
    return left * np.cumsum(response * response)


def spread_of(own: Any) -> float | None:
    """Return the root mean square of the error [PV], None before a block is full."""
    n = float(own["blocks"])
    return math.sqrt(max(float(own["covariance"][0] / own["blocks"]), 0.0)) if n > 0 else None


def _levinson(acf: Any) -> tuple[Any, float]:
    """Solve the Yule-Walker equations; return the coefficients and the share of the variance that is left.

    `scipy.linalg.solve_toeplitz` gives the same to rounding, but anything where the estimate is not positive definite:
    then the order before is the answer.
    """
    a = np.zeros(MODEL_ORDER)
    left = 1.0
    for k in range(MODEL_ORDER):
        reflection = (acf[k + 1] - a[:k] @ acf[k:0:-1]) / left
        if abs(reflection) >= 1.0:
            left = left if k else 0.0  # an error that is all trend can be foretold
            break
        a[:k] -= reflection * a[:k][::-1].copy()
        a[k] = reflection
        left *= 1.0 - reflection * reflection
    return a, left
