"""An event's window to a process model with intervals.

Two independent ways: running integrals (exact without noise, any linear controller) and a separable
least-squares fit (variable projection, Golub & Pereyra 1973) of the half-rule model to the window. A
suggestion rests on the fit; the integrals check it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .fitting import load_response, project, response, search

Array = NDArray[np.float64]

INTEGRATING, SELF_REGULATING = "integrating", "self-regulating"
DIRECT, INDIRECT, JOINT = "direct", "indirect", "joint"

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
Z95 = 1.96
DECIDES = 6.0
"""Difference of log-likelihoods (in effective samples) from which one kind of process is believed: 1 to 400."""


@dataclass(frozen=True, slots=True)
class Fit:
    """A half-rule model with its uncertainty."""

    process: str
    gain: float
    """[PV/(OP s)] integrating, [PV/OP] self-regulating."""
    lag: float
    """[s]"""
    dead_time: float
    """Effective dead time [s]."""
    lag2: float
    """Second lag of a self-regulating process, else 0 [s]."""
    scatter: Array
    """(3, 3) covariance of (ln |gain|, lag, dead time) by the residuals."""
    floor: Array
    """(3,) variances to add for model mismatch, which more data do not reduce."""
    quality: float
    """1 - residual variance / PV variance over the window."""
    log_likelihood: float
    """-n_eff/2 ln(residual variance): to compare fits of the same window."""
    sigma: float
    """Standard deviation of the residuals [PV]."""
    size: float | None = None
    """Size Ad of the load step at the process input [OP]; None for a set-point step."""
    onset: float | None = None
    """When the load stepped, from the window's time zero [s]."""
    method: str = DIRECT
    """``direct`` (from OP as measured), ``indirect`` (closed loop simulated) or ``joint`` (several events)."""

    @property
    def t0(self) -> float:
        """Sum of lags and dead time [s]."""
        return self.lag + self.lag2 + self.dead_time

    @property
    def cov(self) -> Array:
        """(3, 3) covariance of (ln |gain|, lag, dead time), mismatch included."""
        return self.scatter + np.diag(self.floor)

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of ``gain``, ``lag``, ``dead_time`` or ``t0``."""
        if name == "gain":
            half = Z95 * math.sqrt(self.cov[0, 0])
            ends = self.gain * math.exp(-half), self.gain * math.exp(min(half, 700.0))
            return min(ends), max(ends)
        weights = {"lag": (0.0, 1.0, 0.0), "dead_time": (0.0, 0.0, 1.0), "t0": (0.0, 1.0, 1.0)}
        low, high = self._about(name, np.array(weights[name]))
        if name != "t0":  # neither part of T0 is below 0, so the other is not above it
            high = min(high, max(self._about("t0", np.array(weights["t0"]))[1] - self.lag2, low))
        return low, high

    def _about(self, name: str, weights: Array) -> tuple[float, float]:
        half = Z95 * math.sqrt(max(float(weights @ self.cov @ weights), 0.0))
        value = float(getattr(self, name))
        return max(value - half, 0.0), value + half


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


def fit_window(
    window: Array, before: int, process: str, load: bool = False, period: float | None = None
) -> Fit | None:
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
        A load stepped, before time zero: its size and onset are fitted too (without c1 and lag2).
    period
        Sample period, which a thinned window no longer shows; by default the median step of its times [s].

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
    best = search(t, u, y, kind)
    if not np.isfinite(best[0]) or best[4] == 0.0:
        return None
    residual, jacobian, size = _jacobian(t, u, y, kind, best)
    dead_time, lag, third, gain = (float(v) for v in best[1:5])
    model = (gain, lag, dead_time, 0.0 if load else third)
    fit = with_uncertainty(process, model, t, y, residual, jacobian, period)
    return replace(fit, size=size / gain, onset=float(t[0]) + third) if load else fit


def _columns(window: Array, before: int, load: bool) -> tuple[Array, Array, Array]:
    """Time, OP as deviation from rest, PV. A load acted before it was noticed: the rest lies further back."""
    rest = np.mean(window[: max(before // 2 if load else before, 1), 3])
    t, _, y, op = (np.ascontiguousarray(column) for column in window.T)
    return t, op - rest, y


def with_uncertainty(
    process: str, model: tuple[float, float, float, float], t: Array, y: Array, residual: Array, jacobian: Array,
    period: float | None = None, method: str = DIRECT,
) -> Fit:  # fmt: skip
    """Make a Fit of an optimum: its quality, and its covariance from residuals and their autocorrelation.

    Parameters
    ----------
    model
        gain, lag [s], dead time [s], second lag [s].
    t, y, residual
        (n,) times [s], PV and PV less the model's [PV].
    jacobian
        (n, k): PV's change per unit of ln |gain|, of lag, of dead time [s], and of whatever else was fitted.
    """
    gain, lag, dead_time, lag2 = model
    rss = float(residual @ residual)
    spread = float(np.sum((y - y.mean()) ** 2))
    n_eff = len(t) / correlation_time(residual)
    variance = max(rss / max(len(t) - 6, 1), 1e-24 * spread)
    t0 = lag + lag2 + dead_time
    step = float(np.median(np.diff(t))) if period is None else period
    # lag and dead time are parts of T0: where the data cannot tell them apart, neither exceeds it by much
    prior = np.zeros(jacobian.shape[1])
    prior[:3] = 1e-2, 1.0 / (t0 + step) ** 2, 1.0 / (t0 + step) ** 2
    information = jacobian.T @ jacobian / (variance * len(t) / n_eff) + np.diag(prior)
    scatter = np.asarray(np.linalg.pinv(information)[:3, :3], dtype=np.float64)
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
        method=method,
    )


def decide(fits: list[Fit], span: float) -> tuple[Fit | None, bool]:
    """Return the better of the fits of one window, and whether it is better beyond doubt.

    Parameters
    ----------
    fits
        One for each kind of process.
    span
        Length of the window [s]: a self-regulating process whose lag is longer than two of them has shown
        nothing but its slope; to the eye and to a controller it is an integrating one.
    """
    ranked = sorted(fits, key=lambda f: -f.log_likelihood)
    ramps = [f for f in ranked if f.process == SELF_REGULATING and f.lag > 2.0 * span]
    if ramps and len(ranked) > len(ramps):
        ranked = [f for f in ranked if f not in ramps]
    if not ranked:
        return None, False
    if len(ranked) == 1:
        return ranked[0], True
    return ranked[0], ranked[0].log_likelihood - ranked[1].log_likelihood >= DECIDES


def combine(fits: list[Fit]) -> Fit:
    """Return one model for several events of a loop: the information-weighted mean of (ln |gain|, lag, dead time).

    All fits are of one kind of process and one sign of gain. Scatter shrinks with the number of events, the
    floor for model mismatch does not. A weighted mean, not a fit to all windows together.
    """
    if len(fits) == 1:
        return fits[0]
    weights = [np.linalg.inv(f.cov) for f in fits]
    together = np.linalg.inv(np.sum(weights, axis=0))
    mean = together @ np.sum(
        [
            w @ np.array([math.log(abs(f.gain)), f.lag, f.dead_time])
            for w, f in zip(weights, fits, strict=True)
        ],
        axis=0,
    )
    floor = np.mean([f.floor for f in fits], axis=0)
    best = max(fits, key=lambda f: f.quality)
    return replace(
        best,
        gain=math.copysign(math.exp(mean[0]), best.gain),
        lag=max(float(mean[1]), 0.0),
        dead_time=max(float(mean[2]), 0.0),
        lag2=float(np.mean([f.lag2 for f in fits])),
        scatter=together,
        floor=floor,
        method=JOINT,
    )


def contradictory(fits: list[Fit], joint: Fit) -> bool:
    """Whether an event's gain lies so far from the joint model that chance cannot explain it (4 sigma, 20 %)."""
    for fit in fits:
        if fit.gain * joint.gain < 0:
            return True
        sigma = math.sqrt(fit.cov[0, 0] + joint.cov[0, 0])
        if abs(math.log(fit.gain / joint.gain)) > max(4.0 * sigma, 0.2):
            return True
    return False


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


