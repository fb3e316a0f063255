"""How well a loop that nothing has stepped holds its set point: the error in routine operation, against the least.

Without a step the dead time is not known, and so the minimum variance of T. J. Harris (1989) is not, either. But it
only grows with the dead time: from which one on there is nothing to gain can be said (derived).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .autocorrelation import ACF_LEVELS, seconds_of
from .harris import COVARIANCE_LAGS, covariance_of, least_shares

ROUTINE_BLOCKS = 8.0
"""Blocks of 64 samples without a step of the set point below which nothing is said: 20 coefficients of so many samples
take 4 % too much off the variance."""
LITTLE_GAIN_SHARE = 0.72
"""Of the error's variance that no controller could take away, from which on it is well regulated: 15 % of its standard
deviation are left to gain, which is what a suggestion must be worth."""
DIES_AT = math.exp(-1.0)
"""Autocorrelation at which an error has died away."""
COMES_BACK_AT = 0.5
"""Autocorrelation that, once it has gone below zero, tells a cycle."""
LEVEL_VOTES = 3.0
"""Blocks at a level of averaging below which it says nothing of how long an error lasts."""
BLOCK_DIES = (0.93, 1.68, 2.24, 2.72, 3.10, 3.44, 3.91, 4.26)
BLOCK_LASTS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Lag at which the autocorrelation in blocks of 64, each freed of its own mean and slope, falls to 1/e, and that of the
error itself [averages] (derived, exact for an exponential; in blocks nothing lasts longer than 5.5)."""


@dataclass(frozen=True, slots=True)
class Regulation:
    """The error of a loop in routine operation."""

    error_sd: float
    """Standard deviation [PV]."""
    memory: float
    """Time in which it dies away: to 1/e of its autocorrelation, noise left out [s]; inf where it was not seen to."""
    seen: float
    """Time over which that was looked for [s]."""
    cycle: float | None
    """Time after which it comes back [s]; None for an error that does not."""
    tight_from: float
    """Dead time of the process from which on no controller could take 15 % off the error's standard deviation [s]; 0:
    whatever it is; inf: none that was looked at."""


def regulation_of(own: Any, levels: Any, noise: float | None) -> Regulation | None:
    """Return what the error says in routine operation; None where too little was seen, or it does not move.

    Parameters
    ----------
    own
        Sums of the Harris index, of the samples without a step of the set point.
    levels
        The error's autocorrelation at levels of averaging.
    noise
        Standard deviation of PV's white noise [PV]; None where none is seen.
    """
    spacing = float(levels["spacing"])
    cov = covariance_of(own) if own["blocks"] >= ROUTINE_BLOCKS and spacing > 0.0 else None
    if cov is None:
        return None
    shares = least_shares(cov, COVARIANCE_LAGS - 1)
    tight = np.flatnonzero(shares >= LITTLE_GAIN_SHARE)
    # white noise is gone after one sample, whatever else there is
    own_variance = float(cov[0]) - min(noise or 0.0, math.sqrt(0.9 * float(cov[0]))) ** 2
    acf = np.concatenate([[1.0], cov[1:] / own_variance])
    memory, seen = spacing * _died(acf), spacing * (len(acf) - 1)
    for k in range(1, ACF_LEVELS):
        level, step = levels["levels"][k], seconds_of(levels, k)
        if math.isinf(memory) and level["votes"] >= LEVEL_VOTES:
            dies = _died(np.asarray(level["acf"], dtype=float) / float(level["votes"]))
            memory = step * float(np.interp(dies, BLOCK_DIES, BLOCK_LASTS, right=math.inf))
            seen = max(seen, step * BLOCK_LASTS[-1])
    return Regulation(
        error_sd=math.sqrt(float(cov[0])),
        memory=memory,
        seen=seen,
        cycle=_comes_back(acf, spacing),
        tight_from=_delay(int(tight[0]), spacing) if len(tight) else math.inf,
    )


def _delay(at: int, spacing: float) -> float:
    """Return the dead time of a place in `least_shares` [s]; 0 for the first: none is shorter than a sample."""
    return (at + 1) * spacing if at else 0.0


def _died(acf: Any) -> float:
    """Return the lag at which an autocorrelation first falls to `DIES_AT`, inf if it does not."""
    below = np.flatnonzero(acf <= DIES_AT)
    if not len(below):
        return math.inf
    k = int(below[0])
    before, after = float(acf[k - 1]), float(acf[k])
    return k - 1 + (before - DIES_AT) / (before - after)


def _comes_back(acf: Any, step: float) -> float | None:
    """Return the lag at which an autocorrelation that was below zero is highest, if it is high again [s]."""
    below = np.flatnonzero(acf < 0.0)
    if not len(below):
        return None
    top = int(below[0]) + int(np.argmax(acf[below[0] :]))
    return top * step if acf[top] >= COMES_BACK_AT else None
