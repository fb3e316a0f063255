"""Closed-loop step responses of many processes under one controller, on a grid of times: the band that models span.

As in `responses`: the answer to a square wave, from the frequency response, with exact dead time. Here the points are
as many as a picture needs, so that a dozen models cost what one exact response costs.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tuners.models import SELF_REGULATING, Array, Model, SelfRegulatingModel
from tuners.responses import _final_value, _half_waves
from tuners.robustness import peak_sensitivity
from tuners.settings import Settings
from tuners.spectrum import first_window, points

CURVE_POINTS = 1 << 10, 1 << 13
"""Least and most samples of half a period: a picture shows some hundred of them."""
LONGEST_WINDOWS = 20.0
"""Lengths of the picture within which the slowest loop may come to rest: what is slower still is cut."""


def step_curves(
    models: Model, settings: Settings, kind: str, time: Array, stable: NDArray[np.bool_] | None = None
) -> Array:
    """Return PV after a unit step for each of the models (M, n); NaN where the loop is unstable.

    Parameters
    ----------
    models
        Processes, fields (M, 1).
    settings
        One controller, scalar fields.
    kind
        ``setpoint`` (unit [PV]) or ``load`` (unit [OP], added to OP).
    time
        From the step on, increasing from 0 (n,) [s].
    stable
        With which of the models the loop is stable (M,), where that is known already.

    Raises
    ------
    ValueError
        For another kind.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> two = IntegratingModel(gain=np.array([[1.0], [1.2]]), dead_time=np.array([[1.0], [1.0]]))
    >>> step_curves(two, Settings(kp=0.5, ti=8.0), "setpoint", np.array([0.0, 2.0, 40.0])).round(2)
    array([[0.  , 0.53, 1.  ],
           [0.  , 0.64, 1.  ]])
    """
    if kind not in {"setpoint", "load"}:
        raise ValueError(f"kind = {kind!r}: must be 'setpoint' or 'load'")
    gain, dead_time, *lags = np.broadcast_arrays(
        *map(np.atleast_2d, (models.gain, models.dead_time, *models.lags))
    )
    if models.process == SELF_REGULATING:  # one without any lag would answer with a jump
        lags[0] = np.where(sum(lags) > 0, lags[0], np.maximum(dead_time, 1e-9) / 1000)
        models = SelfRegulatingModel(gain, dead_time, *lags)
    if settings.td != 0 and settings.tf == 0:
        settings = replace(settings, tf=settings.td / 1000)
    if stable is None:
        stable = np.isfinite(np.atleast_1d(np.ravel(peak_sensitivity(models, settings))))
    curves = np.full((len(gain), len(time)), math.nan)
    if not stable.any():
        return curves
    kept = type(models)(gain[stable], dead_time[stable], *(lag[stable] for lag in lags))
    curves[stable] = _curves(kept, settings, kind, time)
    return curves


def _curves(models: Model, settings: Settings, kind: str, time: Array) -> Array:
    """Return the curves (M, n) of models, fields (M, 1), with each of which the loop is stable."""
    window = np.clip(first_window(models, settings), 1.05 * time[-1], LONGEST_WINDOWS * time[-1])
    count = points(models, settings, window, 0.1, *CURVE_POINTS)
    omega = np.arange(1, 2 * count, 2) * (math.pi / window)[:, np.newaxis]
    process = models.frequency_response(omega)
    closed = process / (1 + process * settings.frequency_response(omega))
    if kind == "setpoint":
        closed = closed * settings.setpoint_response(omega)
    final = np.broadcast_to(np.asarray(_final_value(models, settings, kind), dtype=float), (len(window), 1))
    pv = _half_waves(closed) + final / 2
    delays = np.broadcast_to(np.ravel(models.dead_time), len(window))
    curves = np.empty((len(window), len(time)))
    for out, row, span, delay in zip(curves, pv, window, delays, strict=True):
        grid = np.linspace(0.0, span, count, endpoint=False)
        out[:] = np.interp(time, grid, np.where(grid <= delay, 0.0, row))
    return curves
