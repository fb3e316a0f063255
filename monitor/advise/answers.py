"""How a loop answers a step today and after the retune, with the band of the models that the evidence allows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.assess.reference import settings_of
from monitor.contract.evidence import Answers
from monitor.contract.loops import Loop
from monitor.contract.samples import Array
from monitor.identify.fit import Fit
from tuners.curves import step_curves
from tuners.models import Model
from tuners.robustness import peak_sensitivity
from tuners.settings import Settings

from .prediction import KINDS
from .region import uncertain_models

POINTS = 121
"""Of each curve: what a picture of a few hundred pixels shows."""
LONGEST_T0, SHORTEST_T0, LONGEST_TI = 60.0, 6.0, 12.0
"""A picture's length in T0, and in the longest integral time, which makes a level roll for far more than 60 T0: what
takes longer is shown as far as it goes, what is faster has room."""
LEAST_T0_S, LOOKED_AT_POINTS, SETTLED_SHARE = 1e-6, 601, 0.02
"""T0 of a process without any; points on which a response is looked at for its end, and the usual 2 % band about it."""
SHOWN_SETTLING_TIMES = 1.3
"""Settling times of the slower response that a picture shows: that it has come to rest is seen."""


def answers(loop: Loop, fit: Fit, period: float, new: Settings | None) -> tuple[Answers, ...]:
    """Return the responses to a unit set-point and load step, by today's settings and by new ones.

    The band is that of the models at the ends of the fit's region: largest and least gain, dead time and lag, and
    those that are worst for today's and for the new settings.

    Parameters
    ----------
    loop
        With the settings of today, where known.
    fit
        Process with its uncertainty.
    period
        Sample period [s].
    new
        Suggested settings; None where there are none.
    """
    today = settings_of(loop)
    both = [s for s in (today, new) if s is not None]
    if not both:
        return ()
    models = uncertain_models(fit, period)
    stable = [np.ravel(peak_sensitivity(models, s)) for s in both]
    rows = _ends(models, stable)
    ends = _at(models, rows)
    known = [(s, np.isfinite(peaks[rows])) for s, peaks in zip(both, stable, strict=True)]
    found = []
    for kind in KINDS:
        time = np.linspace(0.0, _length(ends, known, kind), POINTS)
        curves = [_curves(ends, *one, kind, time) for one in known]
        unknown = np.full((3, POINTS), math.nan)
        found.append(
            Answers(
                loop=loop.name,
                kind=kind,
                time=time,
                today=unknown if today is None else curves[0],
                new=unknown if new is None else curves[-1],
            )
        )
    return tuple(found)


def _curves(models: Model, settings: Settings, stable: NDArray[np.bool_], kind: str, time: Array) -> Array:
    """Return the first model's response, and the least and largest of all (3, n); NaN where there is no bound."""
    curves = step_curves(models, settings, kind, time, stable)
    # an unstable model has no bound: its NaN makes the band NaN, which is what it is
    return np.stack([curves[0], curves.min(axis=0), curves.max(axis=0)])


def _length(models: Model, known: list[tuple[Settings, NDArray[np.bool_]]], kind: str) -> float:
    """Return how long a picture has to be for the responses of the first model [s]."""
    nominal = _at(models, [0])
    t0 = max(float(np.ravel(nominal.t0)[0]), LEAST_T0_S)
    longest = max(LONGEST_T0 * t0, *(LONGEST_TI * float(s.ti) for s, _ in known if math.isfinite(s.ti)), 0.0)
    time = np.linspace(0.0, longest, LOOKED_AT_POINTS)
    settled = 0.0
    for settings, stable in known:
        if stable[0]:
            pv = step_curves(nominal, settings, kind, time, stable[:1])[0]
            moving = np.flatnonzero(np.abs(pv - pv[-1]) > SETTLED_SHARE * np.abs(pv).max())
            settled = max(settled, float(time[moving[-1]]) if len(moving) else 0.0)
    return min(max(SHOWN_SETTLING_TIMES * settled, SHORTEST_T0 * t0), longest)


def _ends(models: Model, peaks: list[Array]) -> list[int]:
    """Return the rows of the fit, which is the first, and of the ends of its region, each once."""
    columns = np.broadcast_arrays(*map(np.ravel, (models.gain, models.dead_time, *models.lags)))
    picked = [0]
    for column in (np.abs(columns[0]), *columns[1:]):
        picked += [int(column.argmin()), int(column.argmax())]
    return list(dict.fromkeys([*picked, *(int(np.argmax(p)) for p in peaks)]))


def _at(models: Model, rows: list[int]) -> Model:
    """Return some of the models, fields (M, 1)."""
    size = np.broadcast(models.gain, models.dead_time, *models.lags).size
    gain, dead_time, *lags = (
        np.broadcast_to(np.ravel(x), size)[rows][:, np.newaxis]
        for x in (models.gain, models.dead_time, *models.lags)
    )
    return type(models)(gain, dead_time, *lags)
