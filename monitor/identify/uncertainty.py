"""How far other models reach that explain a window as well."""

from __future__ import annotations

import math

import numpy as np

from monitor.by_size import median
from monitor.contract.samples import Array

from .correlation import correlation_time
from .fit import DIRECT, Z95, Fit
from .projection import (
    MOST_SHARE,
    P_DEAD_TIME,
    P_LAG,
    P_SHARE,
    P_WIDTH,
    Columns,
    evaluate,
    of_pulses,
    slopes,
    unit_responses,
)
from .response import LAG, START, STEP
from .window import SearchWindow

LN_GAIN_FLOOR_SD = 0.01
"""One sigma of model mismatch in ln gain: a half-rule model of a fourth-order plant is 1 % off without noise."""
INDIRECT_LN_GAIN_FLOOR_SD = 0.02
"""The same for the indirect fit: a wrong order goes round the simulated loop too."""
TIME_FLOOR_SHARE = 0.04
"""One sigma of model mismatch in lag and in dead time, as a share of the dead time (or of T0, if larger share)."""
OTHER_LOAD_FLOOR_RATIOS = np.array([4.0, 2.0, 2.0]) ** 2
"""What these variances, of ln gain and times, grow by where a load of another shape is beside, or one wanders: a
model's error and a load's shape cannot be told apart."""
OTHER_LOAD_LN_GAIN_SD = 0.5
"""One sigma of ln gain of a self-regulating process where the load was no step: a slow load and a slow tail of the
process are the same to PV. In simulated events of other shapes and loads the gain was off by 0.3 in the middle and by
0.9 in one of five, with nothing but noise left of PV."""
GOES_ON_RATIO = 4.0
"""Points of the residuals that carry the information of one, over those of the noise before the event, from which a
model lacks something. With white noise: in 1 of 48 simulated events of right models, in 57 of 184 of others."""
STAMP_PERIODS = 0.1
"""One sigma of dead time and lag in sample periods, where the dead time is resolved."""
UNRESOLVED_PERIODS = 1.0
"""The same for a dead time of nothing: which of two scans a historian's stamp belongs to is not in the data."""
RESOLVED_PERIODS = 3.0
"""Sample periods from which a dead time counts as resolved; in between, the floor falls linearly."""
SECOND_LAG_SHARE = 0.3
"""One sigma of a second lag as a share of the first: a process whose lags are alike is rare."""
LOADS_LAG_SHARE = 0.5
"""One sigma of a lag through which a load comes, as a share of T0, where it is not seen."""
LEAST_GAIN = 1e-300
"""A gain of nothing, where a model does not fit at all, in a logarithm."""
LOST_PERIODS = 0.3
"""Sample periods by which a step of time is longer than usual where a sample is missing."""


def with_uncertainty(
    process: str, model: tuple[float, float, float, float], t: Array, y: Array, residual: Array, scatter: Array,
    period: float | None = None, method: str = DIRECT,
) -> Fit:  # fmt: skip
    """Make a Fit of an optimum: its quality, and the floors of its covariance.

    Parameters
    ----------
    model
        gain, lag [s], dead time [s], second lag [s].
    t, y, residual
        (n,) times [s], PV and PV less the model's [PV].
    scatter
        (3, 3) covariance of (ln |gain|, lag, dead time) by the residuals.
    """
    gain, lag, dead_time, lag2 = model
    rss = float(residual @ residual)
    spread = float(np.sum((y - y.mean()) ** 2))
    n_eff = len(t) / correlation_time(residual)
    variance = max(rss / max(len(t) - 6, 1), 1e-24 * spread)
    t0 = lag + lag2 + dead_time
    step = median(np.diff(t)) if period is None else period
    stamp = STAMP_PERIODS + (UNRESOLVED_PERIODS - STAMP_PERIODS) * max(
        1.0 - dead_time / (RESOLVED_PERIODS * step), 0.0
    )
    time_floor = (TIME_FLOOR_SHARE * max(dead_time, 0.1 * t0)) ** 2 + (stamp * step) ** 2
    return Fit(
        process=process,
        gain=gain,
        lag=lag,
        dead_time=dead_time,
        lag2=lag2,
        scatter=scatter,
        floor=np.array(
            [
                (LN_GAIN_FLOOR_SD if method == DIRECT else INDIRECT_LN_GAIN_FLOOR_SD) ** 2,
                time_floor,
                time_floor,
            ]
        ),
        quality=1.0 - rss / spread,
        log_likelihood=-0.5 * n_eff * math.log(max(rss / len(t), 1e-24 * spread)),
        sigma=math.sqrt(variance),
        n_eff=n_eff,
        method=method,
    )