def _jacobian(t: Array, u: Array, y: Array, kind: int, best: Array) -> tuple[Array, Array, float]:
    """Return residuals (n,), PV's change per unit of each parameter (n, k), and gain times the load's size.

    The parameters are ln gain, lag, dead time [s], and for a load its onset [s] and ln size. All is projected.
    """
    dead_time, lag, third, gain = best[1:]
    load, process = kind >= 2, kind % 2
    lag2 = 0.0 if load else third
    py = project(y.copy(), t, kind)

    def moved_by_op(dead_time: float, lag: float) -> Array:
        return np.asarray(gain * project(response(t, u, process, dead_time, lag, lag2), t, kind))

    def moved_by_load(dead_time: float, lag: float, onset: float) -> Array:
        return np.asarray(
            project(load_response(t - t[0] - onset, process, 1.0, dead_time, lag, 0.0), t, kind)
        )

    by_op, size = moved_by_op(dead_time, lag), 0.0
    if load:
        unit = moved_by_load(dead_time, lag, third)
        size = float((py - by_op) @ unit / (unit @ unit))

    def at(dead_time: float, lag: float) -> Array:
        pushed = size * moved_by_load(dead_time, lag, third) if load else 0.0
        return moved_by_op(dead_time, lag) + pushed

    here = at(dead_time, lag)
    # a secant of 5 %: at a lag of zero the tangents of lag and dead time coincide
    step = 0.05 * (lag + dead_time) + 0.05 * (t[-1] - t[0]) / len(t)
    less_lag, less_dead = max(lag - step, 0.0), max(dead_time - step, 0.0)
    by_lag = (at(dead_time, lag + step) - at(dead_time, less_lag)) / (lag + step - less_lag)
    by_dead_time = (at(dead_time + step, lag) - at(less_dead, lag)) / (dead_time + step - less_dead)
    columns = [here, by_lag, by_dead_time]
    if load:
        later = size * moved_by_load(dead_time, lag, third + step)
        columns += [(later - size * unit) / step, size * unit]
    return py - here, np.column_stack(columns), size
