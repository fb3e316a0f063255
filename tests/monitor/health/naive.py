"""The health modules' sums as plain formulas over all samples so far: the oracle for the streaming ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BLOCK = 64


@dataclass(frozen=True)
class Seen:
    """The samples of a loop so far, once a second but for gaps."""

    time: Array
    """[s]"""
    sp: Array
    pv: Array
    op: Array
    auto: NDArray[np.bool_]
    quiet: NDArray[np.bool_]
    """Whether nothing went on when the sample came."""
    op_low: float
    op_high: float

    def until(self, n: int) -> Seen:
        return Seen(
            *(getattr(self, f)[:n] for f in ("time", "sp", "pv", "op", "auto", "quiet")),
            self.op_low,
            self.op_high,
        )

    @property
    def dt(self) -> Array:
        """Before each sample but the first [s]."""
        return np.diff(self.time)

    @property
    def good(self) -> NDArray[np.bool_]:
        """Whether no gap is before it."""
        return self.dt <= 3.5

    @property
    def driven(self) -> NDArray[np.bool_]:
        """Whether it and the sample before it are in automatic."""
        return self.good & self.auto[1:] & self.auto[:-1]

    def stretches(self, among: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
        """Samples that follow each other without a break."""
        return [
            np.array([k + 1 for k, _ in run])
            for so, run in groupby(enumerate(among), key=lambda x: x[1])
            if so
        ]

    def errors(self) -> list[Array]:
        """In automatic, from break to break."""
        return [(self.sp - self.pv)[run] for run in self.stretches(self.driven)]


def blocks(runs: list[Array], length: int = BLOCK) -> Iterator[Array]:
    """Full blocks, which begin anew at each break."""
    for run in runs:
        yield from run[: len(run) // length * length].reshape(-1, length)


def repeats(values: Array, runs: list[NDArray[np.int64]]) -> Iterator[tuple[float, int, bool]]:
    """Value, number of samples at which it was as before, and whether it ended by another value, in stretches."""
    for run in runs:
        same = [(values[k], values[k] == values[k - 1]) for k in run]
        grouped = [list(g) for _, g in groupby(same, key=lambda x: x[1])]
        for i, group in enumerate(grouped):
            if group[0][1]:
                yield group[0][0], len(group), i + 1 < len(grouped)


def coverage(seen: Seen) -> dict[str, Any]:
    dt, good = seen.dt, seen.good
    return {
        "wall_time": dt.sum(),
        "good_time": np.minimum(dt, 1.5)[good].sum(),
        "manual_time": dt[good & ~seen.auto[:-1]].sum(),
        "auto_time": dt[seen.driven].sum(),
    }


def offset(seen: Seen) -> dict[str, Any]:
    before, dt = (seen.sp - seen.pv)[:-1][seen.driven], seen.dt[seen.driven]
    means = np.array([block.mean() for block in blocks(seen.errors())])
    return {
        "error": (before * dt).sum(),
        "size": (abs(before) * dt).sum(),
        "blocks": len(means),
        "means": means.sum(),
        "mean_squares": (means**2).sum(),
    }


def saturation(seen: Seen) -> dict[str, Any]:
    """Samples come once a second: a rest's samples are its seconds."""
    op, driven = seen.op[1:][seen.driven], seen.driven
    if not len(op):
        return {}
    moves = abs(np.diff(seen.op))[driven]
    rests = list(repeats(seen.op, seen.stretches(driven)))
    before = seen.op[:-1][driven]
    return {
        "lowest": op.min(),
        "highest": op.max(),
        "least_step": min(moves[moves > 0], default=0.0),
        "samples": len(op),
        "low_time": sum(n for v, n, _ in rests if v == op.min() and n >= 5),
        "high_time": sum(n for v, n, _ in rests if v == op.max() and n >= 5),
        "limit_time": seen.dt[driven][(before <= seen.op_low) | (before >= seen.op_high)].sum(),
        "held_time": sum(n for v, n, _ in rests if seen.op_low < v < seen.op_high and n >= 200),
    }


