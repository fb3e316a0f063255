"""The set point that a controller works with, where its block ramps or filters the one that is recorded."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.settings import NotRepresentableError, Settings

ALIKE_SHARE = 0.1
"""Of the step, within which the two set points are the same: before the step, and at the end."""
APART_SHARE = 0.25
"""Of the step, from which their mean distance while it is gone says that they differ: a scan's delay brings less."""
BEYOND_SHARE = 0.15
"""Of the step, by which a ramp or a filter may leave the way from the old set point to the new one: noise does."""
MOST_AT_EXTREME_SAMPLES = 3
"""Samples at which OP may have its largest, or its least, value after the step."""
LEAST_SAMPLES = 8
"""Samples after the step in which the two must differ."""


class WorkingSetpoint(NamedTuple):
    """How the block moves its set point."""

    sp: Array
    """(n,) as the controller works with it [PV]."""
    rate: float
    """At which it goes the middle half of its way [PV/s]."""


def working_setpoint(window: EventWindow, settings: Settings, amplitude: float) -> WorkingSetpoint | None:
    """Return the set point that OP answers after a step of the recorded one; None where that is the recorded one.

    By the known settings of a PI, or P, controller: ``e(k) = (u(k) - u(k-1) + kp e(k-1))/(kp + ki h)``, and the set
    point is ``e + PV`` (derived). It counts where it was the recorded one before the step, and is again at the end,
    and goes from the one to the other in between: else the settings, or the controller, are not as thought.

    Parameters
    ----------
    amplitude
        Of the recorded set point [PV].
    """
    try:
        standard = settings.to("standard")
    except NotRepresentableError:
        return None
    kp, ki = float(standard.kp), float(standard.ki)
    kicks = standard.td == 0.0 and standard.b == 1.0 and math.isfinite(kp * ki) and kp != 0.0
    if not kicks or window.before < 2 or len(window) < window.before + LEAST_SAMPLES or _limited(window):
        return None
    return _way_of(window, _answered(window, kp, ki), amplitude)


def _limited(window: EventWindow) -> bool:
    """Whether OP rests at its extreme after the step, as at a limit: then it does not show what was asked for."""
    op = window.op[window.before :]
    return max(int(np.sum(op == np.max(op))), int(np.sum(op == np.min(op)))) > MOST_AT_EXTREME_SAMPLES


def _way_of(window: EventWindow, sp: Array, amplitude: float) -> WorkingSetpoint | None:
    """Return how a set point goes from the old to the new recorded one; None where it does not, or does at once."""
    after = window.before
    apart = np.abs(sp - window.sp) / abs(amplitude)
    way = (sp - window.sp[after - 1]) / amplitude
    gone = int(np.argmax(way[after:] > 1.0 - ALIKE_SHARE))
    known = np.max(apart[:after]) <= ALIKE_SHARE and np.mean(apart[-LEAST_SAMPLES:]) <= ALIKE_SHARE
    straight = np.min(way[after:]) >= -BEYOND_SHARE and np.max(way[after:]) <= 1.0 + BEYOND_SHARE
    if not known or not straight or gone < LEAST_SAMPLES:
        return None
    if np.mean(apart[after : after + gone]) < APART_SHARE:
        return None
    quarter, most = (after + int(np.argmax(way[after:] > share)) for share in (0.25, 0.75))
    taken = float(window.time[most] - window.time[quarter])
    return WorkingSetpoint(sp, abs(sp[most] - sp[quarter]) / taken) if taken > 0.0 else None


def _answered(window: EventWindow, kp: float, ki: float) -> Array:
    """Return the set point by which OP's moves are those of a PI controller; (n,) [PV]."""
    steps, moves = np.diff(window.time), np.diff(window.op)
    e = np.empty(len(window))
    e[0] = window.sp[0] - window.pv[0]
    for k in range(1, len(e)):
        e[k] = (moves[k - 1] + kp * e[k - 1]) / (kp + ki * steps[k - 1])
    return np.asarray(e + window.pv)
