"""The indirect fit: the whole loop, model and known controller, simulated from the step and matched to PV.

The direct fit takes OP as it was measured; under noise that OP holds the noise that travelled round the loop,
and dead time comes out too low. Simulating OP too has no such bias (theory: closed-loop identification, e.g.
Ljung 1999, ch. 13), but needs settings and form that reproduce the loop's OP.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tuners.settings import NotRepresentableError, Settings

from .fitting import closed_loop, load_response
from .identify import INDIRECT, INTEGRATING, Array, Fit, with_uncertainty

REPRODUCES = 0.98
"""Share of OP's variance that the known settings must explain, fed with the measured SP and PV."""
OFF_GRID = 0.15
"""Sample periods by which a point may lie off the regular grid on which a controller is simulated."""
ITERATIONS = 25
"""Levenberg-Marquardt steps; five to ten do."""


@dataclass(frozen=True, slots=True)
class _Case:
    """A window laid on the controller's grid."""

    kind: int
    period: float
    at: np.ndarray
    """(n,) scan of each point; negative before the onset."""
    time: Array
    """(n,) [s] from the onset."""
    r: Array
    """(scans,) set point as deviation [PV]."""
    y: Array
    """(n,) PV as deviation [PV]."""
    controller: tuple[float, float, float, float, float, float]
    """kp, ki, kd, tf, b, c of the standard form."""
    load: bool


