"""The compiled part of a fit: a model's exact response to held input, and the search for its times.

``kind`` is 0 for an integrating, 1 for a self-regulating process under a set-point step, and 2 and 3 for the
same under a load step. Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from .state import jit

FILL, REFLECT, EXPAND, CONTRACT = range(4)
"""Phases of the simplex search."""


@jit
def _lagged(t, u, tau):
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
def response(t, u, kind, dead_time, lag, lag2):
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
        # PV is measured before OP moves: at the instant of a move the old OP still counts
        while j + 1 < n and t[j + 1] < at:
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
def project(x, t, kind):
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
def _gain_and_rss(t, u, y, kind, dead_time, lag, third):
    """Best gain and residual sum of squares at these times; ``y`` is projected already.

    ``third`` is the second lag, or, for a load step, the onset after the window's first point.
    """
    if kind >= 2:
        return _with_load(t, u, y, kind - 2, dead_time, lag, third)
    x = project(response(t, u, kind, dead_time, lag, third), t, kind)
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
def _with_load(t, u, y, process, dead_time, lag, onset):
    """Best gain and residual sum of squares with a load step whose size is free: two columns."""
    x = project(response(t, u, process, dead_time, lag, 0.0), t, 1)
    g = project(load_response(t - t[0] - onset, process, 1.0, dead_time, lag, 0.0), t, 1)
    xx = xg = gg = xy = gy = 0.0
    for i in range(len(x)):
        xx += x[i] * x[i]
        xg += x[i] * g[i]
        gg += g[i] * g[i]
        xy += x[i] * y[i]
        gy += g[i] * y[i]
    det = xx * gg - xg * xg
    if det <= 1e-14 * xx * gg:
        return 0.0, np.inf
    gain = (gg * xy - xg * gy) / det
    load = (xx * gy - xg * xy) / det
    rss = 0.0
    for i in range(len(x)):
        r = y[i] - gain * x[i] - load * g[i]
        rss += r * r
    return gain, rss


@jit
def search(t, u, y, kind):
    """Best (rss, dead time, lag, third, gain): a coarse grid, then Nelder-Mead.

    ``third`` is the second lag, or, for a load step, the onset after the window's first point.
    """
    py = project(y.copy(), t, kind)
    span = t[-1]
    step = (t[-1] - t[0]) / len(t)
    best = np.array([np.inf, 0.0, step, 0.0, 0.0])
    onsets = 10 if kind >= 2 else 1
    m = 12 if kind < 2 else 8
    thin = max(len(t) // (200 if kind < 2 else 100), 1)  # the grid only has to find the valley
    tt, uu = _thinned(t, u, thin)
    yy = project(y[::thin].copy()[: len(tt)], tt, kind)
    longest = 0.5 * span if kind in {0, 2} else span
    for a in range(m):
        dead_time = 0.0 if a == 0 else step * (0.5 * span / step) ** ((a - 1) / (m - 1))
        for b in range(m):
            lag = 0.0 if b == 0 else step * (longest / step) ** ((b - 1) / (m - 1))
            for c in range(onsets):
                # a load is looked for far back and, ever more closely, shortly before it was noticed
                third = (
                    -t[0] - 2.0 * step * (-t[0] / (2.0 * step)) ** (c / (onsets - 1)) if kind >= 2 else 0.0
                )
                gain, rss = _gain_and_rss(tt, uu, yy, kind, dead_time, lag, third)
                if rss < best[0]:
                    best[0], best[1], best[2], best[3], best[4] = rss, dead_time, lag, third, gain
    best[0] = np.inf
    dim = 2 if kind == 0 else 3
    for _ in range(2):  # a second start from the first one's end frees a collapsed simplex
        best = _nelder_mead(t, u, py, kind, best, dim, step, longest)
    return best


@jit
def _thinned(t, u, thin):
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
def _cost(t, u, py, kind, p, longest):
    """Residual sum of squares at p = (dead time, lag, third), folded to positive times and bounded."""
    most = -t[0] if kind >= 2 else longest  # a load step came before it was noticed
    if abs(p[0]) > longest or abs(p[1]) > 20.0 * longest or abs(p[2]) > most:
        return np.inf
    return _gain_and_rss(t, u, py, kind, abs(p[0]), abs(p[1]), abs(p[2]))[1]


@jit
def _nelder_mead(t, u, py, kind, start, dim, step, longest):  # noqa: C901, PLR0912, PLR0915 (one cost, see below)
    """Downhill simplex (Nelder & Mead 1965) in (dead time, lag[, third]).

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
            if kind >= 2 and m == 2 and k == 3:  # a fifth earlier, seen from when it was noticed
                points[k, m] = max(start[3] - 0.2 * (-t[0] - start[3]) - step, 0.0)
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
    if kind == 1 and out[3] > out[2]:
        out[2], out[3] = out[3], out[2]
    out[4], out[0] = _gain_and_rss(t, u, py, kind, out[1], out[2], out[3])
    return out


