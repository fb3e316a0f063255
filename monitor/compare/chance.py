"""Whether a change is larger than chance: ratios with intervals, and nothing where there are too few values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special

from monitor.contract.changes import LEVEL

LEAST_SPELLS = 6
"""Spells of time below which their scatter is not known: of fewer, one is the rule and the next the exception."""
MOST_VALUES = 200
"""Newest values of each side that are compared by rank: more do not make the interval of a loop narrower than what
differs between two periods anyway."""


class Ratio(NamedTuple):
    """After over before, with its interval."""

    value: float
    low: float
    high: float


def ratio_of_events(before: Sequence[float], after: Sequence[float]) -> Ratio | None:
    """Return by which factor positive values have moved, whatever their distribution is; None where too few tell.

    The median of all pairwise ratios, with the interval that belongs to the rank test of Wilcoxon, Mann and Whitney
    (J. L. Hodges, E. L. Lehmann, Estimates of location based on rank tests, 1963; D. F. Bauer, 1972).

    Examples
    --------
    >>> ratio_of_events([0.2, 0.21, 0.19, 0.2, 0.22], [0.8, 0.84, 0.82, 0.79, 0.8]).value
    4.0
    >>> ratio_of_events([0.2, 0.21], [0.8, 0.84, 0.82]) is None
    True
    """
    x, y = (np.log(np.asarray(v[-MOST_VALUES:], dtype=float)) for v in (before, after))
    rank = _least_rank(*sorted((len(x), len(y))))
    if rank < 1:
        return None
    apart = np.sort((y[:, None] - x[None, :]).ravel())
    low, high = apart[rank - 1], apart[len(apart) - rank]
    return Ratio(*(round(math.exp(v), 12) for v in (float(np.median(apart)), float(low), float(high))))


@lru_cache(maxsize=4096)
def _least_rank(n: int, m: int) -> int:
    """Return the rank, from either end, of the pairwise differences that bound the interval; 0: too few values.

    The number of ways to each rank sum is the Gaussian binomial coefficient (Mann and Whitney 1947).
    """
    if n == 0:
        return 0
    if special.comb(n + m, n) < 2.0 / (1.0 - LEVEL):
        return 0
    ways = np.zeros(n * m + 1)
    ways[0] = 1.0
    for k in range(1, n + 1):
        ways[m + k :] -= ways[: -m - k].copy()  # times 1 - x^(m + k)
        padded = np.pad(ways, (0, -len(ways) % k)).reshape(-1, k)
        ways = padded.cumsum(axis=0).ravel()[: len(ways)]  # over 1 - x^k
    tail = np.cumsum(ways) / special.comb(n + m, n)
    return int(np.searchsorted(tail, (1.0 - LEVEL) / 2.0, side="right"))


def ratio_of_means(
    before: Sequence[tuple[float, float]], after: Sequence[tuple[float, float]]
) -> Ratio | None:
    """Return the ratio of two means over time; None where too few spells tell their scatter.

    The mean of each spell is taken for one observation (batch means: A. M. Law, J. S. Carson 1979), since samples near
    each other are alike; the interval is that of B. L. Welch (1947) for the logarithms of the means.

    Parameters
    ----------
    before, after
        Of each spell of time its mean and its length [s].
    """
    sides = [_mean(side) for side in (before, after)]
    if None in sides:
        return None
    (m0, v0, n0), (m1, v1, n1) = (side for side in sides if side is not None)
    variance = v0 + v1
    middle = math.log(m1 / m0)
    reach = 0.0
    if variance > 0.0:
        freedom = variance**2 / (v0**2 / (n0 - 1) + v1**2 / (n1 - 1))
        reach = float(special.stdtrit(freedom, (1.0 + LEVEL) / 2.0)) * math.sqrt(variance)
    return Ratio(math.exp(middle), math.exp(middle - reach), math.exp(middle + reach))


def _mean(spells: Sequence[tuple[float, float]]) -> tuple[float, float, int] | None:
    """Return a mean over spells, the relative variance of that mean, and their number; None where that is not known."""
    n = len(spells)
    if n < LEAST_SPELLS:
        return None
    values, weights = np.asarray(spells, dtype=float).T
    share = weights / weights.sum()
    mean = float(share @ values)
    if mean <= 0.0:
        return None
    spread = float(share**2 @ (values - mean) ** 2) * n / (n - 1)
    return mean, spread / mean**2, n
