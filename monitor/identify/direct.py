"""An event's window to a process model with intervals.

Two independent ways: running integrals (exact without noise, any linear controller) and a separable
least-squares fit (variable projection, Golub & Pereyra 1973) of a model to the window. A suggestion rests on
the fit; the integrals check it.

An integrating process is fitted with one effective lag, and its tangents tell how far other models reach. A
self-regulating one needs its second lag: dead time, lags, gain and a load's onset share what the data say, the
likelihood is a long bent valley, and no tangent describes it. The valley is walked instead (derived).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .fit import ALIKE, DECIDES, DIRECT, INTEGRATING, SIMPLER, Z95, Array, Fit, Valley, better_by
from .response import load_response, response
from .search import (
    DEAD,
    LAG,
    MOST_POINTS,
    ONSET,
    SHARE,
    blocks,
    bounds,
    descend,
    evaluate,
    of_pulses,
    project,
    search,
    slopes,
    walk,
)

FLOOR_LN_GAIN = 0.01
"""One sigma of model mismatch in ln gain: a half-rule model of a fourth-order plant is 1 % off without noise."""
FLOOR_INDIRECT = 0.02
"""The same for the indirect fit: a wrong order goes round the simulated loop too."""
FLOOR_TIME = 0.04
"""One sigma of model mismatch in lag and in dead time, as a share of the dead time (or of T0, if larger share)."""
STAMP = 0.1
"""One sigma of dead time and lag in sample periods, where the dead time is resolved."""
UNRESOLVED = 1.0
"""The same for a dead time of nothing: which of two scans a historian's stamp belongs to is not in the data."""
RESOLVED = 3.0
"""Sample periods from which a dead time counts as resolved; in between, the floor falls linearly."""
SECOND_LAG = 0.3
"""One sigma of a second lag as a share of the first: a process whose lags are alike is rare."""
LOST = 0.3
"""Sample periods by which a step of time is longer than usual where a sample is missing."""
LEAST_NOISE = 1e-10
"""Least power of the residuals, as a share of PV's: no model is better than that, and no number either."""
SINGLE, BESIDE, EVERY = ((DEAD, LAG), (LAG, SHARE), (DEAD, LAG, SHARE))
"""Parameters that are searched for: with one lag, at a given dead time, all; for a load the onset too."""


def setpoint_integrals(amplitude: float, s1: float, s2: float, y1: float) -> tuple[float, float]:
    """Gain [PV/(OP s)] and T0 [s] of an integrating process from a set-point step's integrals.

    ``mu = Ar / int u``, ``T0 = (mu int int u - int y) / Ar`` (derived; exact for any linear controller once
    the loop has settled). NaN where OP's integral is zero.
    """
    gain = amplitude / s1 if s1 != 0 else math.nan
    return gain, (gain * s2 - y1) / amplitude


def load_integrals(
    s1: float, s2: float, s3: float, y1: float, y2: float, u_end: float
) -> tuple[float, float, float, float]:
    """Size [OP], age of the onset [s before the end], gain and T0 from a load step's integrals (derived).

    ``Ad = -u(inf)``, ``L = -S1/Ad``, ``mu = Y1/(S2 + Ad L^2/2)``, ``T0 = (mu (S3 + Ad L^3/6) - Y2)/Y1``.
    Under noise size and onset stay good, T0 does not.
    """
    size = -u_end
    age = -s1 / size
    gain = y1 / (s2 + size * age**2 / 2)
    return size, age, gain, (gain * (s3 + size * age**3 / 6) - y2) / y1


def fit_kinds(
    window: Array, before: int, kinds: list[str], load: bool = False, period: float | None = None
) -> list[Fit]:
    """Fit the kinds of process that a loop may be, as `fit_window` does one; what cannot be fitted is left out.

    Where both are asked for, their likelihoods can be compared: both are of models with two lags.
    """
    fits: list[Fit] = []
    for kind in kinds:
        fit = fit_window(window, before, kind, load, period, len(kinds) > 1, fits[0] if fits else None)
        fits += [] if fit is None else [fit]
    return fits


