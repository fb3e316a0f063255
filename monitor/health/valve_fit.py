"""How much better a valve's element explains a block than a linear model: compiled.

PV is predicted from its own past, the set point's moves, and OP's past; or, in place of OP, from the path of a valve's
element. Both are least squares with as many parameters, by one triangular factor of the products (Cholesky's): what a
model leaves follows from the columns that it takes. The path is known exactly for each band, since OP is known.

Elements (one parameter, the band w): *play* moves just so far that it stays within w/2 of OP; *stick* rests until OP is
w away, then jumps the whole way (A. Stenman, F. Gustafsson, K. Forsman, Int. J. Adaptive Control Signal Process. 17
(2003) 769-790). The comparison is derived.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit, jit_sums

SHAPES = ("play", "stick")
AVERAGED_SAMPLES = (2, 1, 4, 8)
"""Samples in an average, at which all is fitted: a loop may be much slower than its samples. At the first of them that
a block is long enough for, the path's start is chosen."""
LEAST_AVERAGES = 60
"""Averages without which a model of so many parameters says nothing."""
PV_LAGS, OP_LAGS = 4, 4
"""Past averages of PV, and of OP or path, that a model takes."""
OP_LOW_PASSES = (1.0 / 4.0, 1.0 / 12.0)
"""Weights of the newest in the low-passes of OP, or path: what a slow process still owes to older ones."""
PV_LOW_PASSES = (1.0 / 8.0, 1.0 / 24.0)
"""The same of PV: where noise is large, its mean says more than its last values."""
PATH = OP_LAGS + 2
"""Columns of OP, or of the path in its place: both models have as many parameters."""
LEAN = 3
"""Columns of a lean element, which gains nothing by mere flexibility."""
BASE = PV_LAGS + 5
"""Columns without OP: mean, PV's past and low-passes, two moves of SP."""
LINEAR = BASE + PATH
"""All columns of the linear model; that of PV follows."""
FIRST = 6
"""Averages before the first that is predicted."""
CHUNKS = 16
"""Parts of a block: a path that is known later than at the first sample is fitted from the next part on."""
KNOWN_SHARE = 1.0 / 8.0
"""Of a block, within which OP passes a band: the path is then known whatever its start."""
TINY_SHARE = 1e-9
"""Of a column's power, below which what others leave of it is rounding."""
LEAST_REST, RIDGE_SHARE = 1e-12, 1e-7
"""Left of PV at least, and added to a path's power: rounding."""
NOT_FITTED = -1e9
SIGN_SAMPLES = (1, 4, 16)
"""Samples in the averages at which the controller's sign is looked for: noise may hide it in single samples."""
FIELDS = ("lr", "lean", "miss", "lin", "gain", "ratio")
"""Of a fit, see `_compare`."""

Array = NDArray[np.float64]


@jit
def path_of(op, w, shape, start, v):
    """Fill `v` with the element's path; return the sample from which on it is taken as known.

    `start`: -1, 0, 1, where the path begins: half a band below OP, at OP, above. The path is known where OP has passed
    the band (play), or, if that is late, where it first moves.
    """
    half = 0.5 * w if shape == 0 else w
    at = op[0] + 0.5 * start * w * (1.0 - 1e-9)
    moved = passed = len(op)
    low = high = op[0]
    for t in range(len(op)):
        x = op[t]
        before = at
        if shape == 0:
            at = min(max(at, x - half), x + half)
        elif abs(x - at) > half:
            at = x
        if moved == len(op) and at != before:
            moved = t
        low, high = min(low, x), max(high, x)
        if passed == len(op) and high - low >= w:
            passed = t
        v[t] = at
    if shape == 0 and passed <= KNOWN_SHARE * len(op):
        return passed
    return moved


@jit_sums
def _dot(a, b):
    """Return the sum of the products of two series."""
    total = 0.0
    for t in range(len(a)):
        total += a[t] * b[t]
    return total


