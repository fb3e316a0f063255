"""The compiled part of a fit: the search for a model's parameters.

``w`` is a window's `Columns`. A model's parameters are ``p = (dead time [s], lag [s], second lag as a share of the
first, time of the load [s], time
within which it comes [s])``; gain, load size and rest follow linearly (variable projection, Golub &
Pereyra 1973). Types are inferred by numba.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .projection import (
    DEAD_TIME,
    LAGS,
    LOAD,
    MOST_SHARE,
    P_DEAD_TIME,
    P_LAG,
    P_ONSET,
    P_SHARE,
    P_WIDTH,
    Room,
    columns_of,
    evaluate_in,
    room_for,
)
from .response import START, STEP, lagged

DEAD_TIME_NODES = 6
"""Dead times, from that of the best single lag down to nothing, from which the best model is looked for."""
POORLY_EXPLAINED_SHARE = 0.02
"""Share of PV's power that the best single lag may leave before it is looked for once more, on a finer grid."""
MOST_DESCENT_STEPS = 30
"""Most steps of a descent (Levenberg-Marquardt)."""


CHANGED = (DEAD_TIME, LAGS, LAGS, LOAD, LOAD)
"""What changes with each of the parameters."""


@jit
def _solve(a, b, n):
    """Solve a x = b for the first n unknowns, in place (Gauss with pivots); whether there is a solution."""
    for i in range(n):
        m = i
        for j in range(i + 1, n):
            if abs(a[j, i]) > abs(a[m, i]):
                m = j
        if not abs(a[m, i]) > 0.0:
            return False
        for c in range(n):
            a[i, c], a[m, c] = a[m, c], a[i, c]
        b[i], b[m] = b[m], b[i]
        for j in range(i + 1, n):
            f = a[j, i] / a[i, i]
            for c in range(i, n):
                a[j, c] -= f * a[i, c]
            b[j] -= f * b[i]
    for i in range(n - 1, -1, -1):
        for c in range(i + 1, n):
            b[i] -= a[i, c] * b[c]
        b[i] /= a[i, i]
    return True


@jit
def _normal(w, p, r, rooms, free, weight, a, b, which):
    """Fill the normal equations of the parameters that are free and not held by a bound; return their number.

    Of the ``rooms``, the first is filled with the responses at ``p``, and the other one free.

    ``weight`` is that of the prior on the second lag's share, in units of the residual sum of squares.
    """
    n, k = len(r), len(free)
    at, high = w.at, w.high
    here, spare = rooms
    same_but = (Room(here.z1, here.z2, here.x, spare.g), Room(here.z1, here.z2, spare.x, spare.g), spare)
    jacobian, trial, q = np.empty((k, n)), np.empty(n), p.copy()
    scale = p[P_DEAD_TIME] + p[P_LAG] * (1.0 + p[P_SHARE]) + (at[-1] - at[0]) / n
    m = 0
    for c in range(k):
        f = free[c]
        h = 1e-5 if f == P_SHARE else 1e-5 * scale
        if p[f] + h > high[f]:
            h = -h
        q[f] = p[f] + h
        changed = CHANGED[f]
        evaluate_in(same_but[changed], w, q, trial, changed)
        q[f] = p[f]
        slope = 0.0
        for i in range(n):
            jacobian[m, i] = (r[i] - trial[i]) / h
            slope += jacobian[m, i] * r[i]
        slope -= weight * p[f] if f == P_SHARE else 0.0
        low = at[0] if f == P_ONSET else 0.0
        if not np.isfinite(slope) or (p[f] <= low and slope < 0.0) or (p[f] >= high[f] and slope > 0.0):
            continue
        which[m], b[m] = f, slope
        m += 1
    for c in range(m):
        for d in range(c, m):
            total = 0.0
            for i in range(n):
                total += jacobian[c, i] * jacobian[d, i]
            a[c, d] = a[d, c] = total
        if which[c] == P_SHARE:
            a[c, c] += weight
    return m


