"""What a well-tuned loop would do: the reference settings of a loop's structure, and their error.

The references are those of Veronesi & Visioli (2010 for integrating, 2009 for self-regulating processes), i.e.
SIMC (Skogestad 2003), with the closed-loop time tc free instead of tied to the dead time.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from monitor.contract.samples import Array
from monitor.identify.fit import Fit
from monitor.identify.response import closed_loop
from tuners.models import INTEGRATING, FloatOrArray, IntegratingModel, Model, SelfRegulatingModel
from tuners.responses import step_figures
from tuners.settings import Settings
from tuners.simc import simc_pd, simc_pi, simc_pid

SCANS_PER_TIME = 100.0
"""Scans of a simulated reference in its closed-loop time and dead time: 1 % of error, as of a scan's delay."""
MOST_SCANS = 50_000
"""Scans above which it is simulated more coarsely."""
LEAST_TC_PERIODS = 3.0
"""The default closed-loop time is at least these sample periods: what the data cannot resolve is not asked."""


def model_of(fit: Fit) -> Model:
    """Return the fit's model as the loop's controller meets it, without its uncertainty.

    What the controller adds of dead time (`Fit.extra_delay`) is in it. A PV filter counts with its whole time constant:
    the phase of ``1/(1 + jwT)`` is at least ``-wT`` and its gain at most 1, so this is on the safe side (derived).
    """
    dead_time = fit.dead_time + fit.extra_delay
    if fit.process == INTEGRATING:
        return IntegratingModel(fit.gain, dead_time, fit.lag)
    return SelfRegulatingModel(fit.gain, dead_time, fit.lag, fit.lag2)


def with_hold_delay(model: Model, period: float) -> Model:
    """Return the model as a controller that acts once a period meets it: half a period more of dead time.

    A fit sees OP as held from sample to sample, so its dead time leaves out the hold's own delay. That delay is
    in the loop where the controller samples as the data do, and in the data where the controller is faster.
    """
    return replace(model, dead_time=model.dead_time + 0.5 * period)


def settings_of(loop: Loop) -> Settings | None:
    """Return the loop's current settings in canonical form and units, None where they are not known."""
    return loop.settings


def reference_structure(loop: Loop) -> str:
    """Return the structure by which the loop is judged: ``p, pi, pd, pid``.

    PD only for a loop without integral action, or for set point alone where that is allowed.
    """
    if loop.allow_pd and loop.objective == SETPOINT:
        return "pd"
    return loop.structure


def reduced(model: Model, structure: str) -> Model:
    """Return the model on which the reference of a structure rests: PI and P see all lags as dead time (half rule).

    A PID on a self-regulating process is judged by the PI of the first-order model.
    """
    if isinstance(model, IntegratingModel):
        return model if structure in {"pid", "pd"} else model.without_lag()
    return model.first_order()


def closed_loop_time(loop: Loop, model: Model, period: float) -> float:
    """Return tc [s]: the loop's own, else the reduced model's dead time, but at least three sample periods."""
    if loop.closed_loop_time is not None:
        return loop.closed_loop_time
    return max(float(model.dead_time), LEAST_TC_PERIODS * period)


def structure_and_time(loop: Loop, model: Model, period: float) -> tuple[str, float]:
    """Return the structure of a loop's reference on a model, and its tc [s]."""
    structure = reference_structure(loop)
    return structure, closed_loop_time(loop, reduced(model, structure), period)


def reference_settings(model: Model, structure: str, tc: FloatOrArray) -> Settings:
    """Return the reference rule's settings (series or standard form; the rule's own).

    Raises
    ------
    ValueError
        The rule cannot serve this model (a self-regulating process that is dead time alone).

    Examples
    --------
    >>> model = IntegratingModel(gain=0.05, dead_time=4.0)
    >>> settings = reference_settings(model, "pi", tc=4.0)
    >>> settings.kp, settings.ti
    (2.5, 32.0)
    """
    if structure == "p":
        # the P part of the PD on all lags as dead time (derived)
        return replace(simc_pd(reduced(model, "p"), tc), td=0.0, tf=0.0)
    return {"pi": simc_pi, "pid": simc_pid, "pd": simc_pd}[structure](model, tc)


RULE = {"p": "simc-p", "pi": "simc-pi", "pid": "simc-pid", "pd": "simc-pd"}
"""Name of each structure's rule, as in ``loopsight tune --list`` (``simc-p``: ``simc-pd`` without its lead)."""


