"""The path of OP's averages at one level of averaging, behind a deadband as wide as the noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit

from .fields import clearing, halving

DEADBAND_SD = 1.5
"""Standard deviations of OP's noise to either side within which it does not move: swings of less than three are no
path."""
AVERAGE_DEADBAND_SD = 3.0
"""And standard deviations of what the averages leave of the noise."""
TOP_SHARE = 0.2
"""Share of a path's averages that lie about as far out as its end."""

SUMS: list[Any] = [
    ("squares", "f8"),  # [OP^2] differences of neighbouring averages, squared
    ("path", "f8"),  # [OP] how far the deadband was moved
    ("differences", "f4"),
    ("turns", "f4"),
]
RUNNING: list[Any] = []
KEPT: list[Any] = [  # set by the first average
    ("last", "f8"),  # [OP] last average
    ("middle", "f8"),  # [OP] of the deadband
    ("side", "f4"),  # 1 or -1: last moved upwards or downwards, 0 neither
    ("since", "f4"),  # averages since the last turn
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)
forget = clearing(SUMS)


@jit
def begin(own, y):
    """Lay the deadband around an average ``y`` [OP]."""
    own.middle = y
    own.side = own.since = 0.0


@jit
def update(own, y, op_noise, noise):
    """Move the deadband along with an average ``y`` [OP] whose noise is ``noise`` [OP], OP's own being ``op_noise``."""
    own.since += 1.0
    band = max(DEADBAND_SD * op_noise, AVERAGE_DEADBAND_SD * noise)
    if y > own.middle + band:
        path, side = y - band - own.middle, 1.0
        own.middle = y - band
    elif y < own.middle - band:
        path, side = own.middle - y - band, -1.0
        own.middle = y + band
    else:
        return
    own.path += path
    if side != own.side:
        if own.side != 0.0:
            own.turns += 1.0
            # what the deadband cut off at both ends, less the noise's own peaks: the largest of n normal numbers is
            # 0.5 + 0.42 ln n (to 0.1 from 5 to 1000)
            peak = 0.5 + 0.42 * np.log(max(TOP_SHARE * own.since, 1.0))
            own.path += 2.0 * max(band - peak * noise, 0.0)
        own.side = side
        own.since = 0.0