def covariance_of_lost_samples(w: SearchWindow, p: Array, gain: float, load: float) -> Array:
    """Covariance (3, 3) of (ln |gain|, lag, dead time) because OP is not known where samples are missing (derived).

    A lost sample's OP is taken for that of the one before. It may have been the next one's as well, or, under
    noise, have differed by as much as OP does from sample to sample.
    """
    t, u = w.points.since, w.points.held
    step = np.diff(t)
    usual = median(step)
    # what is longer yet is the coarse past of a load step, in points of mean values
    gaps = np.flatnonzero(
        (step > usual + LOST_PERIODS * (usual if w.period is None else w.period)) & (step < 3.6 * usual)
    )
    if len(gaps) == 0:
        return np.zeros((3, 3))
    moves = np.abs(np.diff(u))
    unknown = np.hypot(moves[gaps] / 2, median(moves)) * (step[gaps] - usual)  # [OP s]
    tangents = slopes(w.blocks, p, gain, load)[:, w.of_one_lag]
    inverse = np.ascontiguousarray(np.linalg.pinv(tangents, rcond=1e-6)[:3])
    moved = of_pulses(w.blocks, gain, p, t[gaps] + usual, t[gaps + 1], unknown, inverse)
    return np.asarray(moved @ moved.T)


def covariance_by_tangents(w: SearchWindow, p: Array, noise: float) -> Array:
    """Covariance (k, k) of what `slopes` are of, by tangents."""
    gain, load, _ = evaluate(w.blocks, p, np.empty(len(w.blocks.at)))
    tangents = slopes(w.blocks, p, gain, load)
    t = w.points.at
    # parts of T0: where the data cannot tell them apart, none exceeds it by much
    t0 = float(p[P_DEAD_TIME] + p[P_LAG] * (1.0 + p[P_SHARE])) + float(t[-1] - t[0]) / len(t)
    usual = np.array([10.0, t0, SECOND_LAG_SHARE * t0, t0, 3.0 * t0, 3.0, 3.0 * t0])
    usual = np.append(usual[:4], 3.0) if w.points.shape == START else usual[: tangents.shape[1]]
    if w.kind >= 2 and w.points.shape == STEP:
        tangents = np.column_stack([tangents, of_loads_lag(w.blocks, w.with_load(LAG).blocks, p, load)])
        usual = np.append(usual, 1.0)
    scaled = tangents * usual
    inverse = np.linalg.inv(scaled.T @ scaled / noise + np.eye(len(usual)))
    return np.asarray(inverse * np.outer(usual, usual))


def across_valley(cov: Array) -> Array:
    """Covariance (3, 3) of (ln |gain|, lag, dead time) at a given dead time, half a second lag in each.

    Parameters
    ----------
    cov
        (k, k), by tangents.
    """
    others = [k for k in range(len(cov)) if k != 3]
    beside = cov[np.ix_(others, others)] - np.outer(cov[others, 3], cov[3, others]) / cov[3, 3]
    fold = np.zeros((3, len(others)))
    fold[0, 0] = fold[1, 1] = 1.0
    fold[1, 2] = fold[2, 2] = 0.5
    return np.asarray(fold @ beside @ fold.T)


def node_weights(at: Array, likelihood: Array) -> Array:
    """Share of each node in the whole, by likelihood and by the stretch that it stands for; (n,)."""
    weight = np.exp(likelihood - likelihood.max())
    if len(at) > 1:
        weight = weight * np.diff(np.concatenate([at[:1], (at[1:] + at[:-1]) / 2, at[-1:]]))
    return np.asarray(weight / weight.sum()) if weight.sum() > 0 else np.full(len(at), 1.0 / len(at))


