"""How much better a valve's element explains a block than a linear model: compiled.

PV is predicted from its own past, the set point's moves, and OP's past; or, in place of OP, from the path of a valve's
element. Both are least squares, by one triangular factor of the products (Cholesky's): what a model leaves follows from
the columns that it takes. The path is known exactly for each band, since OP is known.

Elements (one parameter, the band w): *play* moves just so far that it stays within w/2 of OP; *stick* rests until OP is
w away, then jumps the whole way (A. Stenman, F. Gustafsson, K. Forsman, Int. J. Adaptive Control Signal Process. 17
(2003) 769-790). The comparison is derived.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit

from .valve_rests import RESTS, rests_of

SHAPES = ("play", "stick")
AVERAGED_SAMPLES = (1, 2, 4, 8)
"""Samples in an average, at which all is fitted: a loop may be much slower than its samples."""
LEAST_AVERAGES = 60
"""Averages without which a model of so many parameters says nothing."""
PV_LAGS, OP_LAGS = 5, 6
"""Past averages of PV, and of OP or path, that a model takes."""
LOW_PASSES = (1.0 / 4.0, 1.0 / 12.0)
"""Weights of the newest in the low-passes of OP, or path: what a slow process still owes to older ones."""
PV_LOW_PASSES = (1.0 / 8.0, 1.0 / 24.0)
"""The same of PV: where noise is large, its mean says more than its last values."""
PATH = OP_LAGS + 2
"""Columns of OP, or of the path in its place: both models have as many parameters."""
BASE, SHORT, LINEAR = PV_LAGS + 5, PV_LAGS + 8, PV_LAGS + 5 + PATH
"""Columns without OP (mean, PV's past, two moves of SP, PV's low-passes), with OP's three last ones, with all."""
CHUNKS = 16
"""Parts of a block: a path that is known later than at the first sample is fitted from the next part on."""
TINY_SHARE = 1e-9
"""Of a column's power, below which what others leave of it is rounding."""
LEAST_LR = 3.0
"""Of a band at any level, without which its rests are not looked at."""
FIELDS = ("lr", "both", "miss", "lin", "gain", "ratio")
"""Of a fit, see `compare`."""


@jit
def path_of(op, w, shape, start, v):
    """Fill `v` with the element's path; return the sample at which it first moves.

    `start`: -1, 0, 1, where the path begins: half a band (of play; a whole one of stick) below OP, at OP, above.
    """
    half = 0.5 * w if shape == 0 else w
    at = op[0] + start * half * (1.0 - 1e-9)
    moved = len(op)
    for t in range(len(op)):
        x = op[t]
        before = at
        if shape == 0:
            at = min(max(at, x - half), x + half)
        elif abs(x - at) > half:
            at = x
        if at != before and moved == len(op):
            moved = t
        v[t] = at
    return moved


@jit
def averages(x, m):
    """Return means of m samples each; what is left at the end is left out."""
    n = len(x) // m
    out = np.empty(n)
    for i in range(n):
        total = 0.0
        for j in range(m):
            total += x[i * m + j]
        out[i] = total / m
    return out


@jit
def past_of(u, out, first):
    """Fill columns from `first` on with the last values of a series before each average, and its low-passes."""
    fast, slow = u[0], u[0]
    for t in range(1, len(u)):
        fast += LOW_PASSES[0] * (u[t - 1] - fast)
        slow += LOW_PASSES[1] * (u[t - 1] - slow)
        if t >= OP_LAGS:
            row = out[t - OP_LAGS]
            for j in range(OP_LAGS):
                row[first + j] = u[t - 1 - j]
            row[first + OP_LAGS], row[first + OP_LAGS + 1] = fast, slow


@jit
def columns_of(sp, y, u):
    """Return a row for each average from the seventh on: the linear model's columns, then PV itself."""
    n = len(y)
    rows = np.empty((n - OP_LAGS, LINEAR + 1))
    fast, slow = y[0], y[0]
    for t in range(1, n):
        fast += PV_LOW_PASSES[0] * (y[t - 1] - fast)
        slow += PV_LOW_PASSES[1] * (y[t - 1] - slow)
        if t < OP_LAGS:
            continue
        row = rows[t - OP_LAGS]
        row[0] = 1.0
        for i in range(PV_LAGS):
            row[1 + i] = y[t - 1 - i]
        row[1 + PV_LAGS], row[2 + PV_LAGS] = fast, slow
        row[3 + PV_LAGS] = sp[t] - sp[t - 1]
        row[4 + PV_LAGS] = sp[t - 1] - sp[t - 2]
        row[LINEAR] = y[t]
    past_of(u, rows, BASE)
    return rows