@jit
def descend(w, start, free, weight, steps, close):
    """Levenberg-Marquardt within `Columns.high` over the free parameters: (p, gain, gain times load size, rss, cost).

    ``cost`` is the residual sum of squares plus the prior's share of it. Ends when a step gains less than
    ``close`` of the cost.
    """
    at, high = w.at, w.high
    p, r, trial = start.copy(), np.empty(len(at)), np.empty(len(at))
    here, spare = room_for(w), room_for(w)
    gain, load, rss = evaluate_in(here, w, p, r, LAGS)
    cost = rss + weight * p[P_SHARE] ** 2
    a, b, which = np.zeros((5, 5)), np.zeros(5), np.zeros(5, dtype=np.int64)
    damping = 1e-3
    for _ in range(steps):
        m = _normal(w, p, r, (here, spare), free, weight, a, b, which)
        gained = 0.0
        for _ in range(8 if m > 0 else 0):
            aa, x = a.copy(), b.copy()
            for c in range(m):
                aa[c, c] *= 1.0 + damping
            damping *= 4.0
            if not _solve(aa, x, m):
                continue
            q = p.copy()
            for c in range(m):
                f = which[c]
                # towards no lag by degrees: from there all slopes towards a lag are 0, and no way leads out
                low = at[0] if f == P_ONSET else 0.3 * p[f] if f in (P_LAG, P_WIDTH) else 0.0
                q[f] = min(max(p[f] + x[c], low), high[f])
            found = evaluate_in(spare, w, q, trial, LAGS)
            value = found[2] + weight * q[P_SHARE] ** 2
            if value < cost:
                gained = cost - value
                p, cost = q, value
                r, trial = trial, r
                here, spare = spare, here
                gain, load, rss = found
                damping = max(damping / 20.0, 1e-9)
                break
        if gained <= close * cost:
            break
    return p, gain, load, rss, cost


@jit
def seeks_onset(w):
    """Whether a load's time is one of the parameters that are searched for."""
    return w.kind >= 2 and w.shape != START


@jit
def _coarse(w, step, many):
    """Best parameters of a model with one lag on a coarse grid of ``many`` dead times and lags from ``step`` [s] on."""
    at, high = w.at, w.high
    r = np.empty(len(at))
    sought = seeks_onset(w)
    onsets, starts = (6, 3) if sought else (1, 0)
    best, least = np.array([0.0, step, 0.0, at[0] if w.shape == START else 0.0, 0.0]), np.inf
    p = best.copy()
    room = room_for(w)
    lags, outputs = np.empty(many), np.empty((many, len(w.since)))  # of each lag: the same at every dead time
    for b in range(many):
        lag = 0.0 if b == 0 else step * (high[P_DEAD_TIME] / step) ** ((b - 1) / (many - 1))
        lagged(w.since, w.held, lag, 0.0, outputs[b], room.z2)
        lags[b] = lag
    for a in range(many):
        p[P_DEAD_TIME] = 0.0 if a == 0 else step * (0.5 * w.since[-1] / step) ** ((a - 1) / (many - 1))
        for b in range(many):
            p[P_LAG] = lags[b]
            own = Room(outputs[b], room.z2, room.x, room.g)
            for c in range(onsets + starts):
                if (
                    c >= onsets
                ):  # so that PV begins to answer where it was noticed, without noise, or a little before
                    p[P_ONSET] = max(-p[P_DEAD_TIME] - 2.0 * step * (c - onsets), at[0])
                elif sought:  # far back and, ever more closely, shortly before it was noticed
                    p[P_ONSET] = -2.0 * step * (-at[0] / (2.0 * step)) ** (c / (onsets - 1))
                rss = evaluate_in(own, w, p, r, DEAD_TIME if c == 0 else LOAD)[2]
                if rss < least:
                    best, least = p.copy(), rss
    return best


@jit
def best_of_grid(w, dead_times, lags, onsets, widths):
    """Best models with one lag and a load of the columns' shape, of a grid, for each onset: (onsets, 6) p, rss."""
    r = np.empty(len(w.at))
    p = np.zeros(5)
    out = np.full((len(onsets), 6), np.inf)
    room = room_for(w)
    for dead_time in dead_times:
        for lag in lags:
            changed = LAGS
            for k in range(len(onsets)):
                for width in widths:
                    p[P_DEAD_TIME], p[P_LAG], p[P_ONSET], p[P_WIDTH] = dead_time, lag, onsets[k], width
                    rss = evaluate_in(room, w, p, r, changed)[2]
                    changed = LOAD
                    if rss < out[k, 5]:
                        out[k, :5], out[k, 5] = p, rss
    return out


@jit
def moved(w, p, dead_time):
    """Where to look for the best model at another dead time: what it loses, onset and second lag take up."""
    q = p.copy()
    less = p[P_DEAD_TIME] - dead_time
    q[P_DEAD_TIME] = dead_time
    if seeks_onset(w):
        q[P_ONSET] = min(max(p[P_ONSET] + 0.9 * less, w.at[0]), w.high[P_ONSET])
    q[P_SHARE] = min(
        max(p[P_SHARE] + 0.7 * less / max(p[P_LAG], 1e-9 * w.high[P_LAG]), 0.005), MOST_SHARE - 0.01
    )
    return q


