"""The compiled least squares of a window: what follows linearly is projected out (Golub & Pereyra 1973).

Where PV's noise goes on, as a load that wanders makes it, every column is put through the filter that turns that noise
into innovations: generalised least squares (Aitken 1935), the noise a local level or trend (Harvey 1989, ch. 4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from monitor.compiled import jit
from monitor.contract.samples import Array

from .response import START, STEP, area_of, lagged, load_of_shape, load_response, respond, shares

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


class Filter(NamedTuple):
    """What `project` does to columns at given times, worked out once for all of them."""

    line: Array
    """(m,) What a slope is, as the innovations have it; empty without one."""
    power: float
    """Its sum of squares."""
    walk: Array
    """(m, 4) of each innovation: its standard deviation, gains of level and trend, time to the next; empty without."""
    volume: float
    """Sum of the logarithms of the innovations' variances; all of these in variances of the white noise."""


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
    filter: Filter
    """Of ``beside`` at the times of PV."""
    area: Array
    """(k,) OP's integral up to each time [OP s]."""


class Room(NamedTuple):
    """Room for the responses of one model, which is taken once and filled in many times."""

    z1: Array
    z2: Array
    """(k,) What the lags make of OP."""
    x: Array
    """(m,) What OP does to PV, gain 1, projected."""
    g: Array
    """(m,) What a load of one unit does; empty without one."""


LOAD, DEAD_TIME, LAGS = range(3)
"""What has changed since a room was filled: the load alone, the dead time too, all."""


@jit
def columns_of(at, since, held, measured, kind, high, shape, beside):
    """Make columns, with all that is worked out once for them; as in `Columns`."""
    by = filter_of(at, beside)
    pv = project(measured.copy(), by)
    return Columns(at, since, held, measured, pv, kind, high, shape, beside, by, area_of(since, held))


@jit
def filter_of(t, beside):
    """Return what takes mean (and slope) out of columns at these times, and noise that goes on.

    White noise and a walk: by the Kalman filter of a local level or trend (Harvey 1989, ch. 4), nothing known of either
    at the beginning. Its gains are the same whatever is in a column.
    """
    order, ratio = beside.order, beside.ratio
    walk = np.empty((len(t) if order > 0 else 0, 4))
    p11, p12, p22 = DIFFUSE, 0.0, DIFFUSE if order > 1 else 0.0
    volume = 0.0
    for i in range(len(walk)):
        s = p11 + 1.0
        if i >= order:
            volume += np.log(s)
        k1, k2 = p11 / s, p12 / s
        dt = t[i + 1] - t[i] if i < len(t) - 1 else 0.0
        walk[i, 0], walk[i, 1], walk[i, 2], walk[i, 3] = np.sqrt(s), k1, k2, dt
        p22 -= k2 * p12
        p12, p11 = p12 / s, k1
        if order == 1:
            p11 += ratio * dt
        else:
            p11 += dt * (2.0 * p12 + dt * (p22 + ratio * dt / 3.0))
            p12 += dt * (p22 + 0.5 * ratio * dt)
            p22 += ratio * dt
    sloped = beside.sloped and order < 2  # a trend takes the slope up
    line = np.zeros(0)
    if sloped:
        line = t - (t.mean() if order == 0 else t[0])
        innovations(line, walk)
    power = 0.0
    for i in range(len(line)):
        power += line[i] ** 2
    return Filter(line, power, walk, volume)


@jit
def project(x, by):
    """Take mean (and slope) out of a column, in place: c0 and c1 need no search. As innovations where noise goes on."""
    x -= x.mean()
    innovations(x, by.walk)
    if len(by.line) > 0:
        top = 0.0
        for i in range(len(x)):
            top += by.line[i] * x[i]
        slope = top / by.power
        for i in range(len(x)):
            x[i] -= slope * by.line[i]
    return x


@jit
def innovations(x, walk):
    """Turn a column into innovations, in place, which have the variance of the white noise; ``walk`` as in `Filter`."""
    level = trend = 0.0
    for i in range(len(walk)):
        e = x[i] - level
        x[i] = e / walk[i, 0]
        trend += walk[i, 2] * e
        level += walk[i, 1] * e
        level += walk[i, 3] * trend


@jit
def room_for(w):
    """Return room for responses in a window."""
    k, m = len(w.since), len(w.at)
    return Room(np.empty(k), np.empty(k), np.empty(m), np.empty(m if w.kind >= 2 else 0))


@jit
def fill(w, p, room, changed):
    """Fill a room with the responses of a model, of which this has ``changed`` (`LOAD`, `DEAD_TIME`, `LAGS`)."""
    lag2 = p[P_SHARE] * p[P_LAG]
    kind = w.kind % 2
    if changed == LAGS:
        lagged(w.since, w.held, p[P_LAG], shares(kind, p[P_LAG], lag2)[0], room.z1, room.z2)
    if changed >= DEAD_TIME:
        held = w.since, w.held, w.area, room.z1, room.z2
        respond(w.at, held, kind, p[P_DEAD_TIME], p[P_LAG], lag2, room.x)
        project(room.x, w.filter)
    if w.kind >= 2:
        age = w.at - p[P_ONSET]
        room.g[:] = load_of_shape(age, kind, 1.0, p[P_DEAD_TIME], p[P_LAG], lag2, p[P_WIDTH], w.shape)
        project(room.g, w.filter)


@jit
def unit_responses(w, p):
    """Return what OP and what a load step of one unit do to PV, gain 1, projected; the latter empty without one."""
    room = room_for(w)
    fill(w, p, room, LAGS)
    return room.x, room.g


@jit
def evaluate(w, p, r):
    """Best gain, gain times load size, and residual sum of squares; the residuals go to ``r``."""
    return evaluate_in(room_for(w), w, p, r, LAGS)


@jit
def evaluate_in(room, w, p, r, changed):
    """Return the same as `evaluate`, in a room that is filled but for what has ``changed``; see `fill`."""
    fill(w, p, room, changed)
    py, x, g = w.pv, room.x, room.g
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
    for i in range(len(x)):
        r[i] = py[i] - gain * x[i]
    for i in range(len(g)):
        r[i] -= load * g[i]
    rss = 0.0
    for i in range(len(x)):
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
        moved = project((on - off) * (area[k] / (end[k] - first[k])), w.filter)
        for i in range(len(at)):
            for j in range(len(inverse)):
                out[j, k] += inverse[j, i] * moved[i]
    return out