def reproduces(window: Array, settings: Settings, period: float) -> float:
    """Share of OP's variance that these settings explain, fed with the window's SP and PV (at most 1).

    The integral's start is not known: a constant is fitted.
    """
    standard = _standard(settings)
    if standard is None:
        return -math.inf
    kp, ki, kd, tf, b, c = standard
    steps = np.diff(window[:, 0])
    wide = np.flatnonzero(
        steps > 3.0 * np.median(steps)
    )  # the far past of a load step is kept in coarse points
    t, sp, pv, op = window[(wide[-1] + 1 if len(wide) and wide[-1] < len(window) // 2 else 0) :].T
    e = sp - pv
    dt = np.diff(t, prepend=t[0] - period)
    integral = np.cumsum(e * dt)
    slope_in = c * sp - pv
    slope = np.zeros(len(t))
    for k in range(1, len(t)):
        slope[k] = (tf * slope[k - 1] + slope_in[k] - slope_in[k - 1]) / (tf + dt[k])
    wish = kp * (b * sp - pv) + ki * integral + kd * slope
    spread = float(np.var(op))
    return 1.0 - float(np.var(op - wish)) / spread if spread > 0 else -math.inf


def indirect_fit(window: Array, before: int, period: float, settings: Settings, start: Fit) -> Fit | None:
    """Fit the model by simulating the closed loop, from the direct fit on.

    Parameters
    ----------
    window
        (n, 4): time [s], SP, PV [PV], OP [OP].
    before
        Points before the onset.
    period
        Of samples and scans [s].
    settings
        Of the controller, in any form.
    start
        The direct fit: kind of process, first guess, and whether a load stepped.

    Returns
    -------
    Fit or None
        None where the window does not lie on a regular grid or nothing better than the guess is found.
    """
    case = _case(window, before, period, settings, start)
    if case is None:
        return None
    p = np.array(
        [math.log(abs(start.gain)), start.lag, start.dead_time, *([start.onset] if case.load else [])]
    )
    sign = math.copysign(1.0, start.gain)
    p, residual, size = _levenberg_marquardt(case, p.astype(np.float64), sign, start.lag2)
    if not np.isfinite(residual).all():
        return None
    jacobian = _jacobian(case, p, sign, start.lag2, residual)
    model = (sign * math.exp(p[0]), float(p[1]), float(p[2]), start.lag2)
    fit = with_uncertainty(start.process, model, case.time, case.y, residual, jacobian, INDIRECT)
    return replace(fit, size=size, onset=float(p[3])) if case.load else fit


def _standard(settings: Settings) -> tuple[float, float, float, float, float, float] | None:
    try:
        s = settings.to("standard")
    except NotRepresentableError:
        return None
    return float(s.kp), float(s.ki), float(s.kd), float(s.filter_time), float(s.b), float(s.c)


def _case(window: Array, before: int, period: float, settings: Settings, start: Fit) -> _Case | None:
    controller, load = _standard(settings), start.onset is not None
    if controller is None or period <= 0:
        return None
    t, sp, pv, _ = window.T
    at = np.round(t / period).astype(np.int64)
    if np.abs(t - at * period).max() > OFF_GRID * period or np.any(np.diff(at) <= 0):
        return None
    first = int(at[0]) if load else 0  # a set point moves at the onset; a load's onset is what is sought
    sp0 = float(np.median(sp[: max(before, 1)]))
    scans = int(at[-1]) - first + 1
    if scans > 50_000:
        return None
    place = np.searchsorted(at, np.arange(first, first + scans), side="right") - 1
    r = sp[np.maximum(place, 0)] - sp0
    return _Case(
        kind=0 if start.process == INTEGRATING else 1, period=period, at=at - first, time=t, r=r, y=pv - sp0,
        controller=controller, load=load,
    )  # fmt: skip


def _residual(case: _Case, p: Array, sign: float, lag2: float) -> tuple[Array, float]:
    """PV less the simulated one, a constant (and the load's size) fitted; (n,) [PV], and that size [OP]."""
    gain, lag, dead_time = sign * math.exp(min(p[0], 700.0)), max(p[1], 0.0), max(p[2], 0.0)
    disturbance = np.zeros(0)
    if case.load:
        grid = np.arange(len(case.r)) * case.period + float(case.time[0] - case.at[0] * case.period)
        disturbance = load_response(grid - p[3], case.kind, gain, dead_time, lag, lag2)
    y = closed_loop(case.r, case.period, case.kind, gain, dead_time, lag, lag2, *case.controller, disturbance)
    simulated = np.where(case.at >= 0, y[np.maximum(case.at, 0)], 0.0)
    if not case.load:
        rest = case.y - simulated
        return np.asarray(rest - rest.mean()), 0.0
    moved = simulated - simulated.mean()
    power = float(moved @ moved)
    size = float(moved @ case.y) / power if power > 0 and math.isfinite(power) else 0.0
    return np.asarray(case.y - case.y.mean() - size * moved), size


def _jacobian(case: _Case, p: Array, sign: float, lag2: float, residual: Array) -> Array:
    """(n, k): PV's change per unit of ln gain, lag, dead time [and onset]."""
    scale = abs(p[1]) + abs(p[2]) + 0.2 * case.period
    # secants of 5 %: at a lag of zero the tangents of lag and dead time coincide
    steps = np.array([0.01, 0.05 * scale, 0.05 * scale, 0.05 * scale])[: len(p)]
    columns = []
    for k, step in enumerate(steps):
        q = p.copy()
        q[k] += step
        columns.append((residual - _residual(case, q, sign, lag2)[0]) / step)
    return np.column_stack(columns)


def _levenberg_marquardt(case: _Case, p: Array, sign: float, lag2: float) -> tuple[Array, Array, float]:
    """Least squares in (ln gain, lag, dead time[, onset]), times at 0 or above: optimum, residual, load's size."""
    residual, size = _residual(case, p, sign, lag2)
    cost, damping = float(residual @ residual), 1e-3
    for _ in range(ITERATIONS):
        if not math.isfinite(cost):
            break
        j = _jacobian(case, p, sign, lag2, residual)
        if not np.isfinite(j).all():
            break
        normal, slope = j.T @ j, j.T @ residual
        gained = 0.0
        for _ in range(8):
            step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal) + 1e-300), slope, rcond=None)[0]
            q = p + step
            q[0] = np.clip(q[0], p[0] - 1.0, p[0] + 1.0)
            q[1:3] = np.maximum(q[1:3], 0.0)
            trial, trial_size = _residual(case, q, sign, lag2)
            value = float(trial @ trial)
            if value < cost:
                gained = cost - value
                p, residual, size, cost, damping = q, trial, trial_size, value, max(damping / 5, 1e-9)
                break
            damping *= 4
        if gained < 1e-7 * cost or gained == 0.0:
            break
    return p, residual, size
