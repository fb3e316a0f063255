"""The law of a PID controller as columns of a regression, and the regression beside an output that drifts and jumps.

What a controller puts out beside its law (a feed-forward, an operator's trim, rounding) is taken for a local level: a
random walk plus white noise (Harvey 1989, ch. 4). Its innovations are differences where the walk dominates, and
levels where the noise does; the constant is free, and free anew after each row where it may have changed.
"""

from __future__ import annotations

import math

import numpy as np

from monitor.compiled import jit

P, INTEGRAL, D, START = range(4)
"""Columns: what kp, ki and kd multiply, and what an unknown start of a filter leaves behind."""
GAINS, OP = 3, 4
"""Columns that are gains; the place of OP behind the columns."""
WALK_SHARES = (0.0, 1e-4, 1e-2, 0.2, 1.0)
"""Share of the walk in the variance of what OP holds beside the law, of which the likeliest is taken."""
FILTER_PERIODS = (
    0.0,
    0.25,
    0.5,
    0.75,
    1.0,
    1.5,
    2.0,
    3.0,
    4.0,
    6.0,
    9.0,
    13.0,
    20.0,
    30.0,
    45.0,
    70.0,
    100.0,
)
"""PV filters that are tried first, in sample periods."""
RIDGE_SHARE = 1e-11
"""Added to each column's own product: of two columns that are the same, neither is preferred."""
GOLDEN_STEPS = 12
"""Steps of the golden section: the filter to a thousandth of the grid's width."""


@jit
def columns(time, sp, pv, law, filter_time, late):
    """Return the columns: (n, 4).

    ``law`` is tf, b, c, the share of the present error in a step of the integral (1: backward, 0: forward difference),
    and how far, in rows, the middle of what OP is a mean of lies behind its row (0 but in a thinned window). The PV
    filter is a block's, ``f += a (pv - f)`` with ``a = dt/(T + dt)``; OP follows ``late`` rows after what it answers
    to, earlier ones where that is negative. What is not known of the start fades as the PV filter forgets it, or,
    without one, the derivative's.
    """
    n = len(time)
    tf, b, c, present, middle = law[0], law[1], law[2], law[3], law[4]
    out = np.zeros((n, 4))
    f = pv[0]
    e = sp[0] - f
    integral, slope, start = 0.0, 0.0, 1.0
    before = c * sp[0] - f
    for k in range(n):
        if k > 0:
            dt = time[k] - time[k - 1]
            a = dt / (filter_time + dt)
            f += a * (pv[k] - f)
            start *= 1.0 - a if filter_time > 0.0 else tf / (tf + dt)
            e_now = sp[k] - f
            if middle > 0.0:  # the set point is held between rows, PV is not
                integral += dt * (0.5 * (e + sp[k - 1] - f))
            else:
                integral += dt * (present * e_now + (1.0 - present) * e)
            e = e_now
            now = c * sp[k] - f
            slope = (tf * slope + now - before) / (tf + dt)
            before = now
        j = k + late
        if 0 <= j < n:
            out[j, P] = b * sp[k] - f
            out[j, INTEGRAL] = integral
            out[j, D] = slope
            out[j, START] = start
            if middle > 0.0 and j > 0:
                held = b * (sp[k] - sp[k - 1]) if k > 0 else 0.0
                for i in range(4):
                    ahead = out[j, i] - (held if i == P else 0.0)
                    out[j - 1, i] += middle * (ahead - out[j - 1, i])
    return out


@jit
def whitened(x, op, use, fresh, walk):
    """Return the innovations of all columns and of OP, (n, p + 1), the sum of ln of their variances, their number.

    A row has none where it is not used or its level is free (``fresh``, or after rows that are not used).
    """
    n, p = x.shape
    out = np.zeros((n, p + 1))
    level = np.zeros(p + 1)
    log_f, spread = 0.0, 0.0
    m = 0
    known = False
    for k in range(n):
        if fresh[k] or not use[k]:
            known = False
        if not use[k]:
            continue
        if not known:
            for j in range(p):
                level[j] = x[k, j]
            level[p] = op[k]
            spread = 1.0 - walk
            known = True
            continue
        ahead = spread + walk
        f = ahead + 1.0 - walk
        gain = ahead / f
        scale = 1.0 / math.sqrt(f)
        for j in range(p + 1):
            v = (x[k, j] if j < p else op[k]) - level[j]
            out[k, j] = v * scale
            level[j] += gain * v
        spread = ahead * (1.0 - gain)
        log_f += math.log(f)
        m += 1
    return out, log_f, m