@jit
def products_of(rows):
    """Return the columns' products, summed from each part of the block to its end: (parts, columns, columns)."""
    n, k = rows.shape
    out = np.zeros((CHUNKS, k, k))
    for t in range(n):
        row = rows[t]
        into = out[t * CHUNKS // n]
        for i in range(k):
            x = row[i]
            for j in range(i + 1):
                into[i, j] += x * row[j]
    for c in range(CHUNKS - 2, -1, -1):
        out[c] += out[c + 1]
    return out


@jit
def factor(a):
    """Turn products into their lower triangular factor, in place; a column that others explain becomes zero."""
    for j in range(len(a)):
        full = a[j, j]
        for i in range(j, len(a)):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            a[i, j] = total
        left = a[j, j]
        scale = 1.0 / np.sqrt(left) if left > TINY_SHARE * full else 0.0
        for i in range(j, len(a)):
            a[i, j] *= scale


@jit
def back(low, z, n, out):
    """Solve low' out = z for the first n."""
    for i in range(n - 1, -1, -1):
        total = z[i]
        for k in range(i + 1, n):
            total -= low[k, i] * out[k]
        out[i] = total / low[i, i] if low[i, i] > 0.0 else 0.0


@jit
def compare(low, cross, own, n, sign, out):
    """Compare an element's path with the linear model.

    Parameters
    ----------
    low
        Factor of the linear model's products, PV last.
    cross
        Products of the path's lags with the columns and PV, (PATH, LINEAR + 1); overwritten.
    own
        Products of the path's lags, (PATH, PATH).
    n
        Averages.
    sign
        1 where OP raises PV, else -1.
    out
        Filled: LR, N ln of what the linear model leaves over what the element leaves; BOTH, N ln of what the linear
        one leaves over what both together leave; MISS, the same of the element; LIN, of the model without OP over
        that with three past OP; the element's static gain [std of PV over std of OP], in feedback's direction; sum
        of its b over that of the linear model.
    """
    z = cross
    for i in range(PATH):
        for j in range(LINEAR):
            total = z[i, j]
            for k in range(j):
                total -= low[j, k] * z[i, k]
            z[i, j] = total / low[j, j] if low[j, j] > 0.0 else 0.0
    zy = low[LINEAR]
    linear = max(zy[LINEAR] ** 2, 1e-12)
    short = linear
    for k in range(SHORT, LINEAR):
        short += zy[k] ** 2
    base = short
    for k in range(BASE, SHORT):
        base += zy[k] ** 2
    s = np.zeros((PATH + 1, PATH + 1))
    f = np.zeros((PATH + 1, PATH + 1))
    for which in range(2):
        last = BASE if which == 0 else LINEAR
        for i in range(PATH):
            s[i, i] = own[i, i]
            for j in range(i + 1):
                s[i, j] = own[i, j]
                for k in range(last):
                    s[i, j] -= z[i, k] * z[j, k]
            s[PATH, i] = z[i, LINEAR]
            for k in range(last):
                s[PATH, i] -= z[i, k] * zy[k]
            s[i, i] += 1e-7 * own[i, i]
        s[PATH, PATH] = base if which == 0 else linear
        factor(s)
        if which == 0:
            for i in range(PATH + 1):
                for j in range(i + 1):
                    f[i, j] = s[i, j]
    element = max(f[PATH, PATH] ** 2, 1e-12)
    both = max(s[PATH, PATH] ** 2, 1e-12)
    b = np.zeros(PATH)
    back(f, f[PATH], PATH, b)
    rest, a = np.empty(BASE), np.zeros(LINEAR)
    for k in range(BASE):
        rest[k] = zy[k]
        for i in range(PATH):
            rest[k] -= b[i] * z[i, k]
    back(low, rest, BASE, a)
    ours, dc = sign * b.sum(), 1.0
    for k in range(1, 3 + PV_LAGS):
        dc -= a[k]
    back(low, zy, LINEAR, a)
    theirs = 0.0
    for k in range(BASE, LINEAR):
        theirs += sign * a[k]
    out[0] = n * np.log(linear / element)
    out[1] = n * np.log(linear / both)
    out[2] = n * np.log(element / both)
    out[3] = n * np.log(base / short)
    out[4] = ours / max(dc, 0.01) if ours > 0 else 0.0
    out[5] = ours / max(theirs, 0.1 * abs(ours)) if ours > 0 else 0.0


@jit
def path_products(rows, past, first, cross, own):
    """Sum the products of the path's columns with the linear model's and PV from a row on."""
    cross[:] = 0.0
    own[:] = 0.0
    for t in range(first, len(rows)):
        row, mine = rows[t], past[t]
        for i in range(PATH):
            x = mine[i]
            for k in range(LINEAR + 1):
                cross[i, k] += x * row[k]
            for k in range(PATH):
                own[i, k] += x * mine[k]


@jit
def feedback_sign(e, op):
    """Return 1 where OP answers an error with its own sign (OP raises PV), else -1: by the PI law that fits best."""
    best, sign = -1.0, 1.0
    for m in (1, 4, 16):
        if len(e) // m < LEAST_AVERAGES // 2:
            break
        x, u = averages(e, m), averages(op, m)
        pp = pi = ii = py = iy = yy = 0.0
        for t in range(1, len(x)):
            p, i, y = x[t] - x[t - 1], x[t], u[t] - u[t - 1]
            pp += p * p
            pi += p * i
            ii += i * i
            py += p * y
            iy += i * y
            yy += y * y
        det = pp * ii - pi * pi
        if det <= 1e-12 * pp * ii or yy == 0.0:
            continue
        kp, ki = (py * ii - iy * pi) / det, (iy * pp - py * pi) / det
        explained = (kp * py + ki * iy) / yy
        if explained > best:
            best = explained
            sign = 1.0 if kp * np.sqrt(pp) + ki * np.sqrt(ii) >= 0.0 else -1.0
    return sign


@jit
def fit_level(sp, pv, op, m, bands, paths, moved, sign, out, starts):
    """Fit every path at one level of averaging; keep of each band the start that explains most.

    Parameters
    ----------
    paths, moved
        (shapes, bands, starts, samples), (shapes, bands, starts): see `path_of`.
    out, starts
        Filled: (shapes, bands, FIELDS), LR -inf where nothing could be fitted; (shapes, bands), the start.
    """
    y, u, s = averages(pv, m), averages(op, m), averages(sp, m)
    y_mean, u_mean, y_scale, u_scale = y.mean(), u.mean(), y.std(), u.std()
    out[:, :, 0] = -np.inf
    if y_scale == 0.0 or u_scale == 0.0:
        return
    y, u, s = (y - y_mean) / y_scale, (u - u_mean) / u_scale, s / y_scale
    rows = columns_of(s, y, u)
    lows = products_of(rows)
    known = np.zeros(CHUNKS, dtype=np.bool_)
    n = len(rows)
    cross, own = np.empty((PATH, LINEAR + 1)), np.empty((PATH, PATH))
    past, one = np.empty((n, PATH)), np.empty(len(FIELDS))
    for shape in range(paths.shape[0]):
        for b in range(len(bands)):
            for start in range(paths.shape[2]):
                at = moved[shape, b, start] // m
                chunk = max((at * CHUNKS + n - 1) // n, 0)
                if chunk >= CHUNKS:
                    continue
                first = (chunk * n + CHUNKS - 1) // CHUNKS
                if n - first < LEAST_AVERAGES:
                    continue
                if not known[chunk]:
                    factor(lows[chunk])
                    known[chunk] = True
                v = averages(paths[shape, b, start], m)
                for t in range(len(v)):
                    v[t] = (v[t] - u_mean) / u_scale
                past_of(v, past, 0)
                path_products(rows, past, first, cross, own)
                compare(lows[chunk], cross, own, n - first, sign, one)
                if one[0] > out[shape, b, 0]:
                    out[shape, b] = one
                    starts[shape, b] = start


@jit
def fit_block(sp, pv, op, bands):
    """Fit both shapes at all bands and levels.

    Returns
    -------
    table
        (levels, shapes, bands, FIELDS).
    rests
        (shapes, bands, RESTS): of the path of the start that explains most at any level, see `rests_of`.
    """
    n = len(op)
    paths = np.empty((len(SHAPES), len(bands), 3, n))
    moved = np.empty((len(SHAPES), len(bands), 3), dtype=np.int64)
    for shape in range(len(SHAPES)):
        for b in range(len(bands)):
            for start in range(3):
                moved[shape, b, start] = path_of(op, bands[b], shape, start - 1, paths[shape, b, start])
    sign = feedback_sign(sp - pv, op)
    table = np.empty((len(AVERAGED_SAMPLES), len(SHAPES), len(bands), len(FIELDS)))
    table[:] = 0.0
    table[:, :, :, 0] = -np.inf
    starts = np.zeros((len(AVERAGED_SAMPLES), len(SHAPES), len(bands)), dtype=np.int64)
    for level in range(len(AVERAGED_SAMPLES)):
        m = AVERAGED_SAMPLES[level]
        if n // m >= LEAST_AVERAGES:
            fit_level(sp, pv, op, m, bands, paths, moved, sign, table[level], starts[level])
    rests = np.zeros((len(SHAPES), len(bands), len(RESTS)))
    for shape in range(len(SHAPES)):
        for b in range(len(bands)):
            level = np.argmax(table[:, shape, b, 0])
            if table[level, shape, b, 0] > LEAST_LR:
                start = starts[level, shape, b]
                rests_of(op, pv, paths[shape, b, start], bands[b], shape, moved[shape, b, start], rests[shape, b])
    return table, rests
