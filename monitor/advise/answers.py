"""How a loop answers a step today and after the retune, with the band of the models that the evidence allows."""

from __future__ import annotations

import math

import numpy as np

from monitor.assess.reference import settings_of
from monitor.contract.evidence import Answers
from monitor.contract.loops import Loop
from monitor.contract.samples import Array
from monitor.identify.fit import Fit
from tuners.curves import step_curves
from tuners.models import IntegratingModel, Model, SelfRegulatingModel
from tuners.responses import closed_loop_response
from tuners.settings import Settings

from .prediction import KINDS
from .region import uncertain_models, worst_peaks

POINTS = 121
"""Of each curve: what a picture of a few hundred pixels shows."""
LONGEST_T0, SHORTEST_T0 = 60.0, 6.0
"""A picture's length in T0: what takes longer is shown as far as it goes, what is faster has room."""
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
    models = _ends(uncertain_models(fit, period), both)
    found = []
    for kind in KINDS:
        time = np.linspace(0.0, _length(models, both, kind), POINTS)
        found.append(
            Answers(
                loop=loop.name,
                kind=kind,
                time=time,
                today=_curves(models, today, kind, time),
                new=_curves(models, new, kind, time),
            )
        )
    return tuple(found)


def _curves(models: Model, settings: Settings | None, kind: str, time: Array) -> Array:
    """Return the model's response and the least and largest of all (3, n); NaN where unknown, or without bound."""
    if settings is None:
        return np.full((3, len(time)), math.nan)
    curves = step_curves(models, settings, kind, time)
    # an unstable model has no bound: its NaN makes the band NaN, which is what it is
    return np.stack([curves[0], curves.min(axis=0), curves.max(axis=0)])


def _length(models: Model, both: list[Settings], kind: str) -> float:
    """Return how long a picture has to be for both responses [s]."""
    nominal = _at(models, [0])
    t0 = max(float(np.ravel(nominal.t0)[0]), 1e-6)
    gain, dead_time, *lags = (float(np.ravel(x)[0]) for x in (nominal.gain, nominal.dead_time, *nominal.lags))
    model = type(nominal)(gain, dead_time, *lags)
    slowest = max(_settled(closed_loop_response(model, s, kind).settling_time) for s in both)
    return min(max(SHOWN_SETTLING_TIMES * slowest, SHORTEST_T0 * t0), LONGEST_T0 * t0)


def _settled(time: float) -> float:
    return time if math.isfinite(time) else 0.0


def _ends(models: Model, both: list[Settings]) -> Model:
    """Return the fit and the ends of its region, each once."""
    columns = np.stack(
        np.broadcast_arrays(*map(np.ravel, (models.gain, models.dead_time, *models.lags))), axis=-1
    )
    picked = [0]
    for column in (np.abs(columns[:, 0]), *columns.T[1:]):
        picked += [int(column.argmin()), int(column.argmax())]
    for settings in both:
        peaks = [worst_peaks(_at(models, [k]), settings)[0] for k in range(len(columns))]
        picked.append(int(np.argmax(peaks)))
    return _at(models, list(dict.fromkeys(picked)))


def _at(models: Model, rows: list[int]) -> Model:
    """Return some of the models, fields (M, 1)."""
    size = np.broadcast(models.gain, models.dead_time, *models.lags).size
    gain, dead_time, *lags = (
        np.broadcast_to(np.ravel(x), size)[rows][:, np.newaxis]
        for x in (models.gain, models.dead_time, *models.lags)
    )
    if isinstance(models, IntegratingModel):
        return IntegratingModel(gain, dead_time, *lags)
    return SelfRegulatingModel(gain, dead_time, *lags)
