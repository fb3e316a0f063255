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
AVERAGED_SAMPLES = (1, 2, 4, 8, 16)
"""Samples in an average, at which all is fitted: a loop may be much slower than its samples."""
LEAST_AVERAGES = 60
"""Averages without which a model of 16 parameters says nothing."""
PV_LAGS, OP_LAGS, PATH_LAGS = 5, 6, 3
"""Past averages of PV, OP and path that a model takes. The linear model has five more parameters than the element's:
what is gained by mere flexibility does not count."""
BASE, SHORT, LINEAR = 8, 11, 16
"""Columns without OP (mean, PV's past, two moves of SP), with OP's three last ones, with all of OP."""
LOW_PASSES = (1.0 / 4.0, 1.0 / 12.0)
"""Weights of the newest in the low-passes of OP: what a slow process still owes to older ones."""
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
def columns_of(sp, y, u):
    """Return a row for each average from the seventh on: the linear model's columns, then PV itself."""
    n = len(y)
    rows = np.zeros((n - OP_LAGS, LINEAR + 1))
    slow = np.full(2, u[0])
    for t in range(1, n):
        for k in range(2):
            slow[k] += LOW_PASSES[k] * (u[t - 1] - slow[k])
        if t < OP_LAGS:
            continue
        row = rows[t - OP_LAGS]
        row[0] = 1.0
        for i in range(PV_LAGS):
            row[1 + i] = y[t - 1 - i]
        row[6] = sp[t] - sp[t - 1]
        row[7] = sp[t - 1] - sp[t - 2]
        for j in range(OP_LAGS):
            row[BASE + j] = u[t - 1 - j]
        row[14], row[15] = slow[0], slow[1]
        row[LINEAR] = y[t]
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
        Products of the path's lags with the columns and PV, (PATH_LAGS, LINEAR + 1); overwritten.
    own
        Products of the path's lags, (PATH_LAGS, PATH_LAGS).
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
    for i in range(PATH_LAGS):
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
    s = np.zeros((PATH_LAGS + 1, PATH_LAGS + 1))
    f = np.zeros((PATH_LAGS + 1, PATH_LAGS + 1))
    for which in range(2):
        last = BASE if which == 0 else LINEAR
        for i in range(PATH_LAGS):
            s[i, i] = own[i, i]
            for j in range(i + 1):
                s[i, j] = own[i, j]
                for k in range(last):
                    s[i, j] -= z[i, k] * z[j, k]
            s[PATH_LAGS, i] = z[i, LINEAR]
            for k in range(last):
                s[PATH_LAGS, i] -= z[i, k] * zy[k]
            s[i, i] += 1e-7 * own[i, i]
        s[PATH_LAGS, PATH_LAGS] = base if which == 0 else linear
        factor(s)
        if which == 0:
            f[:] = s
    element = max(f[PATH_LAGS, PATH_LAGS] ** 2, 1e-12)
    both = max(s[PATH_LAGS, PATH_LAGS] ** 2, 1e-12)
    b = np.zeros(PATH_LAGS)
    back(f, f[PATH_LAGS], PATH_LAGS, b)
    rest = zy[:BASE] - b[0] * z[0, :BASE] - b[1] * z[1, :BASE] - b[2] * z[2, :BASE]
    a = np.zeros(LINEAR)
    back(low, rest, BASE, a)
    ours, dc = sign * b.sum(), 1.0 - a[1 : 1 + PV_LAGS].sum()
    back(low, zy, LINEAR, a)
    out[0] = n * np.log(linear / element)
    out[1] = n * np.log(linear / both)
    out[2] = n * np.log(element / both)
    out[3] = n * np.log(base / short)
    out[4] = ours / max(dc, 0.01) if ours > 0 else 0.0
    out[5] = ours / max(sign * a[BASE:].sum(), 1e-9)


@jit
def path_products(rows, v, first, cross, own):
    """Sum the products of the path's lags with columns and PV from a row on."""
    cross[:] = 0.0
    own[:] = 0.0
    for t in range(first, len(rows)):
        row = rows[t]
        at = t + OP_LAGS
        v1, v2, v3 = v[at - 1], v[at - 2], v[at - 3]
        for k in range(LINEAR + 1):
            cross[0, k] += v1 * row[k]
            cross[1, k] += v2 * row[k]
            cross[2, k] += v3 * row[k]
        own[0, 0] += v1 * v1
        own[1, 0] += v1 * v2
        own[1, 1] += v2 * v2
        own[2, 0] += v1 * v3
        own[2, 1] += v2 * v3
        own[2, 2] += v3 * v3


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
    cross, own = np.empty((PATH_LAGS, LINEAR + 1)), np.empty((PATH_LAGS, PATH_LAGS))
    one = np.empty(len(FIELDS))
    for shape in range(paths.shape[0]):
        for b in range(len(bands)):
            for start in range(paths.shape[2]):
                at = moved[shape, b, start] // m + PATH_LAGS - OP_LAGS
                chunk = max((at * CHUNKS + n - 1) // n, 0)
                if chunk >= CHUNKS:
                    continue
                first = (chunk * n + CHUNKS - 1) // CHUNKS
                if n - first < LEAST_AVERAGES:
                    continue
                if not known[chunk]:
                    factor(lows[chunk])
                    known[chunk] = True
                v = (averages(paths[shape, b, start], m) - u_mean) / u_scale
                path_products(rows, v, first, cross, own)
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