def shrunk_variance(at: Array, middle: float, weight: Array) -> float:
    """Factor on the variance where the valley ends before 1.96 sigma: at no dead time, or at no second lag."""
    spread = math.sqrt(float(weight @ (at - middle) ** 2))
    inside = at[(np.cumsum(weight) > 0.025) & (np.cumsum(weight[::-1])[::-1] > 0.025)]
    reach = float(np.max(np.abs(inside - middle), initial=0.0))
    return min(1.0, reach / (Z95 * spread)) ** 2 if spread > 0 else 1.0


def half_rule(p: Array, gain: Array) -> Array:
    """(n, 3) of ln |gain|, lag, dead time [s], half the second lag in each (half rule, Skogestad 2003)."""
    half = p[:, P_LAG] * p[:, P_SHARE] / 2
    return np.column_stack(
        [np.log(np.maximum(np.abs(gain), LEAST_GAIN)), p[:, P_LAG] + half, p[:, P_DEAD_TIME] + half]
    )


def of_second_lag(w: SearchWindow, p: Array, gain: float, load: float) -> Array:
    """Return what one sigma of a second lag would do to PV, which a model of one lag lacks; (n,) [PV]."""
    q = p.copy()
    t0 = float(p[P_DEAD_TIME] + p[P_LAG])
    lags = sorted([q[P_LAG], SECOND_LAG_SHARE * t0])
    q[P_LAG], q[P_SHARE] = lags[1], min(lags[0] / lags[1], MOST_SHARE) if lags[1] > 0.0 else 0.0
    x, g = unit_responses(w.points, p)
    x2, g2 = unit_responses(w.points, q)
    return np.asarray(gain * (x2 - x) + (load * (g2 - g) if len(g) else 0.0))


def of_loads_lag(w: Columns, through: Columns, p: Array, load: float) -> Array:
    """Return what one sigma of a lag ``through`` which a load may have come would do to PV; (n,) [PV]."""
    q = p.copy()
    q[P_WIDTH] = LOADS_LAG_SHARE * float(p[P_DEAD_TIME] + p[P_LAG])
    return np.asarray(load * (unit_responses(through, q)[1] - unit_responses(w, p)[1]))


def beyond_noise(residual: Array, quiet: float, alike: float) -> float:
    """Power of the residuals that is no noise [PV^2]: what there is more of than before, or what goes on.

    Noise soon forgets itself, what a model lacks goes on: where it does so for longer than the noise before the
    event, the autocovariance of one sample is its power, however little of it stands out of the noise.

    Parameters
    ----------
    quiet
        Standard deviation that noise alone may give residuals [PV].
    alike
        Points of noise before the event that carry the information of one.
    """
    n = len(residual)
    power = float(residual @ residual) / max(n - 6, 1)
    goes_on = correlation_time(residual) > GOES_ON_RATIO * alike
    lacked = float(residual[1:] @ residual[:-1]) / n if goes_on else 0.0
    return max(power - quiet**2, lacked, 0.0)


def tangent_scatter(
    residual: Array, jacobian: Array, t0: float, step: float, quiet: float, shape: bool = False,
    alike: float = math.inf,
) -> Array:  # fmt: skip
    """Return the (3, 3) covariance of (ln |gain|, lag, dead time) by tangents, the residuals' correlation considered.

    Parameters
    ----------
    jacobian
        (n, k): PV's change per unit of ln |gain|, of lag, of dead time [s], and of whatever else was fitted.
    t0, step
        Lags and dead time together, and the sample period [s].
    quiet
        Standard deviation that the residuals may have by noise alone [PV].
    shape
        The fourth column is `of_second_lag` or `of_loads_lag`.
    alike
        Points of noise that carry the information of one; by default any number.
    """
    n = len(residual)
    power = float(residual @ residual) / max(n - 6, 1)
    # what is no noise is one disturbance of unknown shape: it may all lie along what moves a parameter
    beyond = beyond_noise(residual, quiet, alike)
    # lag and dead time are parts of T0: where the data cannot tell them apart, neither exceeds it by much
    prior = np.zeros(jacobian.shape[1])
    prior[:3] = 1e-2, 1.0 / (t0 + step) ** 2, 1.0 / (t0 + step) ** 2
    if shape:
        prior[3] = 1.0
    information = jacobian.T @ jacobian / max(power * correlation_time(residual) + beyond * n, 1e-300)
    information += np.diag(prior)
    return np.asarray(np.linalg.pinv(information)[:3, :3], dtype=np.float64)
