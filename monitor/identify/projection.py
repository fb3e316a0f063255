"""The compiled least squares of a window: what follows linearly is projected out (Golub & Pereyra 1973).

Where PV's noise goes on, as a load that wanders makes it, every column is put through the filter that turns that noise
into innovations: generalised least squares (Aitken 1935), the noise a local level or trend (Harvey 1989, ch. 4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from monitor.compiled import jit
from monitor.contract.samples import Array

from .response import START, STEP, load_of_shape, load_response, response_at

P_DEAD_TIME, P_LAG, P_SHARE, P_ONSET, P_WIDTH = range(5)
"""Places of the parameters."""
MOST_SHARE = 0.99
"""Of the second lag in the first; partial fractions need two different lags."""
MOST_POINTS = 500
"""Points above which a window is searched in blocks of mean values: long blocks look like a lag."""


DIFFUSE = 1e10
"""Variance of a level, and of a trend, before the first point, in variances of the noise: nothing is known of it."""


class Beside(NamedTuple):
    """What is in PV beside the responses."""

    sloped: bool
    """A slope goes with the mean: a load that OP did not balance before the event."""
    order: int = 0
    """0: white noise; beside that, 1: a level, 2: a trend that wanders (a random walk)."""
    ratio: float = 0.0
    """Variance that the walk gains in a second, in variances of a point's white noise."""


class Columns(NamedTuple):
    """A window as the compiled functions see it: every point of it, or means over blocks."""

    at: Array
    """(m,) times of PV [s]."""
    since: Array
    """(k,) times from which OP is held [s]; the same as ``at`` where these are all points."""
    held: Array
    """(k,) OP from rest [OP]."""
    measured: Array
    """(m,) PV [PV]."""
    pv: Array
    """(m,) PV, as `project` leaves it [PV]."""
    kind: int
    """0 for an integrating, 1 for a self-regulating process under a set-point step; 2 and 3 with a load."""
    high: Array
    """(5,) upper bounds of the parameters."""
    shape: int
    """How a load comes, within the last of the parameters."""
    beside: Beside


@jit
def project(x, t, beside):
    """Take mean (and slope) out of a column, in place: c0 and c1 need no search. As innovations where noise goes on."""
    x -= x.mean()
    if beside.order == 0:
        return _less_slope(x, t - t.mean()) if beside.sloped else x
    innovations(x, t, beside)
    if not beside.sloped or beside.order > 1:  # a trend takes the slope up
        return x
    line = t - t[0]
    innovations(line, t, beside)
    return _less_slope(x, line)


@jit
def _less_slope(x, line):
    """Take a line out of a column, in place."""
    top = bottom = 0.0
    for i in range(len(x)):
        top += line[i] * x[i]
        bottom += line[i] ** 2
    slope = top / bottom
    for i in range(len(x)):
        x[i] -= slope * line[i]
    return x


@jit
def innovations(x, t, beside):
    """Turn a column into the innovations of white noise and a walk, in place; return the sum of ln of their variances.

    They have the variance of the white noise. The Kalman filter of a local level or trend (Harvey 1989, ch. 4), nothing
    known of either at the beginning.
    """
    order, ratio = beside.order, beside.ratio
    level = trend = 0.0
    p11, p12, p22 = DIFFUSE, 0.0, DIFFUSE if order > 1 else 0.0
    volume = 0.0
    for i in range(len(x)):
        s = p11 + 1.0
        if i >= order:
            volume += np.log(s)
        k1, k2 = p11 / s, p12 / s
        e = x[i] - level
        x[i] = e / np.sqrt(s)
        level += k1 * e
        trend += k2 * e
        p22 -= k2 * p12
        p12, p11 = p12 / s, k1
        if i == len(x) - 1:
            break
        dt = t[i + 1] - t[i]
        if order == 1:
            p11 += ratio * dt
        else:
            level += dt * trend
            p11 += dt * (2.0 * p12 + dt * (p22 + ratio * dt / 3.0))
            p12 += dt * (p22 + 0.5 * ratio * dt)
            p22 += ratio * dt
    return volume


@jit
def unit_responses(w, p):
    """Return what OP and what a load step of one unit do to PV, gain 1, projected; the latter empty without one."""
    lag2 = p[P_SHARE] * p[P_LAG]
    kind = w.kind % 2
    x = project(response_at(w.at, w.since, w.held, kind, p[P_DEAD_TIME], p[P_LAG], lag2), w.at, w.beside)
    if w.kind < 2:
        return x, np.zeros(0)
    age = w.at - p[P_ONSET]
    load = load_of_shape(age, kind, 1.0, p[P_DEAD_TIME], p[P_LAG], lag2, p[P_WIDTH], w.shape)
    return x, project(load, w.at, w.beside)


