"""Whether a response shows by itself that its loop is well damped, where Ms is not known."""

from __future__ import annotations

import numpy as np

from monitor.contract.samples import Array
from monitor.detect.event import LOAD_STEP, SETTLED, ClosedEvent

MOST_SWING_RATIO = 0.4
"""Of a swing in the one before it, to the other side: a damping of 0.28, where Ms of a second-order loop is about 2.1
(at 0.5, the quarter decay of the old rules, it is 2.7)."""
MOST_FIRST_RATIO = 0.5
"""Of the overshoot in a set-point step: a PI on an integrating process goes 30 % beyond at any damping."""
SWING_FLOOR_SD, SWING_FLOOR_SHARE = 4.0, 0.03
"""Standard deviations of the error when quiet, and share of the response: smaller swings are not told from noise."""
CLEAR_FLOOR_SHARE = 0.1
"""Of the response that the floor may be for the swings to be seen at all."""


def is_damped(event: ClosedEvent) -> bool | None:
    """Whether each swing of the error is much smaller than the one before; None where the response does not show it.

    The swings are the error's largest sizes on alternating sides of the set point: the step itself, or the first
    excursion after a load, and what follows.
    """
    if event.state != SETTLED:
        return None
    w = event.window
    sizes = swings((w.sp - w.pv)[w.before :], floor_of(event))
    if not len(sizes) or floor_of(event) > CLEAR_FLOOR_SHARE * float(sizes[0]):
        return None
    ratios = sizes[1:] / sizes[:-1]
    allowed = np.full(len(ratios), MOST_SWING_RATIO)
    if event.kind != LOAD_STEP:
        allowed[:1] = MOST_FIRST_RATIO
    return bool(np.all(ratios <= allowed))


def floor_of(event: ClosedEvent) -> float:
    """Return the size up to which a swing is not told from noise or resolution [PV]."""
    return max(SWING_FLOOR_SD * event.error_sd, SWING_FLOOR_SHARE * abs(event.amplitude), event.quantum)


def swings(e: Array, floor: float) -> Array:
    """Return the sizes of an error's swings, alternately to either side, beyond ``floor``.

    Examples
    --------
    >>> swings(np.array([1.0, 0.4, -0.3, -0.1, 0.02, 0.1]), 0.05)
    array([1. , 0.3, 0.1])
    """
    beyond = e[np.abs(e) > floor]
    if not len(beyond):
        return beyond
    first = np.flatnonzero(np.diff(np.sign(beyond), prepend=0.0))
    return np.asarray(np.maximum.reduceat(np.abs(beyond), first))
