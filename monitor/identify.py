"""An event's window to a process model with intervals.

Two independent ways: running integrals (exact without noise, any linear controller) and a separable
least-squares fit (variable projection, Golub & Pereyra 1973) of the half-rule model to the window. A
suggestion rests on the fit; the integrals check it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

jit: Any = numba.njit(cache=True, error_model="numpy")

Array = NDArray[np.float64]
FILL, REFLECT, EXPAND, CONTRACT = range(4)
"""Phases of the simplex search."""

INTEGRATING, SELF_REGULATING = "integrating", "self-regulating"

FLOOR_LN_GAIN = 0.01
"""One sigma of model mismatch in ln gain: a half-rule model of a fourth-order plant is 1 % off without noise."""
FLOOR_TIME = 0.04
"""One sigma of model mismatch in lag and in dead time, as a share of the dead time (or of T0, if larger share)."""
STAMP = 0.1
"""One sigma of dead time and lag in sample periods: when within a period OP really moved is not in the data."""
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
        weights = {"lag": (0.0, 1.0, 0.0), "dead_time": (0.0, 0.0, 1.0), "t0": (0.0, 1.0, 1.0)}[name]
        half = Z95 * math.sqrt(max(float(np.array(weights) @ self.cov @ np.array(weights)), 0.0))
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


def fit_window(window: Array, before: int, process: str) -> Fit | None:
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

    Returns
    -------
    Fit or None
        None where OP or PV did not move, or the window is too short to tell (fewer than 12 points).
    """
    n = len(window)
    if n < 12:
        return None
    t = np.ascontiguousarray(window[:, 0])
    y = np.ascontiguousarray(window[:, 2])
    rest = np.mean(window[: max(before, 1), 3])
    u = np.ascontiguousarray(window[:, 3]) - rest
    if not np.any(u) or np.ptp(y) == 0:
        return None
    kind = 0 if process == INTEGRATING else 1
    best = _search(t, u, y, kind)
    if not np.isfinite(best[0]):
        return None
    return _fit_at(t, u, y, kind, best)


def _fit_at(t: Array, u: Array, y: Array, kind: int, best: Array) -> Fit | None:
    """Gain, quality and covariance at the optimum found."""
    dead_time, lag, lag2 = (float(v) for v in best[1:4])
    gain = float(best[4])
    if gain == 0.0:
        return None
    residual, j = _jacobian(t, u, y, kind, best)
    rss = float(residual @ residual)
    spread = float(np.sum((y - y.mean()) ** 2))
    n_eff = len(t) / correlation_time(residual)
    variance = max(rss / max(len(t) - 6, 1), 1e-24 * spread)
    t0 = lag + lag2 + dead_time
    step = float(np.median(np.diff(t)))
    # lag and dead time are parts of T0: where the data cannot tell them apart, neither exceeds it by much
    prior = np.diag([1e-2, *[1.0 / (t0 + step) ** 2] * 2])
    cov = np.linalg.inv(j.T @ j / (variance * len(t) / n_eff) + prior)
    time_floor = (FLOOR_TIME * max(dead_time, 0.3 * t0)) ** 2 + (STAMP * step) ** 2
    return Fit(
        process=INTEGRATING if kind == 0 else SELF_REGULATING,
        gain=gain,
        lag=lag,
        dead_time=dead_time,
        lag2=lag2,
        scatter=cov,
        floor=np.array([FLOOR_LN_GAIN**2, time_floor, time_floor]),
        quality=1.0 - rss / spread,
        log_likelihood=-0.5 * n_eff * math.log(max(rss / len(t), 1e-24 * spread)),
        sigma=math.sqrt(variance),
    )


def decide(fits: list[Fit]) -> tuple[Fit | None, bool]:
    """Return the better of the fits of one window, and whether it is better beyond doubt."""
    if not fits:
        return None, False
    ranked = sorted(fits, key=lambda f: -f.log_likelihood)
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
    t, y = np.ascontiguousarray(window[:, 0]), window[:, 2]
    u = np.ascontiguousarray(window[:, 3]) - np.mean(window[: max(before, 1), 3])
    kind = 0 if fit.process == INTEGRATING else 1
    x = fit.gain * _response(t, u, kind, fit.dead_time, fit.lag, fit.lag2)
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


def _jacobian(t: Array, u: Array, y: Array, kind: int, best: Array) -> tuple[Array, Array]:
    """Residuals (n,), and (n, 3): PV's change per unit of ln gain, of lag and of dead time [s]; projected."""
    dead_time, lag, lag2, gain = best[1:]

    def at(dead_time: float, lag: float) -> Array:
        return np.asarray(gain * _project(_response(t, u, kind, dead_time, lag, lag2), t, kind))

    here = at(dead_time, lag)
    # a secant of 5 %: at a lag of zero the tangents of lag and dead time coincide
    step = 0.05 * (lag + dead_time) + 0.05 * (t[-1] - t[0]) / len(t)
    less_lag, less_dead = max(lag - step, 0.0), max(dead_time - step, 0.0)
    by_lag = (at(dead_time, lag + step) - at(dead_time, less_lag)) / (lag + step - less_lag)
    by_dead_time = (at(dead_time + step, lag) - at(less_dead, lag)) / (dead_time + step - less_dead)
    return _project(y.copy(), t, kind) - here, np.column_stack([here, by_lag, by_dead_time])


