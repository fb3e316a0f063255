"""The closed-loop index of an event (Veronesi & Visioli 2010) and its overshoot."""

from __future__ import annotations

import math

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from monitor.detect.event import MEAN_ABS_SD, SETPOINT_RAMP, SETTLED, ClosedEvent
from monitor.identify.fit import Fit
from monitor.identify.response import STEP, load_of_shape
from tuners.models import INTEGRATING

from .reference import model_of, reference_error_along, reference_iae, structure_and_time

LEAST_ERROR_POINTS = 33
"""Points at which the response to a load is looked at until it can be answered."""
MOST_WANDER_SHARE = 0.15
"""Of an event's error, up to which that of a wandering load changes its index by no more than the model's own error."""
MOST_OFF_REST_SHARE = 0.3
"""Of a load's excursion, by which PV may be off its set point before: that is not the load's error."""
BELOW_LEAST_SHARE = 0.9
"""Share of the least error that noise and the sampled integral may take off."""


def index(loop: Loop, event: ClosedEvent, fit: Fit) -> float | None:
    """CI_sp or CI_ld: the reference's IAE over the measured one (its noise's share taken off); None where none applies.

    None as well where the model would not allow so little error (`least_error`): then it is the model that is wrong;
    and of a set-point step beside which a load came: the error is that one's, too.
    Of an event that was cut short the IAE is a lower bound, so CI is an upper one. It is given where the error
    had died down to a tenth of the step, and where even the bound is too low.
    """
    if (fit.size is None and fit.other is not None) or drowns(event, fit):
        return None
    if event.kind == SETPOINT_RAMP:
        return _ramp_index(loop, event, fit)
    kind, size = (SETPOINT, event.amplitude) if fit.size is None else (LOAD, fit.size)
    found = index_on(loop, fit, (kind, size, event.iae - event.iae_noise), event.period)
    if found is None or beats_dead_time(event, fit) or (kind == LOAD and came_off_rest(event)):
        return None
    still_far = abs(event.offset) > 0.1 * abs(event.amplitude)
    if event.state != SETTLED and still_far and found >= loop.ci_min:
        return None
    return found


def drowns(event: ClosedEvent, fit: Fit) -> bool:
    """Whether the error that a wandering load leaves all the time is a large part of an event's."""
    if fit.wander is None:
        return False
    always = MEAN_ABS_SD * math.sqrt(max(event.error_sd**2 - event.noise**2, 0.0)) * event.duration
    return always > MOST_WANDER_SHARE * (event.iae - event.iae_noise)


def came_off_rest(event: ClosedEvent) -> bool:
    """Whether PV was far from its set point when a load came: the error is that of something before, too."""
    before = slice(0, max(event.window.before // 2, 1))
    away = float(np.mean((event.window.sp - event.window.pv)[before]))
    return abs(away) > MOST_OFF_REST_SHARE * abs(event.amplitude)


def index_on(loop: Loop, fit: Fit, happened: tuple[str, float, float], period: float) -> float | None:
    """Return the reference's IAE on a model over the one measured; None where none applies.

    Parameters
    ----------
    happened
        A step: its kind, its size (PV of a set-point, OP of a load step), and the error that it left, without noise
        [PV s].
    period
        Of the samples [s].
    """
    kind, size, error = happened
    model = model_of(fit)
    structure, tc = structure_and_time(loop, model, period)
    try:
        best = reference_iae(kind, size, model, structure, tc, loop.b, loop.c)
    except ValueError:
        return None
    return best / error if math.isfinite(best) and error > 0 else None


def _ramp_index(loop: Loop, event: ClosedEvent, fit: Fit) -> float | None:
    """Return the reference's IAE over the measured one for the set point's way; None where there was no rest before."""
    w, iae = event.window, event.iae - event.iae_noise
    if not w.rested or iae <= max(event.iae_noise, 0.0):  # a slow ramp's error drowns in the noise
        return None
    model = model_of(fit)
    structure, tc = structure_and_time(loop, model, event.period)
    try:
        best = reference_error_along(
            w.time[w.before :], w.sp[w.before :] - w.sp[0], model, structure, tc, loop.b, loop.c
        )
    except ValueError:
        return None
    return best / iae if math.isfinite(best) and best > 0.0 else None


def least_error(fit: Fit, size: float, dead_time: float) -> float:
    """Return the integrated absolute error below which no feedback comes after a step [PV s] (derived).

    Until a dead time has passed nothing that a controller does shows: a set-point step leaves all of its error that
    long. A load is seen when PV begins to move, and answered a dead time later: what it has done by then cannot be
    helped, without a lag ``|mu Ad| theta^2/2`` integrating and ``|K Ad| theta`` self-regulating.

    Parameters
    ----------
    size
        Of the step: of the set point [PV], or of the load [OP].
    dead_time
        The shortest that is held to be possible [s].
    """
    if fit.size is None:
        return abs(size) * dead_time
    width, shape = (fit.other.width, fit.other.shape) if fit.other is not None else (0.0, STEP)
    age = np.linspace(0.0, dead_time, LEAST_ERROR_POINTS)
    kind = 0 if fit.process == INTEGRATING else 1
    shown = load_of_shape(age, kind, abs(fit.gain), 0.0, fit.lag, fit.lag2, width, shape)
    return abs(size) * float(np.mean(0.5 * (shown[1:] + shown[:-1]))) * dead_time


def beats_dead_time(event: ClosedEvent, fit: Fit) -> bool:
    """Whether an event left less error than the model would allow any controller; only of one that has settled."""
    if event.state != SETTLED or event.kind == SETPOINT_RAMP:
        return False
    size = event.amplitude if fit.size is None else fit.size
    return event.iae - event.iae_noise < BELOW_LEAST_SHARE * least_error(
        fit, size, fit.interval("dead_time")[0]
    )


def overshoot(event: ClosedEvent) -> float:
    """How far PV went beyond the new set point, as a share of the step."""
    w = event.window
    beyond = (w.pv - w.sp)[w.before :] / event.amplitude
    return max(float(np.max(beyond)), 0.0) if len(beyond) else 0.0
