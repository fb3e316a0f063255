"""The closed-loop index of an event (Veronesi & Visioli 2010) and its overshoot."""

from __future__ import annotations

import math

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from monitor.detect.event import SETTLED, ClosedEvent
from monitor.identify.fit import Fit

from .reference import (
    closed_loop_time,
    model_of,
    reduced,
    reference_iae,
    reference_structure,
)


def index(loop: Loop, event: ClosedEvent, fit: Fit) -> float | None:
    """CI_sp or CI_ld: the reference's IAE over the measured one (its noise's share taken off); None where none applies.

    Of an event that was cut short the IAE is a lower bound, so CI is an upper one. It is given where the error
    had died down to a tenth of the step, and where even the bound is too low.
    """
    model = model_of(fit)
    structure = reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), event.period)
    try:
        kind, size = (SETPOINT, event.amplitude) if fit.size is None else (LOAD, fit.size)
        best = reference_iae(kind, size, model, structure, tc, loop.b, loop.c)
    except ValueError:
        return None
    iae = event.iae - event.iae_noise
    if not math.isfinite(best) or iae <= 0:
        return None
    still_far = abs(event.offset) > 0.1 * abs(event.amplitude)
    if event.state != SETTLED and still_far and best / iae >= loop.ci_min:
        return None
    return best / iae


def overshoot(event: ClosedEvent) -> float:
    """How far PV went beyond the new set point, as a share of the step."""
    w = event.window
    beyond = (w.pv - w.sp)[w.before :] / event.amplitude
    return max(float(np.max(beyond)), 0.0) if len(beyond) else 0.0