@jit
def products(white):
    """Return all products of columns with each other: (p, p)."""
    return np.dot(white.T, white)


@jit
def solved(m, active):
    """Return gains (p,) by least squares over the active columns, and the sum of squares that is left."""
    k = len(active)
    p = m.shape[0] - 1
    a, y, scale = np.zeros((k, k)), np.zeros(k), np.zeros(k)
    for i in range(k):
        own = m[active[i], active[i]]
        scale[i] = 1.0 / math.sqrt(own) if own > 0.0 else 0.0
    for i in range(k):
        for j in range(k):
            a[i, j] = m[active[i], active[j]] * scale[i] * scale[j]
        a[i, i] += RIDGE_SHARE if scale[i] > 0.0 else 1.0
        y[i] = m[active[i], p] * scale[i]
    solution = np.linalg.solve(a, y)
    gains = np.zeros(p)
    for i in range(k):
        gains[active[i]] = solution[i] * scale[i]
    return gains, left(m, gains)


@jit
def left(m, gains):
    """Return the sum of squares of what these gains leave of OP."""
    p = m.shape[0] - 1
    total = m[p, p]
    for i in range(p):
        total -= 2.0 * gains[i] * m[i, p]
        for j in range(p):
            total += gains[i] * gains[j] * m[i, j]
    return max(total, 0.0)


@jit
def left_by_known(m, gains):
    """Return the same for known kp, ki, kd, the start of the PV filter fitted."""
    p = m.shape[0] - 1
    known = gains.copy()
    known[START] = 0.0
    cross = m[START, p]
    for i in range(p):
        cross -= known[i] * m[i, START]
    own = m[START, START]
    rest = left(m, known)
    return max(rest - cross * cross / own, 0.0) if own > 1e-12 else rest


@jit
def compared(x, gains, op, use, fresh, share, quantum):
    """Return what known gains leave of OP: jumps (n,), sd of the rest's levels, sd allowed, sd of the law, of OP.

    The rest may hold another constant from each jump on: where it moves by more than four times what is allowed, a
    ``share`` of the law's own movement or the rounding of OP.
    """
    n = len(op)
    rest, jump = np.zeros(n), np.zeros(n, np.bool_)
    count, w1, w2, o1, o2 = 0, 0.0, 0.0, 0.0, 0.0
    first = -1
    for k in range(n):
        wish = gains[0] * x[k, 0] + gains[1] * x[k, 1] + gains[2] * x[k, 2]
        rest[k] = op[k] - wish
        if use[k]:
            if first < 0:
                first, w0, o0 = k, wish, op[k]
            count += 1
            w1, w2 = w1 + wish - w0, w2 + (wish - w0) ** 2
            o1, o2 = o1 + op[k] - o0, o2 + (op[k] - o0) ** 2
    if count == 0:
        return jump, 0.0, 0.0, 0.0, 0.0
    law_sd = math.sqrt(max(w2 / count - (w1 / count) ** 2, 0.0))
    op_sd = math.sqrt(max(o2 / count - (o1 / count) ** 2, 0.0))
    allowed = max(share * law_sd, 0.6 * quantum)
    squares, total, size, start = 0.0, 0.0, 0, 0.0
    for k in range(n):
        if not use[k]:
            continue
        linked = k > 0 and use[k - 1] and not fresh[k]
        jump[k] = linked and abs(rest[k] - rest[k - 1]) > 4.0 * allowed
        if jump[k] or not linked:
            if size > 0:
                squares -= total * total / size
            total, size, start = 0.0, 0, rest[k]
        total += rest[k] - start
        squares += (rest[k] - start) ** 2
        size += 1
    if size > 0:
        squares -= total * total / size
    return jump, math.sqrt(max(squares, 0.0) / count), allowed, law_sd, op_sd