def fit_window(
    window: Array, before: int, process: str, load: bool = False, period: float | None = None,
    compared: bool = False, rival: Fit | None = None,
) -> Fit | None:  # fmt: skip
    """Fit the half-rule model of one kind of process to a window.

    Parameters
    ----------
    window
        (n, 4): time [s], SP [PV], PV [PV], OP held until the next point [OP].
    before
        Points before the onset; the output's rest value is taken from them.
    process
        ``integrating``: ``y = mu F(lag, dead time)[int u] + c0 + c1 t`` (c1: a load that OP did not balance);
        ``self-regulating``: ``y = K F(lag, lag2, dead time)[u] + c0``.
    load
        A load stepped, before time zero: its size and onset are fitted too (without c1).
    period
        Sample period, which a thinned window no longer shows; by default the median step of its times [s].
    compared
        The likelihood is to be compared with that of the other kind.
    rival
        An integrating model of the window: where it is not beaten, a self-regulating one's uncertainty is only
        told roughly.

    Returns
    -------
    Fit or None
        None where OP or PV did not move, or the window is too short to tell (fewer than 12 points).
    """
    n = len(window)
    if n < 12:
        return None
    t, u, y = _columns(window, before, load)
    if not np.any(u) or np.ptp(y) == 0:
        return None
    kind = (0 if process == INTEGRATING else 1) + (2 if load else 0)
    found = _explain(_window_of(t, u, y, kind, period), compared, rival)
    if found is None:
        return None
    p = found.p
    model = (found.gain, float(p[LAG]), float(p[DEAD]), float(p[LAG] * p[SHARE]))
    fit = with_uncertainty(process, model, t, y, found.residual, found.scatter, period)
    fit = replace(fit, log_likelihood=found.log_likelihood, n_eff=found.n_eff, valley=found.valley)
    return replace(fit, size=found.load / found.gain, onset=float(p[ONSET])) if load else fit