# ---------------------------------------------------------------------------------------------------
# compiled from here on; kind 0 = integrating, 1 = self-regulating


@jit
def _lagged(t, u, tau):  # type: ignore[no-untyped-def]
    """Response of 1/(tau s + 1) to the held input at the points themselves, from rest."""
    z = np.zeros(len(t))
    last, decay = -1.0, 0.0
    for k in range(len(t) - 1):
        dt = t[k + 1] - t[k]
        if tau > 0.0:
            if abs(dt - last) > 1e-9 * dt:  # an exponential costs more than all the rest
                last, decay = dt, np.exp(-dt / tau)
        else:
            decay = 0.0
        z[k + 1] = u[k] + (z[k] - u[k]) * decay
    return z


@jit
def _response(t, u, kind, dead_time, lag, lag2):  # type: ignore[no-untyped-def]
    """Response of the unit-gain model at the points: exact for held input, any dead time, uneven points."""
    n = len(t)
    x = np.zeros(n)
    if kind == 1 and lag2 > 0.0 and abs(lag - lag2) < 1e-3 * lag:
        lag2 = lag * (1.0 - 1e-3)  # the partial fractions below need two different lags
    z1 = _lagged(t, u, lag)
    z2 = _lagged(t, u, lag2) if kind == 1 and lag2 > 0.0 else z1
    s = np.zeros(n)
    for k in range(n - 1):
        s[k + 1] = s[k] + u[k] * (t[k + 1] - t[k])
    j = 0
    last, e1, e2 = -1.0, 1.0, 1.0
    for i in range(n):
        at = t[i] - dead_time
        if at <= t[0]:
            continue
        while j + 1 < n and t[j + 1] <= at:
            j += 1
        h = at - t[j]
        if abs(h - last) > 1e-9 * (abs(h) + dead_time):
            last = h
            e1 = np.exp(-h / lag) if lag > 0.0 else 0.0
            e2 = np.exp(-h / lag2) if lag2 > 0.0 else 0.0
        a = u[j] + (z1[j] - u[j]) * e1
        if kind == 0:  # the integral of a lag's output is the input's integral less tau times the output
            x[i] = s[j] + u[j] * h - lag * a
        elif lag2 > 0.0:
            b = u[j] + (z2[j] - u[j]) * e2
            x[i] = (lag * a - lag2 * b) / (lag - lag2)
        else:
            x[i] = a
    return x


@jit
def _project(x, t, kind):  # type: ignore[no-untyped-def]
    """Take mean (and, integrating, slope) out of a column, in place: c0 and c1 need no search."""
    n = len(x)
    x -= x.mean()
    if kind == 0:
        middle = t.mean()
        top = bottom = 0.0
        for i in range(n):
            top += (t[i] - middle) * x[i]
            bottom += (t[i] - middle) ** 2
        slope = top / bottom
        for i in range(n):
            x[i] -= slope * (t[i] - middle)
    return x


@jit
def _gain_and_rss(t, u, y, kind, dead_time, lag, lag2):  # type: ignore[no-untyped-def]
    """Best gain and residual sum of squares at these times; ``y`` is projected already."""
    x = _project(_response(t, u, kind, dead_time, lag, lag2), t, kind)
    xx = xy = 0.0
    for i in range(len(x)):
        xx += x[i] * x[i]
        xy += x[i] * y[i]
    if xx <= 0.0:
        return 0.0, np.inf
    gain = xy / xx
    rss = 0.0
    for i in range(len(x)):
        r = y[i] - gain * x[i]
        rss += r * r
    return gain, rss