@jit
def judged(rows, law, active, gains, walk, place):
    """Return the sum of squares at a filter and a delay: of known gains, or free where these are NaN.

    ``rows`` is time, sp, pv, op, use, fresh; ``place`` the filter time and the rows of delay.
    """
    time, sp, pv, op, use, fresh = rows
    x = columns(time, sp, pv, law, place[0], int(place[1]))
    m = products(whitened(x, op, use, fresh, walk)[0])
    if math.isnan(gains[0]):
        return solved(m, active)[1]
    return left_by_known(m, gains)


@jit
def search(rows, law, active, gains, walk, limits):
    """Return filter time [s], rows of delay and sum of squares where known (or free) gains explain OP best.

    Filter and delay are near to the same thing: each alone first, then the delay's neighbours with a filter by golden
    section. ``limits`` is the sample period, the longest filter [s], the least and the most rows of delay.
    """
    period, longest, least, most = limits
    best = _on_grid(rows, law, active, gains, walk, limits)
    for _ in range(3):
        centre = best
        for k in range(3):
            d = centre[1] + k - 1.0
            if least <= d <= most:
                t, s = _golden(rows, law, active, gains, walk, (d, centre[0], period, longest))
                if s < best[2] * (1.0 - 1e-9):
                    best = (t, d, s)
        if best[1] == centre[1]:
            break
    return best


@jit
def _on_grid(rows, law, active, gains, walk, limits):
    """Return the same as `search`, of delays without a filter, and of filters with some delays."""
    period, longest, least, most = limits
    best = (0.0, 0.0, judged(rows, law, active, gains, walk, (0.0, 0.0)))
    for d in range(int(least), int(most) + 1):
        s = judged(rows, law, active, gains, walk, (0.0, float(d)))
        if s < best[2]:
            best = (0.0, float(d), s)
    alone = best[1]
    for periods in FILTER_PERIODS:
        if periods * period > longest:
            break
        for late in (0.0, 1.0, alone):
            s = judged(rows, law, active, gains, walk, (periods * period, late))
            if s < best[2] and late <= most:
                best = (periods * period, late, s)
    return best


@jit
def _golden(rows, law, active, gains, walk, near):
    """Return the filter time that explains OP best at a delay, and the sum of squares.

    ``near`` is the delay [rows], a filter time near by, the sample period and the longest filter [s].
    """
    d, t, period, longest = near
    low, high = max(0.5 * t - 1.5 * period, 0.0), min(1.5 * t + 1.5 * period, longest)
    share = 0.6180339887498949
    one, other = high - share * (high - low), low + share * (high - low)
    at_one = judged(rows, law, active, gains, walk, (one, d))
    at_other = judged(rows, law, active, gains, walk, (other, d))
    for _ in range(GOLDEN_STEPS):
        if at_one < at_other:
            high, other, at_other = other, one, at_one
            one = high - share * (high - low)
            at_one = judged(rows, law, active, gains, walk, (one, d))
        else:
            low, one, at_one = one, other, at_other
            other = low + share * (high - low)
            at_other = judged(rows, law, active, gains, walk, (other, d))
    edge = judged(rows, law, active, gains, walk, (low, d)) if low == 0.0 else at_one
    if edge <= min(at_one, at_other):
        return low, edge
    return (one, at_one) if at_one < at_other else (other, at_other)


@jit
def scores(white, gains, active, reach):
    """Return the long-run variance of the scores, (p, p): Bartlett weights over ``reach`` rows (Newey, West 1987)."""
    n, width = white.shape
    k = len(active)
    g = np.zeros((n, k))
    for i in range(n):
        v = white[i, width - 1]
        for j in range(width - 1):
            v -= gains[j] * white[i, j]
        for j in range(k):
            g[i, j] = v * white[i, active[j]]
    out = np.zeros((k, k))
    for lag in range(reach + 1):
        weight = 1.0 - lag / (reach + 1.0)
        for i in range(lag, n):
            for a in range(k):
                for b in range(k):
                    out[a, b] += weight * g[i, a] * g[i - lag, b]
                    if lag > 0:
                        out[a, b] += weight * g[i - lag, a] * g[i, b]
    return out
