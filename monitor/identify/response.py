"""A model's exact response, compiled: to held input, to a load step, and in a closed loop.

``kind`` is 0 for an integrating, 1 for a self-regulating process. Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

STEP, RAMP, LAG, START = range(4)
"""How a load comes: at once, evenly within a time, or through a lag. `START` is none: PV was moving already when the
window began, and what moved it dies away with the process's lag."""
LEAST_WIDTH_SHARE = 1e-6
"""Share of the window that a load takes to come below which it is a step."""


@jit
def lagged(t, u, lag, lag2, z1, z2):
    """Fill in what two lags make of the held input at the points themselves, from rest; of the second where there is.

    Both in one pass: each step of either waits for the one before it, but not for the other's.
    """
    z1[0] = z2[0] = 0.0
    last, decay, decay2 = -1.0, 0.0, 0.0
    for k in range(len(t) - 1):
        dt = t[k + 1] - t[k]
        if abs(dt - last) > 1e-9 * dt:  # an exponential costs more than all the rest
            last = dt
            decay = np.exp(-dt / lag) if lag > 0.0 else 0.0
            decay2 = np.exp(-dt / lag2) if lag2 > 0.0 else 0.0
        z1[k + 1] = u[k] + (z1[k] - u[k]) * decay
        z2[k + 1] = u[k] + (z2[k] - u[k]) * decay2


@jit
def area_of(t, u):
    """Return the held input's integral up to each of the points."""
    s = np.zeros(len(t))
    for k in range(len(t) - 1):
        s[k + 1] = s[k] + u[k] * (t[k + 1] - t[k])
    return s


@jit
def shares(kind, lag, lag2):
    """Partial fractions of the lags: (second lag, weight of the first's output, weight of the second's)."""
    if lag2 <= 0.0:
        return 0.0, lag if kind == 0 else 1.0, 0.0
    if abs(lag - lag2) < 1e-3 * lag:
        lag2 = lag * (1.0 - 1e-3)
    first, second = lag / (lag - lag2), lag2 / (lag - lag2)
    return (lag2, first * lag, second * lag2) if kind == 0 else (lag2, first, second)


@jit
def response_at(at, t, u, kind, dead_time, lag, lag2):
    """Response of the unit-gain model at the times ``at`` to input held from each of the times ``t`` on.

    Exact for any dead time, uneven points, equal lags. Integrating: ``1/(s (lag s + 1)(lag2 s + 1))``, whose
    partial fractions are the input's integral less the weighted outputs of the lags.
    """
    x, z1, z2 = np.empty(len(at)), np.empty(len(t)), np.empty(len(t))
    lag2 = shares(kind, lag, lag2)[0]
    lagged(t, u, lag, lag2, z1, z2)
    respond(at, (t, u, area_of(t, u), z1, z2), kind, dead_time, lag, lag2, x)
    return x


@jit
def respond(at, held, kind, dead_time, lag, lag2, x):
    """Fill in `response_at`; ``held`` are the times from which input is held, the input, its `area_of`, and `lagged`.

    Its second lag is that of `shares`.
    """
    t, u, s, z1, z2 = held
    n = len(t)
    lag2, w1, w2 = shares(kind, lag, lag2)
    j = 0
    last, e1, e2 = -1.0, 1.0, 1.0
    for i in range(len(at)):
        shown = at[i] - dead_time
        if shown <= t[0]:
            x[i] = 0.0
            continue
        # PV is measured before OP moves: at the instant of a move the old OP still counts
        while j + 1 < n and t[j + 1] < shown:
            j += 1
        h = shown - t[j]
        if abs(h - last) > 1e-9 * (abs(h) + dead_time):
            last = h
            e1 = np.exp(-h / lag) if lag > 0.0 else 0.0
            e2 = np.exp(-h / lag2) if lag2 > 0.0 else 0.0
        y = w1 * (u[j] + (z1[j] - u[j]) * e1)
        if lag2 > 0.0:
            y -= w2 * (u[j] + (z2[j] - u[j]) * e2)
        x[i] = s[j] + u[j] * h - y if kind == 0 else y


@jit
def response(t, u, kind, dead_time, lag, lag2):
    """Response of the unit-gain model at the points of its own input."""
    return response_at(t, t, u, kind, dead_time, lag, lag2)