def _columns(window: Array, before: int, load: bool) -> tuple[Array, Array, Array]:
    """Time, OP as deviation from rest, PV. A load acted before it was noticed: the rest lies further back."""
    rest = np.mean(window[: max(before // 2 if load else before, 1), 3])
    t, _, y, op = (np.ascontiguousarray(column) for column in window.T)
    return t, op - rest, y


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
    step = float(np.median(np.diff(t))) if period is None else period
    stamp = STAMP + (UNRESOLVED - STAMP) * max(1.0 - dead_time / (RESOLVED * step), 0.0)
    time_floor = (FLOOR_TIME * max(dead_time, 0.1 * t0)) ** 2 + (stamp * step) ** 2
    return Fit(
        process=process,
        gain=gain,
        lag=lag,
        dead_time=dead_time,
        lag2=lag2,
        scatter=scatter,
        floor=np.array(
            [(FLOOR_LN_GAIN if method == DIRECT else FLOOR_INDIRECT) ** 2, time_floor, time_floor]
        ),
        quality=1.0 - rss / spread,
        log_likelihood=-0.5 * n_eff * math.log(max(rss / len(t), 1e-24 * spread)),
        sigma=math.sqrt(variance),
        n_eff=n_eff,
        method=method,
    )


def model_response(window: Array, before: int, fit: Fit) -> Array:
    """PV as the model gives it from the window's OP, offset (and slope, if integrating) fitted; (n,) [PV]."""
    load = fit.size is not None and fit.onset is not None
    t, u, y = _columns(window, before, load)
    kind = 0 if fit.process == INTEGRATING else 1
    x = fit.gain * response(t, u, kind, fit.dead_time, fit.lag, fit.lag2)
    if fit.size is not None and fit.onset is not None:
        x = x + fit.size * load_response(t - fit.onset, kind, fit.gain, fit.dead_time, fit.lag, fit.lag2)
    rest = np.polynomial.polynomial.polyfit(t, y - x, 1 if kind == 0 else 0)
    return np.asarray(x + np.polynomial.polynomial.polyval(t, rest), dtype=np.float64)


# -- all models that explain a window ---------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Window:
    """A window's columns, and what the searches of it need."""

    kind: int
    """As in `fitting`: 0, 1 for a set-point step, 2, 3 for a load step."""
    t: Array
    """(n,) [s]."""
    u: Array
    """(n,) OP from rest [OP]."""
    y: Array
    """(n,) PV, mean (and slope) taken out [PV]."""
    at: Array
    """(m,) times of PV in blocks [s]."""
    since: Array
    """(m,) times from which OP is held in blocks [s]."""
    held: Array
    """(m,) OP from rest, in blocks [OP]."""
    period: float | None
    """Sample period [s]."""
    mean: Array
    """(m,) PV in blocks, mean (and slope) taken out [PV]."""

    def free(self, names: tuple[int, ...]) -> NDArray[np.int64]:
        """Return the places of these parameters, and of a load's onset."""
        return np.array(names + ((ONSET,) if self.kind >= 2 else ()))


@dataclass(frozen=True, slots=True)
class _Found:
    """A model in the parameters of `fitting`, and how far others reach that explain the window as well."""

    p: Array
    gain: float
    load: float
    """Gain times the load's size [PV/s] or [PV]; 0 without a load."""
    residual: Array
    """(n,) [PV]."""
    scatter: Array
    """(3, 3) covariance of (ln |gain|, lag, dead time); half a second lag counts for each."""
    valley: Valley | None
    log_likelihood: float
    """-n_eff/2 ln(residual variance) of the best model with two lags."""
    n_eff: float
    """Independent points, of which that likelihood is."""


def _window_of(t: Array, u: Array, y: Array, kind: int, period: float | None) -> _Window:
    """Lay out a window for the searches.

    Parameters
    ----------
    t, u, y
        (n,) times [s], OP from rest [OP], PV [PV].
    kind
        As in `fitting`.
    period
        Sample period, if known [s].
    """
    at, mean, since, held = blocks(t, u, y, MOST_POINTS)
    return _Window(kind, t, u, project(y.copy(), t, kind), at, since, held, period, project(mean, at, kind))


def _explain(w: _Window, compared: bool, rival: Fit | None) -> _Found | None:
    """Find the model of a window and its reach; None where OP explains nothing of PV."""
    second = compared or w.kind % 2 == 1
    best, single = search(w.at, w.since, w.held, w.mean, w.kind, second)
    rest = np.empty(len(w.at))
    gain, _, rss = evaluate(w.at, w.since, w.held, w.mean, w.kind, best, rest)
    if not math.isfinite(rss) or not math.isfinite(gain) or gain == 0.0:
        return None
    rss = max(rss, LEAST_NOISE * float(w.mean @ w.mean))
    n_eff = len(rest) / correlation_time(rest)
    likelihood = -0.5 * n_eff * math.log(rss / len(rest))
    if w.kind % 2 == 0:
        found = _one_lag(w, single)
    elif rival is not None and _not_believed(
        w, best, better_by(likelihood, n_eff, rival.log_likelihood, rival.n_eff)
    ):
        found = _one_lag(w, best)
    else:
        found = _two_lags(w, best, rss / n_eff)
    p, gain, load, scatter, valley = found
    residual = np.empty(len(w.t))
    evaluate(w.t, w.t, w.u, w.y, w.kind, p, residual)
    if gain == 0.0 or not (math.isfinite(gain) and np.isfinite(residual).all()):
        return None
    lost = _of_lost_samples(w, p, gain, load)
    scatter = scatter + lost
    if not np.isfinite(scatter).all():
        return None
    if valley is not None:
        valley = replace(valley, across=valley.across + lost)
    return _Found(p, gain, load, residual, scatter, valley, likelihood, n_eff)


def _not_believed(w: _Window, p: Array, better: float) -> bool:
    """Whether `decide` will prefer the integrating model."""
    alike = p[LAG] > min(2.0 * float(w.t[-1]), ALIKE * float(p[DEAD] + p[LAG] * p[SHARE] / 2))
    return better <= -SIMPLER or (better < DECIDES and alike)


def _one_lag(w: _Window, start: Array) -> tuple[Array, float, float, Array, Valley | None]:
    """Return p, gain, gain times load, scatter of the best model with this second lag, by its tangents."""
    starts = [start]
    if start[LAG] < 0.1 * start[DEAD]:  # a lag of a block's length or less is not seen in blocks
        starts.append(
            np.array([0.75, 0.25, 0.0, 0.0]) * (start[LAG] + start[DEAD]) + np.array([0, 0, *start[2:]])
        )
    tried = [
        descend(w.t, w.t, w.u, w.y, w.kind, s, w.free(SINGLE), bounds(w.t, w.kind), 0.0, 20, 1e-7)
        for s in starts
    ]
    p, gain, load, _, _ = min(tried, key=lambda found: found[3])
    residual = np.empty(len(w.t))
    evaluate(w.t, w.t, w.u, w.y, w.kind, p, residual)
    tangents = slopes(w.t, w.t, w.u, w.kind, p, gain, load)
    columns = [0, 1, 3, 4, 5] if w.kind >= 2 else [0, 1, 3]
    step = float(w.t[-1] - w.t[0]) / len(w.t)
    scatter = tangent_scatter(residual, tangents[:, columns], float(p[DEAD] + p[LAG]), step)
    return p, gain, load, scatter, None


def _two_lags(w: _Window, start: Array, noise: float) -> tuple[Array, float, float, Array, Valley]:
    """Return p, gain, gain times load, scatter of the middle of the valley.

    ``start`` is the best model of the blocks, ``noise`` the power of an independent one of their residuals [PV^2].
    """
    best = start
    if len(w.t) > len(w.at):
        best = descend(w.t, w.t, w.u, w.y, w.kind, start, w.free(EVERY), bounds(w.t, w.kind), 0.0, 8, 1e-7)[0]
    cov = _by_tangents(w, start, noise)
    # a prior of one sigma costs as much as one sigma of noise
    prior = noise / SECOND_LAG**2
    stride = max(0.5 * math.sqrt(cov[3, 3]), 1e-6 * float(w.t[-1] - w.t[0]))
    nodes = walk(w.at, w.since, w.held, w.mean, w.kind, start, stride, prior, 0.5 / noise)
    nodes = nodes[np.argsort(nodes[:, DEAD])]
    weight = _weights(nodes[:, DEAD], nodes[:, -1])
    middle = max(float(weight @ nodes[:, DEAD] + best[DEAD] - start[DEAD]), 0.0)
    near = nodes[np.argmin(np.abs(nodes[:, DEAD] - middle)), :4].copy()
    near[DEAD] = middle
    p, gain, load, _, _ = descend(
        w.t, w.t, w.u, w.y, w.kind, near, w.free(BESIDE), bounds(w.t, w.kind), prior * len(w.t) / len(w.at),
        10, 1e-5,
    )  # fmt: skip
    away = _half_rule(nodes, nodes[:, 4]) - _half_rule(p[None], np.array([gain]))
    # what is uncertain at each dead time, and how the dead times differ
    others = [k for k in range(len(cov)) if k != 3]
    beside = cov[np.ix_(others, others)] - np.outer(cov[others, 3], cov[3, others]) / cov[3, 3]
    fold = np.zeros((3, len(others)))
    fold[0, 0] = fold[1, 1] = 1.0
    fold[1, 2] = fold[2, 2] = 0.5
    across = fold @ beside @ fold.T
    models = np.column_stack([nodes[:, 4], nodes[:, LAG], nodes[:, DEAD], nodes[:, LAG] * nodes[:, SHARE]])
    valley = Valley(models, 2.0 * (nodes[:, -1].max() - nodes[:, -1]), across)
    return p, gain, load, across + _shrunk(nodes[:, DEAD], middle, weight) * (away.T * weight) @ away, valley


def _of_lost_samples(w: _Window, p: Array, gain: float, load: float) -> Array:
    """Covariance (3, 3) of (ln |gain|, lag, dead time) because OP is not known where samples are missing (derived).

    A lost sample's OP is taken for that of the one before. It may have been the next one's as well, or, under
    noise, have differed by as much as OP does from sample to sample.
    """
    step = np.diff(w.t)
    usual = float(np.median(step))
    # what is longer yet is the coarse past of a load step, in points of mean values
    gaps = np.flatnonzero(
        (step > usual + LOST * (usual if w.period is None else w.period)) & (step < 3.6 * usual)
    )
    if len(gaps) == 0:
        return np.zeros((3, 3))
    moves = np.abs(np.diff(w.u))
    unknown = np.hypot(moves[gaps] / 2, float(np.median(moves))) * (step[gaps] - usual)  # [OP s]
    columns = [0, 1, 3, 4, 5] if w.kind >= 2 else [0, 1, 3]
    tangents = slopes(w.at, w.since, w.held, w.kind, p, gain, load)[:, columns]
    inverse = np.ascontiguousarray(np.linalg.pinv(tangents, rcond=1e-6)[:3])
    moved = of_pulses(w.at, w.kind, gain, p, w.t[gaps] + usual, w.t[gaps + 1], unknown, inverse)
    return np.asarray(moved @ moved.T)


def _by_tangents(w: _Window, p: Array, noise: float) -> Array:
    """Covariance (4, 4) or (6, 6) of ln gain, lag, second lag, dead time [s], onset [s], ln size, by tangents."""
    gain, load, _ = evaluate(w.at, w.since, w.held, w.mean, w.kind, p, np.empty(len(w.at)))
    tangents = slopes(w.at, w.since, w.held, w.kind, p, gain, load)
    # parts of T0: where the data cannot tell them apart, none exceeds it by much
    t0 = float(p[DEAD] + p[LAG] * (1.0 + p[SHARE])) + float(w.t[-1] - w.t[0]) / len(w.t)
    usual = np.array([10.0, t0, SECOND_LAG * t0, t0, 3.0 * t0, 3.0])[: tangents.shape[1]]
    scaled = tangents * usual
    inverse = np.linalg.inv(scaled.T @ scaled / noise + np.eye(len(usual)))
    return np.asarray(inverse * np.outer(usual, usual))


def _weights(at: Array, likelihood: Array) -> Array:
    """Share of each node in the whole, by likelihood and by the stretch that it stands for; (n,)."""
    weight = np.exp(likelihood - likelihood.max())
    if len(at) > 1:
        weight = weight * np.diff(np.concatenate([at[:1], (at[1:] + at[:-1]) / 2, at[-1:]]))
    return np.asarray(weight / weight.sum()) if weight.sum() > 0 else np.full(len(at), 1.0 / len(at))


def _shrunk(at: Array, middle: float, weight: Array) -> float:
    """Factor on the variance where the valley ends before 1.96 sigma: at no dead time, or at no second lag."""
    spread = math.sqrt(float(weight @ (at - middle) ** 2))
    inside = at[(np.cumsum(weight) > 0.025) & (np.cumsum(weight[::-1])[::-1] > 0.025)]
    reach = float(np.max(np.abs(inside - middle), initial=0.0))
    return min(1.0, reach / (Z95 * spread)) ** 2 if spread > 0 else 1.0


def _half_rule(p: Array, gain: Array) -> Array:
    """(n, 3) of ln |gain|, lag, dead time [s], half the second lag in each (half rule, Skogestad 2003)."""
    half = p[:, LAG] * p[:, SHARE] / 2
    return np.column_stack([np.log(np.abs(gain)), p[:, LAG] + half, p[:, DEAD] + half])


def tangent_scatter(residual: Array, jacobian: Array, t0: float, step: float) -> Array:
    """Return the (3, 3) covariance of (ln |gain|, lag, dead time) by tangents, the residuals' correlation considered.

    Parameters
    ----------
    jacobian
        (n, k): PV's change per unit of ln |gain|, of lag, of dead time [s], and of whatever else was fitted.
    t0, step
        Lags and dead time together, and the sample period [s].
    """
    n = len(residual)
    power = float(residual @ residual) / max(n - 6, 1)
    # lag and dead time are parts of T0: where the data cannot tell them apart, neither exceeds it by much
    prior = np.zeros(jacobian.shape[1])
    prior[:3] = 1e-2, 1.0 / (t0 + step) ** 2, 1.0 / (t0 + step) ** 2
    information = jacobian.T @ jacobian / max(power * correlation_time(residual), 1e-300) + np.diag(prior)
    return np.asarray(np.linalg.pinv(information)[:3, :3], dtype=np.float64)


def correlation_time(residual: Array) -> float:
    """How many residuals carry the information of one (1 for white noise): 1 + 2 sum of autocorrelations.

    Summed until they first fall below 0.05 (initial positive sequence, after Geyer 1992).
    """
    n = len(residual)
    power = float(residual @ residual)
    if power == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, n // 3):
        r = float(residual[lag:] @ residual[:-lag]) / power
        if r < 0.05:
            break
        total += 2.0 * r
    return min(total, n / 8)