def reference_iae(
    kind: str, size: float, model: Model, structure: str, tc: float, b: float = 1.0, c: float = 1.0
) -> float:
    """Return the IAE [PV s] of the reference after a step of ``size`` (PV for a set-point, OP for a load step).

    Integrating (derived, checked by simulation): PD ``|Ar|(tc + theta)``; PID and PI
    ``|Ar|(theta + 4(tc + theta)/e)``, for I-PD ``|Ar|(4(tc + theta) + lag)`` (Ti of the standard
    form), load ``4|mu|(tc + theta)^2 |Ad|``. At
    ``tc = theta``: 2, 3.943, 8 and 16 times, as in Veronesi & Visioli (2010, eq. 10, for PD).
    Self-regulating with ``tau <= 4(tc + theta)``: ``|Ar|(tc + theta)`` and ``|mu|(tc + theta)|Ad|``; slower
    ones: load ``4|mu|(tc + theta)^2 |Ad|/tau``, set point by simulation. Other weights b, c: by simulation.
    NaN where no reference exists (no integral action under load).

    Examples
    --------
    >>> model = IntegratingModel(gain=1.0, dead_time=1.0)
    >>> round(reference_iae(LOAD, 1.0, model, "pid", tc=1.0, b=1.0, c=1.0), 3)
    16.0
    """
    reduced_model = reduced(model, structure)
    time, size = tc + float(reduced_model.dead_time), abs(size)
    integral = structure in {"pi", "pid"}
    if kind == LOAD:
        return _load_iae(reduced_model, time, size) if integral else math.nan
    if isinstance(reduced_model, SelfRegulatingModel):
        quick = float(reduced_model.lag) <= 4.0 * time
        return size * time if quick and b == 1.0 else size * _simulated(reduced_model, "pi", tc, b, c)
    if not integral:
        return size * time
    if b == 0.0 and c == 0.0:
        return size * (4.0 * time + float(reduced_model.lag))
    if b == 1.0 and (c == 1.0 or structure == "pi"):
        return size * (float(reduced_model.dead_time) + 4.0 * time / math.e)
    return size * _simulated(reduced_model, structure, tc, b, c)


def reference_error_along(
    time: Array, sp: Array, model: Model, structure: str, tc: float, b: float = 1.0, c: float = 1.0
) -> float:
    """Return the IAE [PV s] of the reference while the set point goes a way, from rest; by simulation.

    Parameters
    ----------
    time
        (n,) [s], rising.
    sp
        (n,) set point as deviation from its rest [PV], held from point to point.

    Raises
    ------
    ValueError
        The rule cannot serve this model.
    """
    reduced_model = reduced(model, structure)
    settings = replace(reference_settings(reduced_model, structure, tc), b=b, c=c).to("standard")
    span = float(time[-1] - time[0])
    step = max((tc + float(reduced_model.dead_time)) / SCANS_PER_TIME, span / MOST_SCANS)
    grid = time[0] + step * np.arange(int(span / step) + 1)
    r = sp[np.searchsorted(time, grid, side="right") - 1]
    kind = 0 if isinstance(reduced_model, IntegratingModel) else 1
    lag2 = float(getattr(reduced_model, "lag2", 0.0))
    process = float(reduced_model.gain), float(reduced_model.dead_time), float(reduced_model.lag), lag2
    controller = settings.kp, settings.ki, settings.kd, settings.filter_time, settings.b, settings.c
    y = closed_loop(r, step, kind, *process, *(float(x) for x in controller))
    return float(np.sum(np.abs(r - y))) * step


def _load_iae(model: Model, time: float, size: float) -> float:
    """Return the IAE [PV s] after a load step [OP] under integral action; ``time`` is tc and dead time [s]."""
    gain = abs(float(model.gain))
    if isinstance(model, IntegratingModel):
        return 4.0 * gain * time**2 * size
    lag = float(model.lag)
    return gain * time * size if lag <= 4.0 * time else 4.0 * gain * time**2 * size / lag


@lru_cache(maxsize=256)
def _simulated(model: Model, structure: str, tc: float, b: float, c: float) -> float:
    """Return the IAE [s] of the reference after a unit set-point step; an event asks for the same one several times."""
    settings = replace(reference_settings(model, structure, tc), b=b, c=c)
    return float(step_figures(model, settings).iae_setpoint[0])
