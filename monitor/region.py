"""The models that the evidence allows: the surface of a fit's 95 % region, and how safe it is under a controller."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tuners.models import IntegratingModel, Model, SelfRegulatingModel
from tuners.settings import Settings

from .identify import INTEGRATING, Array, Fit
from .reference import held
from .scan import first_safe, worst_distance

RADIUS = math.sqrt(7.815)
"""Radius, in sigma, of the 95 % region of three parameters (chi-squared, 3 degrees of freedom)."""


def uncertain_models(fit: Fit, period: float) -> Model:
    """Return models of the fit's 95 % region as a controller of this period [s] meets them, fields (M, 1).

    The first is the fit itself. The region lies in (ln |gain|, lag, dead time) with the joint covariance: its centre,
    axes, edges, corners, and the axes of gain and dead time at the lag found. Where it reaches below a time of 0 it
    is cut: a point is drawn back towards the centre until both times are allowed. (Setting the lag alone to 0 would
    keep the long dead time that only goes with a negative lag.)
    """
    values, vectors = np.linalg.eigh(fit.cov)
    axes = vectors * np.sqrt(np.maximum(values, 0.0))
    signs = [np.array(s) for s in product((-1.0, 0.0, 1.0), repeat=3) if any(s)]
    directions = [s / np.linalg.norm(s) for s in signs]  # axes, edges and corners: 26 ways
    beside_lag = fit.cov - np.outer(fit.cov[1], fit.cov[1]) / max(fit.cov[1, 1], 1e-300)
    at_lag = [sign * math.sqrt(max(beside_lag[k, k], 0.0)) * np.eye(3)[k] for k in (0, 2) for sign in (-1, 1)]
    offsets = RADIUS * np.array([np.zeros(3), *(d @ axes.T for d in directions), *at_lag])
    centre = np.array([fit.lag, fit.dead_time])
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(offsets[:, 1:] < 0, centre / -offsets[:, 1:], np.inf)
    points = offsets * np.minimum(room.min(axis=1), 1.0)[:, None]
    gain = (fit.gain * np.exp(np.clip(points[:, 0], -20.0, 20.0)))[:, None]
    lag = np.maximum(fit.lag + points[:, 1], 0.0)[:, None]
    dead_time = np.maximum(fit.dead_time + points[:, 2], 0.0)[:, None]
    if fit.process == INTEGRATING:
        return held(IntegratingModel(gain, dead_time, lag), period)
    return held(SelfRegulatingModel(gain, dead_time, lag, np.full_like(lag, fit.lag2)), period)


def fastest_safe(models: Model, candidates: Settings, ms_max: float) -> NDArray[np.int64]:
    """Return for each row of candidates (R, T), fast to slow, the first that keeps Ms on all models; T: none."""
    return np.asarray(
        first_safe(*_models(models), _settings(candidates), candidates.form == "series", ms_max)
    )


def worst_peaks(models: Model, settings: Settings) -> Array:
    """Ms of the worst model for each of the settings (T,), to 1 %; inf where one is unstable."""
    many = np.atleast_2d(_settings(settings))
    worst = [worst_distance(*_models(models), one, settings.form == "series") for one in many]
    return np.array([1.0 / w if w > 0 else math.inf for w in worst])


def found(models: Model) -> Model:
    """Return the first of some models, the fit itself, with fields (1,)."""
    gain, dead_time, *lags = (np.ravel(x)[:1] for x in (models.gain, models.dead_time, *models.lags))
    if isinstance(models, IntegratingModel):
        return IntegratingModel(gain, dead_time, *lags)
    return SelfRegulatingModel(gain, dead_time, *lags)


def _models(models: Model) -> tuple[Array, int]:
    """Return (M, 4) gain, dead time, lag, second lag, and the number of integrators, for the compiled part."""
    lags = (*models.lags, 0.0)[:2]
    columns = np.broadcast_arrays(*(np.ravel(x) for x in (models.gain, models.dead_time, *lags)))
    return np.stack(columns, axis=-1).astype(np.float64), int(models.process == INTEGRATING)


def _settings(settings: Settings) -> Array:
    """Return (..., 4) kp, ti, td, tf, for the compiled part."""
    columns = np.broadcast_arrays(settings.kp, settings.ti, settings.td, settings.filter_time)
    return np.stack(columns, axis=-1).astype(np.float64)
