"""The indirect fit: the whole loop, model and known controller, simulated from the step and matched to PV.

The direct fit takes OP as it was measured; under noise that OP holds the noise that travelled round the loop,
and dead time comes out too low. Simulating OP too has no such bias (theory: closed-loop identification, e.g.
Ljung 1999, ch. 13), but needs settings and form that reproduce the loop's OP.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.models import INTEGRATING
from tuners.settings import NotRepresentableError, Settings

from .fit import INDIRECT, Fit
from .response import closed_loop
from .uncertainty import tangent_scatter, with_uncertainty

LEAST_OP_EXPLAINED = 0.98
"""Share of OP's variance that the known settings must explain, fed with the measured SP and PV."""
OFF_GRID_PERIODS = 0.15
"""Sample periods by which a point may lie off the regular grid on which a controller is simulated."""
MOST_SCANS = 50_000
"""Scans above which a window is not simulated."""
MOST_ITERATIONS = 25
"""Levenberg-Marquardt steps; five to ten do."""


@dataclass(frozen=True, eq=False, slots=True)
class _Scans:
    """A window laid on the controller's grid."""

    kind: int
    period: float
    at: NDArray[np.int64]
    """(n,) scan of each point; negative before the onset."""
    time: Array
    """(n,) [s] from the onset."""
    r: Array
    """(scans,) set point as deviation [PV]."""
    y: Array
    """(n,) PV as deviation [PV]."""
    controller: tuple[float, float, float, float, float, float]
    """kp, ki, kd, tf, b, c of the standard form."""
    sign: float
    lag2: float


def op_explained(window: EventWindow, settings: Settings, period: float) -> float:
    """Share of OP's variance that these settings explain, fed with the window's SP and PV (at most 1).

    The integral's start is not known: a constant is fitted.
    """
    standard = _standard(settings)
    if standard is None:
        return -math.inf
    kp, ki, kd, tf, b, c = standard
    steps = np.diff(window.time)
    wide = np.flatnonzero(
        steps > 3.0 * np.median(steps)
    )  # the far past of a load step is kept in coarse points
    first = wide[-1] + 1 if len(wide) and wide[-1] < len(window) // 2 else 0
    t, sp, pv, op = (column[first:] for column in (window.time, window.sp, window.pv, window.op))
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


def indirect_fit(window: EventWindow, period: float, settings: Settings, start: Fit) -> Fit | None:
    """Fit the model to a set-point step by simulating the closed loop, from the direct fit on.

    Parameters
    ----------
    period
        Of samples and scans [s].
    settings
        Of the controller, in any form.
    start
        The direct fit: kind of process and first guess.

    Returns
    -------
    Fit or None
        None where the window does not lie on a regular grid or nothing better than the guess is found.
    """
    scans = _on_scans(window, period, settings, start)
    if scans is None:
        return None
    p = np.array([math.log(abs(start.gain)), start.lag, start.dead_time])
    p, residual = _levenberg_marquardt(scans, p)
    if not np.isfinite(residual).all():
        return None
    model = (scans.sign * math.exp(p[0]), float(p[1]), float(p[2]), start.lag2)
    # secants of 5 %: at a lag of zero the tangents of lag and dead time coincide
    jacobian = _jacobian(scans, p, residual, 0.05)
    quiet = float(np.std(residual))  # after the direct fit's, whose noise it is
    scatter = tangent_scatter(residual, jacobian, float(p[1] + p[2]), period, quiet)
    return with_uncertainty(start.process, model, scans.time, scans.y, residual, scatter, period, INDIRECT)


def _standard(settings: Settings) -> tuple[float, float, float, float, float, float] | None:
    try:
        s = settings.to("standard")
    except NotRepresentableError:
        return None
    return float(s.kp), float(s.ki), float(s.kd), float(s.filter_time), float(s.b), float(s.c)


def _on_scans(window: EventWindow, period: float, settings: Settings, start: Fit) -> _Scans | None:
    controller = _standard(settings)
    if controller is None or period <= 0:
        return None
    t, sp, pv = window.time, window.sp, window.pv
    at = np.round(t / period).astype(np.int64)
    if (
        np.abs(t - at * period).max() > OFF_GRID_PERIODS * period
        or np.any(np.diff(at) <= 0)
        or at[-1] > MOST_SCANS
    ):
        return None
    sp0 = float(np.median(sp[: max(window.before, 1)]))
    place = np.searchsorted(at, np.arange(int(at[-1]) + 1), side="right") - 1
    return _Scans(
        kind=0 if start.process == INTEGRATING else 1,
        period=period,
        at=at,
        time=t,
        r=sp[np.maximum(place, 0)] - sp0,
        y=pv - sp0,
        controller=controller,
        sign=math.copysign(1.0, start.gain),
        lag2=start.lag2,
    )


def _residual(scans: _Scans, p: Array) -> Array:
    """PV less the simulated one, a constant fitted; (n,) [PV]."""
    gain, lag, dead_time = scans.sign * math.exp(min(p[0], 700.0)), max(p[1], 0.0), max(p[2], 0.0)
    y = closed_loop(scans.r, scans.period, scans.kind, gain, dead_time, lag, scans.lag2, *scans.controller)
    rest = scans.y - np.where(scans.at >= 0, y[np.maximum(scans.at, 0)], 0.0)
    return np.asarray(rest - rest.mean())


def _jacobian(scans: _Scans, p: Array, residual: Array, share: float) -> Array:
    """(n, 3): PV's change per unit of ln gain, lag and dead time; secants of this share of T0."""
    scale = share * (abs(p[1]) + abs(p[2]) + 0.2 * scans.period)
    columns = []
    for k, step in enumerate((0.01, scale, scale)):
        q = p.copy()
        q[k] += step
        columns.append((residual - _residual(scans, q)) / step)
    return np.column_stack(columns)


def _levenberg_marquardt(scans: _Scans, p: Array) -> tuple[Array, Array]:
    """Least squares in (ln gain, lag, dead time), times at 0 or above: optimum and residual.

    Our own: `scipy.optimize.least_squares` with bounds takes three times as long, and its optimum differs in the last
    digits.
    """
    residual = _residual(scans, p)
    cost, damping = float(residual @ residual), 1e-3
    for _ in range(MOST_ITERATIONS):
        # short secants: one that reaches into the unstable region says nothing of the slope here
        j = _jacobian(scans, p, residual, 0.002)
        if not (math.isfinite(cost) and np.isfinite(j).all()):
            break
        normal, slope = j.T @ j, j.T @ residual
        gained = 0.0
        for _ in range(8):
            step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal) + 1e-300), slope, rcond=None)[0]
            q = p + step
            q[0] = np.clip(q[0], p[0] - 1.0, p[0] + 1.0)
            q[1:] = np.maximum(q[1:], 0.0)
            trial = _residual(scans, q)
            value = float(trial @ trial)
            if value < cost:
                gained = cost - value
                p, residual, cost, damping = q, trial, value, max(damping / 5, 1e-9)
                break
            damping *= 4
        if gained <= 1e-7 * cost:
            break
    return p, residual