@jit
def evaluate(w, p, r):
    """Best gain, gain times load size, and residual sum of squares; the residuals go to ``r``."""
    py = w.pv
    x, g = unit_responses(w, p)
    xx = xg = gg = xy = gy = 0.0
    for i in range(len(x)):
        xx += x[i] * x[i]
        xy += x[i] * py[i]
    for i in range(len(g)):
        xg += x[i] * g[i]
        gg += g[i] * g[i]
        gy += g[i] * py[i]
    gain, load = xy / xx, 0.0
    if w.kind >= 2 and (gg > 0.0 or w.shape != START):  # without a lag nothing dies away with it
        det = xx * gg - xg * xg
        if det <= 1e-14 * xx * gg:
            return 0.0, 0.0, np.inf
        gain, load = (gg * xy - xg * gy) / det, (xx * gy - xg * xy) / det
    if not xx > 0.0:
        return 0.0, 0.0, np.inf
    rss = 0.0
    for i in range(len(x)):
        r[i] = py[i] - gain * x[i]
        if w.kind >= 2:
            r[i] -= load * g[i]
        rss += r[i] * r[i]
    return gain, load, rss


@jit
def blocks(t, u, y, most):
    """Thin a window to about ``most`` points: (times of PV, PV, times of OP, OP), means over blocks.

    OP is a block's mean, held from its first time on; PV is the mean, at the mean time.
    """
    size = (len(t) + most - 1) // most
    n = len(t) // size
    at, yy, tt, uu = np.zeros(n), np.zeros(n), np.empty(n), np.empty(n)
    for k in range(n):
        first, end = k * size, min((k + 1) * size, len(t) - 1)
        tt[k] = t[first]
        area = 0.0
        for j in range(first, end):
            area += u[j] * (t[j + 1] - t[j])
        uu[k] = area / (t[end] - tt[k]) if t[end] > tt[k] else u[first]
        for j in range(first, first + size):
            at[k] += t[j] / size
            yy[k] += y[j] / size
    return at, yy, tt, uu


@jit
def slopes(w, p, gain, load):
    """PV's change per unit of ln gain, lag, second lag, dead time [s], and for a load its onset [s] and ln size.

    For a load that is no step also per unit of its width [s]; for a start (`START`) of ln size alone. Secants of 5 %
    of T0: at lags of zero the tangents of lags and dead time coincide. All is projected.
    """
    lags = np.array([p[P_LAG], p[P_SHARE] * p[P_LAG], p[P_DEAD_TIME], p[P_ONSET], p[P_WIDTH]])
    at = w.at
    step = 0.05 * (lags[0] + lags[1] + lags[2]) + 0.05 * (at[-1] - at[0]) / len(at)
    load_moves = w.kind >= 2
    starting = w.shape == START
    m = 4 if not load_moves else 5 if starting else 6 if w.shape == STEP else 7
    out = np.zeros((len(at), m))
    for c in range(1, 4 if starting else 6):
        k = c if c < 5 else 6
        if k >= m:
            break
        ahead, behind = lags.copy(), lags.copy()
        ahead[c - 1] += step
        behind[c - 1] -= step
        if c != 4:
            behind[c - 1] = max(behind[c - 1], 0.0)
        for side, v in ((1.0, ahead), (-1.0, behind)):
            share = min(v[0], v[1]) / max(v[0], v[1]) if v[0] + v[1] > 0.0 else 0.0
            x, g = unit_responses(w, np.array([v[2], max(v[0], v[1]), share, v[3], v[4]]))
            for i in range(len(at)):
                out[i, k] += side * gain * x[i] / (ahead[c - 1] - behind[c - 1])
                if load_moves:
                    out[i, k] += side * load * g[i] / (ahead[c - 1] - behind[c - 1])
    x, g = unit_responses(w, p)
    for i in range(len(at)):
        out[i, 0] = gain * x[i]
        if load_moves:
            out[i, 0] += load * g[i]
            out[i, 4 if starting else 5] = load * g[i]
    return out


@jit
def of_pulses(w, gain, p, first, end, area, inverse):
    """Return what pulses of OP between these times, of these areas [OP s], do to parameters: (parameters, pulses).

    ``inverse`` (parameters, n) is the pseudo-inverse of PV's change per unit of each.
    """
    at = w.at
    out = np.zeros((len(inverse), len(first)))
    for k in range(len(first)):
        on = load_response(at - first[k], w.kind % 2, gain, p[P_DEAD_TIME], p[P_LAG], p[P_SHARE] * p[P_LAG])
        off = load_response(at - end[k], w.kind % 2, gain, p[P_DEAD_TIME], p[P_LAG], p[P_SHARE] * p[P_LAG])
        moved = project((on - off) * (area[k] / (end[k] - first[k])), at, w.beside)
        for i in range(len(at)):
            for j in range(len(inverse)):
                out[j, k] += inverse[j, i] * moved[i]
    return out