@jit
def load_response(age, kind, gain, dead_time, lag, lag2):
    """Response of PV, at these (rising) ages of a load step of one unit of OP at the input; 0 before it shows."""
    y = np.zeros(len(age))
    lag2, w1, w2 = shares(kind, lag, lag2)
    last, dt, d1, d2, e1, e2 = 0.0, -1.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(age)):
        h = age[k] - dead_time
        if h <= 0.0:
            continue
        if dt < 0.0:  # the first one
            e1 = np.exp(-h / lag) if lag > 0.0 else 0.0
            e2 = np.exp(-h / lag2) if lag2 > 0.0 else 0.0
            dt = 0.0
        else:
            if abs(h - last - dt) > 1e-9 * h:
                dt = h - last
                d1 = np.exp(-dt / lag) if lag > 0.0 else 0.0
                d2 = np.exp(-dt / lag2) if lag2 > 0.0 else 0.0
            e1, e2 = e1 * d1, e2 * d2
        last = h
        shown = w1 * (1.0 - e1) - w2 * (1.0 - e2)
        y[k] = gain * (h - shown if kind == 0 else shown)
    return y


@jit
def _ramp_integral(h, kind, lag, lag2, w1, w2):
    """Integral of the unit load response up to this age, dead time taken off; `shares` are those of the lags."""
    if h <= 0.0:
        return 0.0
    y = w1 * (h - lag * (1.0 - np.exp(-h / lag))) if lag > 0.0 else w1 * h
    if lag2 > 0.0:
        y -= w2 * (h - lag2 * (1.0 - np.exp(-h / lag2)))
    return 0.5 * h * h - y if kind == 0 else y


@jit
def ramp_response(age, kind, gain, dead_time, lag, lag2, width):
    """Response of PV at these ages of a load that rises evenly to one unit of OP within ``width`` [s]."""
    y = np.zeros(len(age))
    lag2, w1, w2 = shares(kind, lag, lag2)
    for k in range(len(age)):
        h = age[k] - dead_time
        if h > 0.0:
            now, before = (
                _ramp_integral(h, kind, lag, lag2, w1, w2),
                _ramp_integral(h - width, kind, lag, lag2, w1, w2),
            )
            y[k] = gain * (now - before) / width
    return y


@jit
def lagged_load_response(age, kind, gain, dead_time, lag, lag2, width):
    """Response of PV at these ages of a load that comes to one unit of OP through a lag of ``width`` [s].

    By partial fractions of all lags ``tau_i``: ``h - sum tau_i + sum a_i e^(-h/tau_i)``, integrating, with ``a_i =
    tau_i^m / prod_j (tau_i - tau_j)``; ``1 - sum a_i/tau_i e^(-h/tau_i)``, self-regulating.
    """
    y = np.zeros(len(age))
    taus = np.array([lag, lag2, width])
    least = 1e-9 * width
    n, total = 0, 0.0
    tau, a = np.zeros(3), np.ones(3)
    for k in range(3):
        value = taus[k]
        if value <= least:
            continue
        for j in range(n):
            if abs(value - tau[j]) < 1e-3 * tau[j]:
                value = tau[j] * (1.0 + 1e-3 * (k + 1))
        tau[n] = value
        total += value
        n += 1
    for i in range(n):
        for j in range(n):
            a[i] *= tau[i] / (tau[i] - tau[j]) if j != i else tau[i]
    for k in range(len(age)):
        h = age[k] - dead_time
        if h <= 0.0:
            continue
        shown = 0.0
        for i in range(n):
            shown += np.exp(-h / tau[i]) * (a[i] if kind == 0 else -a[i] / tau[i])
        y[k] = gain * (h - total + shown if kind == 0 else 1.0 + shown)
    return y


@jit
def start_response(age, lag):
    """Return what is left, at these ages of the window, of one unit of PV that a lag held at its begin."""
    y = np.zeros(len(age))
    for k in range(len(age)):
        if lag > 0.0:
            y[k] = np.exp(-max(age[k], 0.0) / lag)
    return y


@jit
def load_of_shape(age, kind, gain, dead_time, lag, lag2, width, shape):
    """Response of PV at these ages of a load of one unit of OP, that comes in one of these shapes; or of a start."""
    if shape == START:
        return start_response(age, lag)
    if shape == STEP or width <= LEAST_WIDTH_SHARE * (age[-1] - age[0]):
        return load_response(age, kind, gain, dead_time, lag, lag2)
    if shape == RAMP:
        return ramp_response(age, kind, gain, dead_time, lag, lag2, width)
    return lagged_load_response(age, kind, gain, dead_time, lag, lag2, width)


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
