"""How the loops of the benchmark `plant_life` are recorded: raw, by exception, through a swinging door, in slices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit
from monitor.contract.samples import Samples
from tests.bench.mismatch_plant import Floats
from tests.bench.mismatch_shapes import Rng, log
from tests.bench.plant_life_fleet import Base
from tests.bench.plant_life_sim import STEP_S, Inputs, Lived

RAW, EXCEPTION, ON_CHANGE, DOOR, SLICES = "raw", "exception", "on-change", "swinging-door", "slices"
"""Every sample; values held within a dead band; rows only where a value changes; straight lines; hours of it."""
HOWS = {RAW: 0.5, EXCEPTION: 0.1, ON_CHANGE: 0.1, DOOR: 0.15, SLICES: 0.15}
"""Shares of the loops."""
START_S = 1_767_225_600.0
HEARTBEAT_S = 600.0
"""Time after which a row comes although nothing has changed [s]."""
OP_BAND = 0.1
"""Dead band of OP [% of its span]."""
LOST_SHARE = 0.002
"""Rows that are missing here and there."""
DIGITS = 6
"""Significant digits of an export."""


def record(base: Base, what: Inputs, lived: Lived, rng: Rng, how: str) -> tuple[Samples, NDArray[np.bool_]]:
    """Return what the historian gives out, and at which steps a row lies (None of them is said to be bad)."""
    at = np.arange(int(rng.integers(0, base.every)), len(lived.pv), base.every)
    sp, pv, op = (x[at] for x in (lived.sp + base.pv0, lived.pv + base.pv0, lived.op + base.op0))
    auto = what.auto[at]
    if rng.random() < 0.3:
        auto = np.ones_like(auto)  # no tag says so
    keep = rng.random(len(at)) >= LOST_SHARE
    gaps = rng.integers(0, 3)
    for _ in range(gaps):
        first = int(rng.integers(0, len(at)))
        keep[first : first + int(log(rng, 60.0, 1800.0) / base.every)] = False
    band = base.noise * log(rng, 0.5, 2.5)
    if how in {EXCEPTION, ON_CHANGE}:
        pv, op = held(pv, band), held(op, OP_BAND)
    elif how == DOOR:
        pv, op = drawn(pv, band), drawn(op, OP_BAND)
    elif how == SLICES:
        keep &= _slices(rng, len(at), base)
    if how == ON_CHANGE:
        keep = _changed(rng, at, sp, pv, op)
    sp, pv, op = (_rounded(x) for x in (sp, pv, op))
    time = np.round((START_S + at * STEP_S) * 1e9).astype(np.int64)
    samples = Samples.of(np.zeros(len(at), np.int32), time, sp, pv, op, auto).take(keep)
    seen = np.zeros(len(lived.pv), np.bool_)
    for k in range(base.every):
        seen[np.minimum(at[keep] + k, len(seen) - 1)] = True
    if how == ON_CHANGE:
        seen[:] = True  # what has not changed is known, too
    return samples, seen


def _rounded(values: Floats) -> Floats:
    """Round to the digits of an export, the same number of decimals for all."""
    top = float(np.abs(values).max()) or 1.0
    return np.round(values, DIGITS - 1 - int(np.floor(np.log10(top))))


def _slices(rng: Rng, n: int, base: Base) -> NDArray[np.bool_]:
    """Return the rows of some stretches of an hour or more."""
    keep = np.zeros(n, np.bool_)
    shortest = max(3600.0, 6 * base.settle)
    while keep.mean() < 0.35:
        first = int(rng.integers(0, n))
        keep[first : first + int(shortest * log(rng, 1.0, 3.0) / base.every)] = True
    return keep


def _changed(rng: Rng, at: NDArray[np.int64], *columns: Floats) -> NDArray[np.bool_]:
    """Return the rows in which a value is another than before, and those of the heartbeat."""
    keep = np.ones(len(at), np.bool_)
    keep[1:] = np.any([np.diff(x) != 0.0 for x in columns], axis=0)
    beat = max(int(HEARTBEAT_S / (at[1] - at[0])), 1)
    keep[int(rng.integers(0, beat)) :: beat] = True
    return keep


@jit
def held(values, band):
    """Values after an exception report: the last one sent, until one differs by more than a band."""
    out = values.copy()
    kept = values[0]
    for k in range(len(values)):
        if abs(values[k] - kept) > band:
            kept = values[k]
        out[k] = kept
    return out


@jit
def drawn(values, band):
    """Values after a swinging door (Bristol 1990), drawn straight between those that it keeps."""
    n = len(values)
    out = values.copy()
    start, low, high = 0, -np.inf, np.inf
    for k in range(1, n):
        span = k - start
        low = max(low, (values[k] - band - values[start]) / span)
        high = min(high, (values[k] + band - values[start]) / span)
        if low > high or k == n - 1:
            last = k - 1 if low > high else k
            for i in range(start + 1, last):
                out[i] = values[start] + (values[last] - values[start]) * (i - start) / (last - start)
            start = last
            low, high = values[k] - band - values[start], values[k] + band - values[start]
            if k == start:
                low, high = -np.inf, np.inf
    return out