@jit
def _search(t, u, y, kind):  # type: ignore[no-untyped-def]
    """Best (rss, dead time, lag, lag2, gain): a coarse grid, then Nelder-Mead."""
    py = _project(y.copy(), t, kind)
    span = t[-1]
    step = (t[-1] - t[0]) / len(t)
    best = np.array([np.inf, 0.0, step, 0.0, 0.0])
    m = 12
    thin = max(len(t) // 200, 1)  # the grid only has to find the valley
    tt, uu = _thinned(t, u, thin)
    yy = _project(y[::thin].copy()[: len(tt)], tt, kind)
    longest = span if kind == 1 else 0.5 * span
    for a in range(m):
        dead_time = 0.0 if a == 0 else step * (0.5 * span / step) ** ((a - 1) / (m - 1))
        for b in range(m):
            lag = 0.0 if b == 0 else step * (longest / step) ** ((b - 1) / (m - 1))
            gain, rss = _gain_and_rss(tt, uu, yy, kind, dead_time, lag, 0.0)
            if rss < best[0]:
                best[0], best[1], best[2], best[4] = rss, dead_time, lag, gain
    best[0] = np.inf
    dim = 2 if kind == 0 else 3
    for _ in range(2):  # a second start from the first one's end frees a collapsed simplex
        best = _nelder_mead(t, u, py, kind, best, dim, step, longest)
    return best


@jit
def _thinned(t, u, thin):  # type: ignore[no-untyped-def]
    """Every thin-th point, OP as the mean over the points dropped."""
    n = (len(t) + thin - 1) // thin
    tt, uu = np.empty(n), np.empty(n)
    for k in range(n):
        tt[k] = t[k * thin]
        end = min((k + 1) * thin, len(t) - 1)
        area = 0.0
        for j in range(k * thin, end):
            area += u[j] * (t[j + 1] - t[j])
        uu[k] = area / (t[end] - tt[k]) if t[end] > tt[k] else u[k * thin]
    return tt, uu


@jit
def _cost(t, u, py, kind, p, longest):  # type: ignore[no-untyped-def]
    """Residual sum of squares at p = (dead time, lag, lag2), folded to positive times and bounded."""
    if abs(p[0]) > longest or abs(p[1]) > 20.0 * longest or abs(p[2]) > longest:
        return np.inf
    return _gain_and_rss(t, u, py, kind, abs(p[0]), abs(p[1]), abs(p[2]))[1]


@jit
def _nelder_mead(t, u, py, kind, start, dim, step, longest):  # type: ignore[no-untyped-def]
    """Downhill simplex (Nelder & Mead 1965) in (dead time, lag[, lag2]).

    Written with scalars and one place that evaluates the cost: array expressions and copies of the inlined
    cost would take most of the time that compiling takes.
    """
    points = np.zeros((dim + 1, 3))
    values = np.zeros(dim + 1)
    centre, trial, kept = np.zeros(3), np.zeros(3), np.zeros(3)
    scale = 0.2 * (start[1] + start[2]) + 0.2 * step
    for k in range(dim + 1):
        for m in range(3):
            points[k, m] = start[1 + m] + (scale if k == m + 1 else 0.0)
    at, phase, kept_value = 0, FILL, 0.0  # `at`: the vertex that is evaluated while the simplex is (re)filled
    for _ in range(200):
        if phase == FILL:
            _toward(trial, points[at], points[at], 0.0)
        value = _cost(t, u, py, kind, trial, longest)
        if phase == FILL:
            values[at] = value
            at += 1
            if at <= dim:
                continue
        elif phase == REFLECT and value < values[0]:
            _toward(kept, trial, trial, 0.0)
            kept_value = value
            _toward(trial, centre, points[dim], -2.0)
            phase = EXPAND
            continue
        elif phase == REFLECT and value >= values[dim - 1]:
            _toward(kept, points[dim], points[dim], 0.0)
            if value < values[dim]:
                _toward(kept, trial, trial, 0.0)
            _toward(trial, centre, kept, 0.5)
            phase = CONTRACT
            continue
        elif phase == EXPAND and value >= kept_value:
            _toward(points[dim], kept, kept, 0.0)
            values[dim] = kept_value
        elif phase == CONTRACT and value >= values[dim]:
            for k in range(1, dim + 1):
                _toward(points[k], points[0], points[k], 0.5)
            at, phase = 1, FILL
            continue
        else:
            _toward(points[dim], trial, trial, 0.0)
            values[dim] = value
        _sort(points, values)
        if values[dim] - values[0] <= 1e-10 * values[0] or _size(points) < 1e-7 * step:
            break
        for m in range(3):
            centre[m] = 0.0
            for k in range(dim):
                centre[m] += points[k, m] / dim
        _toward(trial, centre, points[dim], -1.0)
        phase = REFLECT
    _sort(points, values)
    out = np.empty(5)
    for m in range(3):
        out[1 + m] = abs(points[0, m])
    if out[3] > out[2]:
        out[2], out[3] = out[3], out[2]
    out[4], out[0] = _gain_and_rss(t, u, py, kind, out[1], out[2], out[3])
    return out


@jit
def _toward(out, a, b, share):  # type: ignore[no-untyped-def]
    """``out = a + share (b - a)``."""
    for m in range(3):
        out[m] = a[m] + share * (b[m] - a[m])


@jit
def _size(points):  # type: ignore[no-untyped-def]
    """Largest distance, in any coordinate, of the worst point from the best."""
    far = 0.0
    for m in range(3):
        far = max(far, abs(points[-1, m] - points[0, m]))
    return far


@jit
def _sort(points, values):  # type: ignore[no-untyped-def]
    """Sort the vertices by value, in place (insertion: there are three or four)."""
    for k in range(1, len(values)):
        j = k
        while j > 0 and values[j - 1] > values[j]:
            values[j - 1], values[j] = values[j], values[j - 1]
            for m in range(3):
                points[j - 1, m], points[j, m] = points[j, m], points[j - 1, m]
            j -= 1