@jit
def _toward(out, a, b, share):
    """``out = a + share (b - a)``."""
    for m in range(3):
        out[m] = a[m] + share * (b[m] - a[m])


@jit
def _size(points):
    """Largest distance, in any coordinate, of the worst point from the best."""
    far = 0.0
    for m in range(3):
        far = max(far, abs(points[-1, m] - points[0, m]))
    return far


@jit
def _sort(points, values):
    """Sort the vertices by value, in place (insertion: there are three or four)."""
    for k in range(1, len(values)):
        j = k
        while j > 0 and values[j - 1] > values[j]:
            values[j - 1], values[j] = values[j], values[j - 1]
            for m in range(3):
                points[j - 1, m], points[j, m] = points[j, m], points[j - 1, m]
            j -= 1


@jit
def load_response(age, kind, gain, dead_time, lag, lag2):
    """Response of PV, at these ages of a load step of one unit of OP at the process input; 0 before it shows."""
    y = np.zeros(len(age))
    if lag2 > 0.0 and abs(lag - lag2) < 1e-3 * lag:
        lag2 = lag * (1.0 - 1e-3)
    for k in range(len(age)):
        h = age[k] - dead_time
        if h <= 0.0:
            continue
        first = np.exp(-h / lag) if lag > 0.0 else 0.0
        if kind == 0:
            y[k] = gain * (h - lag * (1.0 - first))
        elif lag2 > 0.0:
            y[k] = gain * (1.0 - (lag * first - lag2 * np.exp(-h / lag2)) / (lag - lag2))
        else:
            y[k] = gain * (1.0 - first)
    return y


@jit
def closed_loop(r, period, kind, gain, dead_time, lag, lag2, kp, ki, kd, tf, b, c):
    """PV of the loop from rest, scan by scan: the model under a PID (standard form, backward differences).

    ``r`` is the set point as deviation. OP is held over a scan; a dead time between scans splits the hold.
    """
    n = len(r)
    y, u = np.zeros(n), np.zeros(n)
    if lag2 > 0.0 and abs(lag - lag2) < 1e-3 * lag:
        lag2 = lag * (1.0 - 1e-3)
    late = int(dead_time / period)
    part = dead_time - late * period  # of each scan under the older output
    rest = period - part
    a1, a2 = (np.exp(-part / lag), np.exp(-rest / lag)) if lag > 0.0 else (0.0, 0.0)
    b1, b2 = (np.exp(-part / lag2), np.exp(-rest / lag2)) if lag2 > 0.0 else (0.0, 0.0)
    s = z1 = z2 = integral = slope = before = 0.0
    for k in range(n):
        if kind == 0:
            y[k] = gain * (s - lag * z1)
        elif lag2 > 0.0:
            y[k] = gain * (lag * z1 - lag2 * z2) / (lag - lag2)
        else:
            y[k] = gain * z1
        e = r[k] - y[k]
        integral += ki * e * period
        now = c * r[k] - y[k]
        slope = (tf * slope + now - before) / (tf + period)
        before = now
        u[k] = kp * (b * r[k] - y[k]) + integral + kd * slope
        if not abs(u[k]) < 1e12:  # the model is unstable: far from any fit
            y[k:] = 1e12
            return y
        older = u[k - late - 1] if k > late else 0.0
        newer = u[k - late] if k >= late else 0.0
        s += older * part + newer * rest
        z1 = newer + (older + (z1 - older) * a1 - newer) * a2
        z2 = newer + (older + (z2 - older) * b1 - newer) * b2
    return y
