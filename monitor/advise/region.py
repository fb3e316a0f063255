"""The models that the evidence allows: the surface of a fit's 95 % region, and how safe it is under a controller."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from monitor.assess.reference import with_hold_delay
from monitor.contract.samples import Array
from monitor.identify.fit import Fit, Valley
from tuners.models import INTEGRATING, IntegratingModel, Model, SelfRegulatingModel
from tuners.settings import Settings

from .worst_case import first_safe, worst_distance

RADIUS_SD = math.sqrt(7.815)
"""Radius, in sigma, of the 95 % region of three parameters (chi-squared, 3 degrees of freedom)."""

LEAST_LAG_S = 1e-9
"""The resolution of all times: a lag below it is none, and has no ratio [s]."""
LAG_SEEN_SD = 2.0
"""Sigmas from 0 from which a self-regulating process's lag is not in doubt."""
WAYS = np.array([np.array(s) / np.linalg.norm(s) for s in product((-1.0, 0.0, 1.0), repeat=3) if any(s)])
"""Axes, edges and corners of a cube: 26 directions of length 1."""


def uncertain_models(fit: Fit, period: float) -> Model:
    """Return models of the fit's 95 % region as a controller of this period [s] meets them, fields (M, 1).

    The first is the fit itself; then the ends of the region's axes, its edges and corners, the ends of two axes at the
    lag found, and the points where each coordinate is largest and least. The coordinates, with the joint covariance,
    are those in which the data speak (derived):

    - (ln |gain|, lag^2, lag + dead time). Lag and dead time are told apart by how much a response is rounded, which
      goes with the square of the lag (the second moment of the impulse response): a lag that was found too long may
      well be none at all, while far longer ones are excluded.
    - (ln |gain|, ln lag, dead time) for a self-regulating process whose lag is not in doubt: gain and lag share the
      slope, which is their ratio.

    Where the likely models lie on a bent valley (`Fit.valley`), the region follows it.

    Where the region reaches below a time of 0 it is cut: a point is drawn back towards the centre.
    """
    more = period + 2.0 * fit.extra_delay  # half of it is added
    if fit.valley is not None:
        return with_hold_delay(_along(fit, fit.valley), more)
    cov = _covariance(fit)
    scale = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    # of no unit, so that seconds and minutes agree
    values, vectors = np.linalg.eigh(cov / np.outer(scale, scale))
    axes = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    beside_lag = cov - np.outer(cov[1], cov[1]) / scale[1] ** 2
    at_lag = [sign * math.sqrt(max(beside_lag[k, k], 0.0)) * np.eye(3)[k] for k in (0, 2) for sign in (-1, 1)]
    extremes = [sign * cov[k] / scale[k] for k in range(3) for sign in (-1, 1)]
    offsets = RADIUS_SD * np.array([np.zeros(3), *(WAYS @ axes.T), *at_lag, *extremes])
    gain, lag, dead_time = (x[:, None] for x in _inside(fit, offsets))
    if fit.process == INTEGRATING:
        return with_hold_delay(IntegratingModel(gain, dead_time, lag), more)
    return with_hold_delay(SelfRegulatingModel(gain, dead_time, lag, np.full_like(lag, fit.lag2)), more)


def _by_ratio(fit: Fit) -> bool:
    """Whether the lag is uncertain by a factor, rather than by the rounding that it leaves."""
    least = max(LAG_SEEN_SD * math.sqrt(max(fit.cov[1, 1], 0.0)), LEAST_LAG_S)
    return fit.process != INTEGRATING and fit.lag > least


def _along(fit: Fit, valley: Valley) -> Model:
    """Return the fit, and the surface of the region about each model of a bent valley, fields (M, 1).

    What a model has lost of its likelihood is taken off the radius of the region about it, so that all lie on
    one surface.
    """
    near = valley.deficit < RADIUS_SD**2
    models, deficit = valley.models[near], valley.deficit[near]
    cov = valley.across + np.diag(fit.floor)
    scale = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    values, vectors = np.linalg.eigh(cov / np.outer(scale, scale))
    axes = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    directions = np.array([np.zeros(3), *(WAYS @ axes.T)])
    offsets = np.sqrt(RADIUS_SD**2 - deficit)[:, None, None] * directions
    times = models[:, None, 1:3]
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(offsets[..., 1:] < 0, times / -offsets[..., 1:], np.inf)
    offsets = offsets * np.minimum(room.min(axis=-1), 1.0)[..., None]
    gain = models[:, None, 0] * np.exp(np.clip(offsets[..., 0], -20.0, 20.0))
    lag, dead_time = (np.maximum(times + offsets[..., 1:], 0.0)[..., k] for k in (0, 1))
    second = np.broadcast_to(models[:, None, 3], gain.shape)
    columns = zip((fit.gain, fit.dead_time, fit.lag, fit.lag2), (gain, dead_time, lag, second), strict=True)
    return SelfRegulatingModel(*(np.concatenate([[one], np.ravel(many)])[:, None] for one, many in columns))


def _covariance(fit: Fit) -> Array:
    """Return the (3, 3) covariance of the region's coordinates."""
    turn = np.eye(3)
    if _by_ratio(fit):
        turn[1, 1] = 1.0 / fit.lag
    else:
        # of a normal variable's square: 4 mean^2 var + 2 var^2
        turn[1, 1] = 2.0 * math.sqrt(fit.lag**2 + fit.cov[1, 1] / 2.0)
        turn[2, 1] = 1.0
    return np.asarray(turn @ fit.cov @ turn.T)


def _inside(fit: Fit, offsets: Array) -> tuple[Array, Array, Array]:
    """Return gain, lag and dead time [s] (M,) at offsets (M, 3) of the coordinates, drawn back to times above 0."""
    by_ratio = _by_ratio(fit)

    def at(share: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        if by_ratio:
            lag = fit.lag * np.exp(np.clip(share * offsets[:, 1], -20.0, 20.0))
            dead_time = fit.dead_time + share * offsets[:, 2]
            return lag, np.maximum(dead_time, 0.0), dead_time >= 0
        square = fit.lag**2 + share * offsets[:, 1]
        lag = np.sqrt(np.maximum(square, 0.0))
        dead_time = fit.lag + fit.dead_time + share * offsets[:, 2] - lag
        return lag, np.maximum(dead_time, 0.0), (square >= 0) & (dead_time >= 0)

    low, high = np.zeros(len(offsets)), np.ones(len(offsets))
    low[at(high)[2]] = 1.0
    for _ in range(20):
        middle = (low + high) / 2
        allowed = at(middle)[2]
        low, high = np.where(allowed, middle, low), np.where(allowed, high, middle)
    lag, dead_time, _ = at(low)
    return fit.gain * np.exp(np.clip(low * offsets[:, 0], -20.0, 20.0)), lag, dead_time


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


def nominal(models: Model) -> Model:
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