@jit
def search(w, second):
    """Best parameters of a window with two lags (``second``; else with one), and with one lag.

    A coarse grid, the best single lag, then down the valley of ever less dead time: dead time, second lag and
    onset share what the data say; the valley is long, narrow and bent, and has false ends.
    """
    at = w.at
    with_onset = seeks_onset(w)
    single = np.array([P_DEAD_TIME, P_LAG, P_ONSET]) if with_onset else np.array([P_DEAD_TIME, P_LAG])
    beside = np.array([P_LAG, P_SHARE, P_ONSET]) if with_onset else np.array([P_LAG, P_SHARE])
    every = (
        np.array([P_DEAD_TIME, P_LAG, P_SHARE, P_ONSET])
        if with_onset
        else np.array([P_DEAD_TIME, P_LAG, P_SHARE])
    )
    thin = max(len(at) // 100, 1)
    few = at[::thin].copy()
    measured = w.measured[::thin].copy()
    thinned = columns_of(few, w.since, w.held, measured, w.kind, w.high, w.shape, w.beside)
    many = 6 if with_onset else 10
    p = _coarse(thinned, (few[-1] - few[0]) / len(few), many)
    p, _, _, least, _ = descend(w, p, single, 0.0, 20, 1e-5)
    if least > POORLY_EXPLAINED_SHARE * np.sum(w.pv * w.pv):
        # a false minimum? all may have happened within a few points of a long window
        q = _coarse(thinned, (at[-1] - at[0]) / len(at) / 4.0, 2 * many)
        q, _, _, rss, _ = descend(w, q, single, 0.0, 20, 1e-5)
        if rss < least:
            p, least = q, rss
    single_lag = p.copy()
    t0 = p[P_LAG] + p[P_DEAD_TIME]
    for share in (0.25, 0.5):
        if single_lag[P_LAG] < 0.1 * single_lag[P_DEAD_TIME]:
            p[P_DEAD_TIME], p[P_LAG] = (1.0 - share) * t0, share * t0
            p, _, _, rss, _ = descend(w, p, single, 0.0, 20, 1e-5)
            if rss < least:
                single_lag, least = p.copy(), rss
    p, best, top = single_lag.copy(), single_lag.copy(), single_lag[P_DEAD_TIME]
    for k in range(DEAD_TIME_NODES if second else 0):
        dead_time = top * (1.0 - k / (DEAD_TIME_NODES - 1))
        p, _, _, rss, _ = descend(w, moved(w, p, dead_time), beside, 0.0, 10, 1e-3)
        if rss < least:
            best, least = p.copy(), rss
    if second:
        best = descend(w, best, every, 0.0, MOST_DESCENT_STEPS, 1e-7)[0]
    return best, single_lag


@jit
def walk(w, start, stride, weight, scale):
    """Walk along the valley, to less and to more dead time, until it is left: (n, 8) p, gain, load, likelihood.

    Parameters
    ----------
    start
        The best parameters.
    stride
        First step of the dead time [s].
    weight
        Of the prior on the second lag's share, in units of the residual sum of squares.
    scale
        Log-likelihood per unit of the residual sum of squares.
    """
    beside = (
        np.array([P_LAG, P_SHARE])
        if not seeks_onset(w)
        else np.array([P_LAG, P_SHARE, P_ONSET])
        if w.shape == STEP
        else np.array([P_LAG, P_SHARE, P_ONSET, P_WIDTH])
    )
    out = np.empty((17, 8))
    p0, gain, load, _, cost0 = descend(w, start, beside, weight, 1, 1e-4)
    out[0, :5], out[0, 5], out[0, 6], out[0, 7] = p0, gain, load, -scale * cost0
    n = 1
    for side in (-1.0, 1.0):
        p, step, last, best = p0.copy(), stride, -scale * cost0, -scale * cost0
        for _ in range(8):
            dead_time = min(max(p[P_DEAD_TIME] + side * step, 0.0), w.high[P_DEAD_TIME])
            if dead_time == p[P_DEAD_TIME]:
                break
            q, gain, load, _, cost = descend(w, moved(w, p, dead_time), beside, weight, 12, 1e-4)
            stay = p.copy()
            stay[P_DEAD_TIME], stay[P_SHARE] = dead_time, max(p[P_SHARE], 0.005)
            if -scale * cost < last:
                other = descend(w, stay, beside, weight, 12, 1e-4)
                if other[4] < cost:
                    q, gain, load, _, cost = other
            p = q
            now = -scale * cost
            out[n, :5], out[n, 5], out[n, 6], out[n, 7] = p, gain, load, now
            n += 1
            best = max(best, now)
            if best - now > 4.0:
                break
            if abs(now - last) < 0.5:
                step *= 1.7
            elif last - now > 1.5:
                step *= 0.6
            last = now
    return out[:n]