def bends(values: Array, run: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Second differences in a stretch, before which nothing moves, and those one and two samples before."""
    bend = np.diff(values[run] - values[run - 1], prepend=0.0)
    return bend, np.r_[0.0, bend][:-1], np.r_[0.0, 0.0, bend][:-2]


def mean_log(variances: list[float], weights: list[float]) -> float:
    """Sum of the logarithms of the blocks' variances, each at most 1 above the mean of those before."""
    total = known = 0.0
    for v, w in zip(map(math.log, variances), weights, strict=True):
        total += w * (min(v, total / known + 1.0) if known >= 1.0 else v)
        known += w
    return total


def measurement(seen: Seen) -> dict[str, Any]:
    """What follows the samples one by one, and the noise; neither quantum nor lines."""
    moved = np.diff(seen.pv) != 0
    rests = list(repeats(seen.pv, seen.stretches(seen.good)))
    short = [n for _, n, over in rests if over and n <= 64]
    every = np.zeros((3, len(seen.time)))
    for run in seen.stretches(seen.good):
        every[:, run] = bends(seen.pv, run)
    squares, first, second = every[0] ** 2, every[0] * every[1], every[0] * every[2]
    open_block = np.array([], np.int64)
    done: list[NDArray[np.int64]] = []
    for run in seen.stretches(seen.driven):
        done += list(blocks([run]))  # type: ignore[list-item, arg-type]
        open_block = run[len(run) // BLOCK * BLOCK :]
    if not seen.driven[-1]:
        open_block = open_block[:0]
    weights = [1.0 if seen.quiet[block[-1]] else 0.1 for block in done]
    return {
        "samples": seen.good.sum(),
        "changes": (moved & seen.good).sum(),
        "stays": len(short),
        "stayed": sum(short),
        "squares": squares[open_block].sum(),
        "products_1": first[open_block].sum(),
        "products_2": second[open_block].sum(),
        "blocks": sum(weights),
        "log_variance": mean_log([squares[block].mean() for block in done], weights),
        "acf_1": sum(w * first[b].sum() / squares[b].sum() for b, w in zip(done, weights, strict=True)),
        "acf_2": sum(w * second[b].sum() / squares[b].sum() for b, w in zip(done, weights, strict=True)),
    }


def travel(seen: Seen) -> dict[str, Any]:
    """OP's noise; at each level the differences of its averages (of its path: `test_path`)."""
    variances, products = [], []
    for i, run in enumerate(seen.stretches(seen.driven)):
        # the first sample lays the grid, and all begins after it
        bend, before, _ = bends(seen.op, run[1:] if i == 0 else run)
        if i == 0:
            bend, before = np.r_[0.0, bend], np.r_[0.0, before]
        for b, older in zip(blocks([bend]), blocks([before]), strict=True):
            if b.any():  # an OP at rest tells nothing of its noise
                variances.append(float((b * b).mean()))
                products.append(float((b * older).sum() / (b * b).sum()))
    averages = [
        [
            seen.op[run][: len(run) >> k << k].reshape(-1, 1 << k).mean(axis=1)
            for run in seen.stretches(seen.driven)
        ]
        for k in range(14)
    ]
    return {
        "blocks": len(variances),
        "log_variance": mean_log(variances, [1.0] * len(variances)),
        "acf_1": sum(products),
        "levels": {
            "squares": [sum((np.diff(y) ** 2).sum() for y in level) for level in averages],
            "differences": [sum(max(len(y) - 1, 0) for y in level) for level in averages],
        },
    }


def tag_mapping(seen: Seen) -> dict[str, Any]:
    """Counts, and the products of each sample; an odd one counts ten of the usual size."""
    e, op = seen.sp - seen.pv, seen.op
    usual, products = np.zeros(3), np.zeros(6)
    for k in np.flatnonzero(seen.driven) + 1:
        x = np.array([e[k], e[k] - e[k - 1], op[k] - op[k - 1]])
        odd = (usual > 0) & (abs(x) > 10 * usual)
        a, b, c = x * min([1.0, *(10 * usual[odd] / abs(x[odd]))])
        products += a * a, a * b, b * b, a * c, b * c, c * c
        grown = np.where(usual > 0, usual + (np.minimum(abs(x), 10 * usual) - usual) / 64, abs(x))
        usual = np.where(x != 0, grown, usual)
    moved = {n: (np.diff(getattr(seen, n)) != 0) & seen.driven for n in ("sp", "pv", "op")}
    return {
        "samples": seen.driven.sum(),
        **{f"{n}_moves": moved[n].sum() for n in moved},
        "tracked": (moved["pv"] & (e[1:] == 0)).sum(),
        "products": [products],
    }


def harris(seen: Seen) -> dict[str, Any]:
    full = list(blocks(seen.errors()))
    lags = range(30)
    return {
        "blocks": len(full),
        "error": sum(x.sum() for x in full),
        "covariance": [sum(np.mean(x[lag:] * x[: BLOCK - lag]) for x in full) for lag in lags],
    }


def autocorrelation(seen: Seen) -> dict[str, Any]:
    """Blocks of averages over 1, 4, 16, ... samples, less their trend; those that move throughout vote."""
    out: dict[str, Any] = {"blocks": [], "votes": [], "power": [], "acf": []}
    for size in (1, 4, 16, 64, 256):
        averages = [e[: len(e) // size * size].reshape(-1, size).mean(axis=1) for e in seen.errors()]
        at = np.arange(BLOCK)
        full = [x - np.polyval(np.polyfit(at, x, 1), at) for x in blocks(averages)]
        votes = [
            x
            for x in full
            if (x.reshape(4, -1) ** 2).sum(axis=1).min() >= 0.25 * (x**2).sum() / 4
            and abs(x).mean() >= 0.7 * x.std()
        ]
        acf = [
            [x[: BLOCK - lag] @ x[lag:] / (BLOCK - lag) / (x @ x / BLOCK) for lag in range(46)] for x in votes
        ]
        out["blocks"].append(len(full))
        out["votes"].append(len(votes))
        out["power"].append(sum(float(x.var()) for x in votes))
        out["acf"].append(np.sum(acf, axis=0) if acf else np.zeros(46))
    return {"levels": out}


def cycles_of(e: Array) -> dict[str, Any]:
    """Whole cycles of an error without a break, from upward crossing to upward crossing, and their harmonics."""
    mean, size, side = e[0], 0.0, 0
    starts = []
    for k, x in enumerate(e):
        d = x - mean
        mean += d / min(k + 1, 64)
        size += (abs(d) - size) / min(k + 1, 64)
        if side < 0 and d > 0.6 * size:
            starts.append(k)
            side = 1
        elif side >= 0 and d < -0.6 * size:
            side = -1
    whole = [(a, b) for a, b in pairwise(starts) if 4 <= b - a <= 63]
    shape = np.zeros(5)
    for a, b in whole:
        n = b - a
        x = e[a:b] - e[a] - (e[b] - e[a]) / n * np.arange(n)
        c = 2.0 / n * np.fft.rfft(x)
        if n >= 8:
            # the sine's phase, three times, off that of the third harmonic
            locked = c[3] * (np.conj(c[1]) / abs(c[1])) ** 3 * abs(c[1])
            shape += abs(c[1]) ** 2, locked.real, locked.imag, abs(c[2]) ** 2, abs(c[4]) ** 2
    lengths = np.array([b - a for a, b in whole])
    lost = sum(b - a if b - a < 4 else 63 for a, b in pairwise(starts) if not 4 <= b - a <= 63)
    return {
        "cycles": len(whole),
        "length": lengths.sum(),
        "length_squares": (lengths**2).sum(),
        "lost": lost,
        "shape": shape,
    }


TWINS: dict[str, Callable[[Seen], dict[str, Any]]] = {
    f.__name__: f
    for f in (coverage, offset, saturation, travel, measurement, tag_mapping, harris, autocorrelation)
}
"""By the part of the loop's record."""