@jit
def _averages(x, m, mean, scale, out):
    """Fill `out` with means of m samples each, less a mean, over a scale; what is left at the end is left out."""
    for i in range(len(x) // m):
        total = 0.0
        for j in range(m):
            total += x[i * m + j]
        out[i] = (total / m - mean) / scale


@jit
def _past_of(u, n, lags, weights, out):
    """Fill rows of `out` with the last values of n averages before each, from the seventh on; then its low-passes."""
    for j in range(lags):
        for t in range(FIRST, n):
            out[j, t - FIRST] = u[t - 1 - j]
    for k in range(len(weights)):
        slow = u[0]
        for t in range(1, n):
            slow += weights[k] * (u[t - 1] - slow)
            if t >= FIRST:
                out[lags + k, t - FIRST] = slow


@jit
def _factor(a):
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
def _back(low, z, n, out):
    """Solve low' out = z for the first n."""
    for i in range(n - 1, -1, -1):
        total = z[i]
        for k in range(i + 1, n):
            total -= low[k, i] * out[k]
        out[i] = total / low[i, i] if low[i, i] > 0.0 else 0.0


@jit
def _left_of(z, zy, own, taken, rest, out):
    """Fill `out` with the factor of what the columns that are taken leave of path and PV."""
    path = len(own)
    for i in range(path):
        for j in range(i + 1):
            total = own[i, j]
            for k in range(taken):
                total -= z[i, k] * z[j, k]
            out[i, j] = total
        total = z[i, len(zy) - 1]
        for k in range(taken):
            total -= z[i, k] * zy[k]
        out[path, i] = total
        out[i, i] += RIDGE_SHARE * own[i, i]
    out[path, path] = rest
    _factor(out)


@jit
def _gains(low, z, f, sign, out):
    """Fill `out` with the element's static gain, and with the sum of its b over that of the linear model."""
    path, linear = len(f) - 1, len(low) - 1
    zy = low[linear]
    b, a, rest, ours, dc, theirs = np.zeros(path), np.zeros(linear), np.empty(BASE), 0.0, 1.0, 0.0
    _back(f, f[path], path, b)
    for i in range(path):
        ours += sign * b[i]
    for k in range(BASE):
        rest[k] = zy[k]
        for i in range(path):
            rest[k] -= b[i] * z[i, k]
    _back(low, rest, BASE, a)
    for k in range(1, BASE - 2):
        dc -= a[k]
    _back(low, zy, linear, a)
    for k in range(BASE, linear):
        theirs += sign * a[k]
    out[4] = ours / max(dc, 0.01) if ours > 0 else 0.0
    out[5] = ours / max(theirs, 0.1 * abs(ours)) if ours > 0 else 0.0


@jit
def _compare(low, cross, own, n, sign, out):
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
        Filled: LR, N ln of what the linear model leaves over what the element leaves; LEAN, the same of an element
        with three columns; MISS, N ln of what the element leaves over what both together leave; LIN, of the model
        without OP over that with three past OP; the element's static gain [std of PV over std of OP], in feedback's
        direction; sum of its b over that of the linear model.
    """
    z, path, linear_n = cross, len(own), len(low) - 1
    for i in range(path):
        for j in range(linear_n):
            total = z[i, j]
            for k in range(j):
                total -= low[j, k] * z[i, k]
            z[i, j] = total / low[j, j] if low[j, j] > 0.0 else 0.0
    zy = low[linear_n]
    linear = max(zy[linear_n] ** 2, LEAST_REST)
    short = linear
    for k in range(BASE + 3, linear_n):
        short += zy[k] ** 2
    base = short
    for k in range(BASE, BASE + 3):
        base += zy[k] ** 2
    f, s = np.zeros((path + 1, path + 1)), np.zeros((path + 1, path + 1))
    _left_of(z, zy, own, BASE, base, f)
    _left_of(z, zy, own, linear_n, linear, s)
    element = max(f[path, path] ** 2, LEAST_REST)
    both = max(s[path, path] ** 2, LEAST_REST)
    out[0] = n * np.log(linear / element)
    lean = base
    for k in range(LEAN):
        lean -= f[path, k] ** 2
    out[1] = n * np.log(linear / max(lean, LEAST_REST))
    out[2] = n * np.log(element / both)
    out[3] = n * np.log(base / short)
    _gains(low, z, f, sign, out)


@jit
def _fit_path(columns, n, first, past, low, sign, out):
    """Compare a path's columns with the linear model from an average on; see `_compare`."""
    path, linear = len(past), len(columns)
    cross, own = np.empty((path, linear)), np.empty((path, path))
    for i in range(path):
        for k in range(linear):
            cross[i, k] = _dot(past[i, first:n], columns[k, first:n])
        for k in range(i + 1):
            own[i, k] = _dot(past[i, first:n], past[k, first:n])
    _compare(low, cross, own, n - first, sign, out)


@jit
def _prepare(columns, count, first, low):
    """Fill `low` with the factor of the linear model's products, from an average on."""
    for i in range(len(low)):
        for j in range(i + 1):
            low[i, j] = _dot(columns[i, first:count], columns[j, first:count])
    _factor(low)


@jit
def _try_start(op, w, shape, start, level, fits, work):
    """Fit one path at one level: fill the last of `work`; return whether enough of it is known.

    `fits`: columns, averages used, factors, whether these are known, and `scales`: mean and scale of OP, sign of
    feedback, range within which play is known early;
    `work`: the path, its averages, its columns, the fit.
    """
    columns, counts, lows, known, scales = fits
    v, u, past, one = work
    m, count = AVERAGED_SAMPLES[level], counts[level]
    at = path_of(op, w, shape, start, v)
    chunk = (at // m * CHUNKS + count - 1) // count
    if chunk > CHUNKS // 2:
        return False
    first = (chunk * count + CHUNKS - 1) // CHUNKS
    if known[level, chunk] == 0.0:
        known[level, chunk] = 1.0
        _prepare(columns[level], count, first, lows[level, chunk])
    _averages(v, m, scales[0], scales[1], u)
    _past_of(u, len(op) // m, OP_LAGS, OP_LOW_PASSES, past)
    _fit_path(columns[level], count, first, past, lows[level, chunk], scales[2], one)
    return True


@jit
def _fit_bands(op, bands, columns, counts, scales, table, starts):
    """Fit both shapes at all bands and levels: fill `table` (levels, shapes, bands, FIELDS), `starts` (shapes, bands).

    `columns`: (levels, LINEAR + 1, samples), of which `counts` averages are used; LR stays where nothing is fitted.
    At the first level that the block is long enough for each start is tried, at the others the best of them.
    """
    n, levels, linear = len(op), len(counts), columns.shape[1]
    fits = columns, counts, np.zeros((levels, CHUNKS, linear, linear)), np.zeros((levels, CHUNKS)), scales
    work = np.empty(n), np.empty(n), np.empty((PATH, n)), np.empty(table.shape[3])
    for shape in range(table.shape[1]):
        for b in range(len(bands)):
            chosen = shape == 0 and bands[b] <= scales[3]  # the path is then the same whatever its start
            for level in range(levels):
                if counts[level] == 0:
                    continue
                out = table[level, shape, b]
                for k in range(3):
                    if chosen and k != starts[shape, b]:
                        continue
                    if _try_start(op, bands[b], shape, k - 1, level, fits, work) and work[3][0] > out[0]:
                        for i in range(len(out)):
                            out[i] = work[3][i]
                        starts[shape, b] = k
                if out[0] == NOT_FITTED:
                    break
                chosen = True


def columns_of(sp: Array, pv: Array, op: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the linear model's columns at each level, then PV: (levels, LINEAR + 1, samples); and averages used.

    All are over PV's, or OP's, standard deviation.
    """
    columns = np.zeros((len(AVERAGED_SAMPLES), LINEAR + 1, len(op)))
    counts = np.zeros(len(AVERAGED_SAMPLES), dtype=np.int64)
    s, y, u = (np.empty(len(op)) for _ in range(3))
    y_scale = float(pv.std())
    for level, m in enumerate(AVERAGED_SAMPLES):
        n = len(op) // m
        if n < LEAST_AVERAGES:
            continue
        counts[level], own = n - FIRST, columns[level]
        _averages(sp, m, float(sp[0]), y_scale, s)
        _averages(pv, m, float(pv.mean()), y_scale, y)
        _averages(op, m, float(op.mean()), float(op.std()), u)
        own[0] = 1.0
        _past_of(y, n, PV_LAGS, PV_LOW_PASSES, own[1:])
        own[BASE - 2, : n - FIRST] = s[FIRST:n] - s[FIRST - 1 : n - 1]
        own[BASE - 1, : n - FIRST] = s[FIRST - 1 : n - 1] - s[FIRST - 2 : n - 2]
        _past_of(u, n, OP_LAGS, OP_LOW_PASSES, own[BASE:])
        own[LINEAR, : n - FIRST] = y[FIRST:n]
    return columns, counts


def feedback_sign(e: Array, op: Array) -> float:
    """Return 1 where OP answers an error with its own sign (OP raises PV), else -1: by the PI law that fits best."""
    best, sign = -1.0, 1.0
    for m in SIGN_SAMPLES:
        n = len(e) // m
        if n < LEAST_AVERAGES // 2:
            break
        x, u = (np.asarray(z[: n * m].reshape(n, m).mean(axis=1)) for z in (e, op))
        law, y = np.stack([np.diff(x), x[1:]]), np.diff(u)
        (of_moves, both), (_, of_levels) = (law @ law.T).tolist()
        own_move, own_level = (law @ y).tolist()
        power, det = float(y @ y), of_moves * of_levels - both * both
        if power == 0.0 or det <= TINY_SHARE * of_moves * of_levels:
            continue
        kp = (of_levels * own_move - both * own_level) / det
        ki = (of_moves * own_level - both * own_move) / det
        explained = (kp * own_move + ki * own_level) / power
        if explained > best:
            best, sign = explained, math.copysign(1.0, kp * math.sqrt(of_moves) + ki * math.sqrt(of_levels))
    return sign


def fit_block(sp: Array, pv: Array, op: Array, bands: Array) -> tuple[Array, NDArray[np.int64]]:
    """Fit both shapes at all bands and levels.

    Returns
    -------
    table
        (levels, shapes, bands, FIELDS); LR `NOT_FITTED` where nothing could be fitted.
    starts
        (shapes, bands): the start of the path, see `path_of`, less 1.
    """
    table = np.zeros((len(AVERAGED_SAMPLES), len(SHAPES), len(bands), len(FIELDS)))
    table[..., 0] = NOT_FITTED
    starts = np.ones((len(SHAPES), len(bands)), dtype=np.int64)  # at OP
    columns, counts = columns_of(sp, pv, op)
    early = np.ptp(op[: int(KNOWN_SHARE * len(op)) + 1])
    scales = np.array([op.mean(), op.std(), feedback_sign(sp - pv, op), early])
    _fit_bands(op, bands, columns, counts, scales, table, starts)
    return table, starts
