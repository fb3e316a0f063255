"""Events of the benchmark `mismatch`: what set point, load and feed-forward do, and how it is recorded."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from monitor.contract.samples import Samples
from tests.bench.mismatch_plant import Floats
from tests.bench.mismatch_sim import Rig

if TYPE_CHECKING:
    from tests.bench.mismatch_fleet import Drawn

MOST_SAMPLES = 3000
"""Recorded samples of an event: what is slower is cut off by the end of the data."""
START_S = 1_767_225_600.0
HEARTBEAT_ROWS = 60
"""Rows after which one is sent although nothing has changed."""
SETPOINT, LOAD = "setpoint", "load"


def loading(drawn: Drawn, stage: int, fine: int, onset: int) -> tuple[Floats, Floats, Floats]:
    """Set point, load and feed-forward, all as deviations, of an event; events go there and back in turn."""
    seconds = (np.arange(fine) - onset) * drawn.rig.step
    shape = _shape(drawn, stage, seconds)
    zero = np.zeros(fine)
    sp, load = (drawn.size * shape, zero) if drawn.event == SETPOINT else (zero, drawn.push * shape)
    if drawn.kind.loading == "load-at-output":
        load = zero
    load = load + _beside(drawn, stage, seconds)
    if drawn.kind.block != "feed-forward":
        return sp, load, zero
    there, way = _there(stage)
    measured = _between(drawn, "b", 0.1, 0.5) * drawn.push * _wander(drawn, stage, fine)
    if drawn.extra["d"] < 0.5:
        later = seconds >= _natural(drawn) * _between(drawn, "a", 0.5, 5.0)
        measured = _between(drawn, "b", 0.1, 0.5) * drawn.push * (there + way * later)
    held = (np.arange(fine) // drawn.rig.scan) * drawn.rig.scan
    return sp, load + measured, -_between(drawn, "c", 0.6, 1.2) * measured[held]


def _shape(drawn: Drawn, stage: int, seconds: Floats) -> Floats:
    """What steps, as a share of its size."""
    what, natural, (there, way) = drawn.kind.loading, _natural(drawn), _there(stage)
    jump, past = np.where(seconds >= 0, 1.0, 0.0), np.maximum(seconds, 0.0)
    if what == "load-lag":
        return there + way * (1 - np.exp(-past / (natural * _between(drawn, "a", 0.3, 5.0))))
    if what in {"load-ramp", "setpoint-ramp"}:
        return there + way * np.minimum(past / (natural * _between(drawn, "a", 1.0, 10.0)), 1.0)
    if what == "load-pulse":
        return jump * (seconds < natural * _between(drawn, "a", 1.0, 5.0))
    if what == "two-steps":
        later = np.where(seconds >= natural * _between(drawn, "a", 2.0, 10.0), 1.0, 0.0)
        share = _between(drawn, "b", 0.3, 0.9) * _sign(drawn)
        return there + way * jump + share * (there + way * later)
    return there + way * jump


def _beside(drawn: Drawn, stage: int, seconds: Floats) -> Floats:
    """Load that comes beside the event [OP]."""
    what, natural, (there, way) = drawn.kind.loading, _natural(drawn), _there(stage)
    past = np.maximum(seconds, 0.0)
    size = drawn.push * _between(drawn, "b", 0.1, 0.5) * _sign(drawn)
    if what == "drift-with-setpoint":
        first = -20 * natural * drawn.extra["a"]
        return np.asarray(size * (there + way * np.clip((seconds - first) / (40 * natural), 0.0, 1.0)))
    if what == "sinusoidal-load":
        turns = (np.arange(len(seconds)) * drawn.rig.step + _past(drawn)) / (
            natural * _between(drawn, "a", 3, 30)
        )
        return np.asarray(size * np.sin(2 * math.pi * (turns + drawn.extra["d"])))
    if what == "coupled-loops":
        other = past / (natural * _between(drawn, "a", 1.0, 5.0))
        swing = np.exp(-other) * (np.cos(2 * other) + 0.5 * np.sin(2 * other))
        return np.asarray(2 * size * (there + way * (1 - swing)))
    if what == "wandering-load":
        return size * _wander(drawn, stage, len(seconds))
    if what in {"load-with-setpoint", "load-in-response"}:
        wait = natural * _between(drawn, "a", 1.0, 6.0) if what == "load-in-response" else 0.0
        return np.asarray(2 * size * (there + way * (seconds >= wait)))
    return np.zeros(len(seconds))


def shift(drawn: Drawn, stage: int, fine: int, onset: int) -> Floats:
    """Load that comes behind the plant [PV]."""
    if drawn.kind.loading != "load-at-output":
        return np.zeros(fine)
    past = np.maximum((np.arange(fine) - onset) * drawn.rig.step, 0.0)
    there, way = _there(stage)
    lag = _natural(drawn) * _between(drawn, "a", 0.1, 3.0)
    return np.asarray(drawn.size * (there + way * (1 - np.exp(-past / lag))))


def _there(stage: int) -> tuple[float, float]:
    """Where an event begins, and which way it goes."""
    return float(stage % 2), (-1.0) ** stage


def _natural(drawn: Drawn) -> float:
    """Time in which the loop could answer [s]."""
    return drawn.rig.plant.theta + drawn.rig.plant.lag + drawn.extra["wait"]


def _between(drawn: Drawn, name: str, low: float, high: float) -> float:
    return float(low * (high / low) ** drawn.extra[name])


def _sign(drawn: Drawn) -> float:
    return 1.0 if drawn.extra["c"] < 0.5 else -1.0


def _past(drawn: Drawn) -> float:
    """Seconds that the rig has run so far."""
    return float(drawn.rig.memory[0]) * drawn.rig.step


def _wander(drawn: Drawn, stage: int, fine: int) -> Floats:
    """Noise of unit variance that forgets within some natural times."""
    rng = np.random.default_rng([drawn.seed, stage, 2])
    keep = math.exp(-drawn.rig.step / (_natural(drawn) * _between(drawn, "a", 1.0, 20.0)))
    white = rng.standard_normal(fine) * math.sqrt(1 - keep**2)
    start = np.array([keep * rng.standard_normal()])
    return np.asarray(lfilter([1.0], [1.0, -keep], white, zi=start)[0])


def pure(drawn: Drawn, share: float) -> tuple[Floats, Floats, Floats]:
    """Run the first event without noise for a share of the longest record: set point, PV, OP."""
    fine = int(share * MOST_SAMPLES) * drawn.every
    rig = drawn.unused()
    sp, load, added = loading(drawn, 0, fine, 10 * drawn.every)
    pv, op = rig.run(asked(drawn, sp), load, shift(drawn, 0, fine, 10 * drawn.every), added)
    return sp, pv, op


def asked(drawn: Drawn, sp: Floats) -> Floats:
    """Set point as the block's law sees it: filtered, where the kind says so."""
    if drawn.kind.block != "sp-filter":
        return sp
    keep = math.exp(-drawn.rig.step / (drawn.rig.plant.theta * _between(drawn, "a", 0.5, 3.0)))
    return np.asarray(lfilter([1 - keep], [1.0, -keep], sp, zi=np.array([keep * sp[0]]))[0])


def event(drawn: Drawn, rig: Rig, stage: int) -> tuple[Floats, Floats, Floats]:
    """Let a rig live through an event until it is over and has lain still as long again: SP, PV, OP, fine."""
    rng = np.random.default_rng([drawn.seed, stage, 1])
    drawn.rig = rig
    quiet = int(rng.integers(100, 151)) * drawn.every
    onset = quiet - (int(rng.integers(0, drawn.every)) if drawn.event != SETPOINT else 0)
    most = MOST_SAMPLES * drawn.every
    sp, load, added = loading(drawn, stage, most, onset)
    heard, moved = asked(drawn, sp), shift(drawn, stage, most, onset)
    pv, _ = rig.copy().run(heard, load, moved, added)
    error = np.abs(sp - pv)[onset:]
    over = int(np.flatnonzero(error > 0.01 * error.max())[-1])
    last = min(onset + 2 * over + 150 * drawn.every, most)
    each = 1 if drawn.kind.recording == "unsynchronised" else min(drawn.every, rig.scan)
    noise = drawn.noise * np.repeat(rng.standard_normal(last // each + 1), each)[:last]
    pv, op = rig.run(heard[:last], load[:last], noise + moved[:last], added[:last])
    if onset + over >= last - drawn.every:
        _come_to_rest(drawn, rig, (heard[-1], load[-1], moved[-1], added[-1]), 0.01 * float(error.max()))
    return sp[:last], pv, op


def _come_to_rest(drawn: Drawn, rig: Rig, at: tuple[float, float, float, float], small: float) -> None:
    """Let a loop whose record was cut off live on unrecorded: nobody retunes it, or makes a step, while it moves."""
    for _ in range(20):
        sp, load, moved, added = (np.full(500 * drawn.every, x) for x in at)
        pv, _ = rig.run(sp, load, moved, added)
        if np.abs(sp - pv).max() < small:
            return


def record(drawn: Drawn, columns: tuple[Floats, Floats, Floats], first: int, stage: int) -> Samples:
    """Record an event as the kind's historian does; ``first`` counts the fine steps before."""
    rng = np.random.default_rng([drawn.seed, stage, 3])
    every, how, extra = drawn.every, drawn.kind.recording, drawn.extra
    sp, pv, op = columns
    start = first + (-first % every)
    if how == "averaged":
        n = len(sp) // every
        sp = sp[: n * every : every]
        pv, op = (x[: n * every].reshape(n, every).mean(axis=1) for x in (pv, op))
    else:  # unsynchronised: the historian looks some time after the block has run
        offset = 1 + int(extra["a"] * (every - 1)) if how == "unsynchronised" else -first % every
        sp, pv, op = (x[offset::every] for x in (sp, pv, op))
    time = START_S + (start + every * np.arange(len(sp))) * drawn.rig.step
    pv, op, time = _spoilt(drawn, rng, pv, op, time)
    stamp = np.round(time * 1e9).astype(np.int64)
    zeros, auto = np.zeros(len(sp), dtype=np.int32), np.ones(len(sp), dtype=bool)
    op = op + drawn.op0
    op = {"fraction": op / 100, "inverted": 100 - op}.get(how, op)
    samples = Samples.of(zeros, stamp, sp + drawn.pv0, pv + drawn.pv0, op, auto)
    if how == "exception-rows":
        return samples.take(_changed(sp, pv, op))
    return samples.take(rng.random(len(sp)) >= 0.05) if how == "lost" else samples


def _changed(*columns: Floats) -> NDArray[np.bool_]:
    """Return which rows a report by exception sends: where a value is another, and now and then without any change."""
    keep = np.ones(len(columns[0]), np.bool_)
    keep[1:] = np.any([np.diff(x) != 0.0 for x in columns], axis=0)
    last = 0
    for k in range(1, len(keep)):
        keep[k] |= k - last >= HEARTBEAT_ROWS
        last = k if keep[k] else last
    return keep


def _spoilt(
    drawn: Drawn, rng: np.random.Generator, pv: Floats, op: Floats, time: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the samples as the kind's historian stores them."""
    how, extra = drawn.kind.recording, drawn.extra
    late = 1 + int(6 * extra["a"])
    if how == "op-late":
        op = np.concatenate([np.full(late, op[0]), op[:-late]])
    elif how == "pv-late":
        pv = np.concatenate([np.full(late, pv[0]), pv[:-late]])
    elif how == "pv-filtered":
        keep = math.exp(-drawn.period / (drawn.rig.plant.theta * _between(drawn, "a", 0.3, 2.0)))
        pv = lfilter([1 - keep], [1.0, -keep], pv, zi=np.array([keep * pv[0]]))[0]
    elif how == "op-rounded":
        quantum = float(np.abs(op - op[0]).max()) * 0.005 * 10 ** extra["a"] or 1.0
        op = np.round(op / quantum) * quantum
    elif how in {"swinging-door", "exception", "exception-rows"}:
        pv, op = (_compressed(x, (0.004 * 5 ** extra["a"]) * float(np.ptp(x)), how) for x in (pv, op))
    elif how == "jitter":
        time = time + rng.uniform(-0.2, 0.2, len(time)) * drawn.period
    return pv, op, time


def _compressed(values: Floats, band: float, how: str) -> Floats:
    """Values after exception reporting (held), or after a swinging door (drawn straight between the kept)."""
    n = len(values)
    if how.startswith("exception"):
        out, kept = values.copy(), values[0]
        for k in range(n):
            if abs(values[k] - kept) > band:
                kept = values[k]
            out[k] = kept
        return out
    keep, start, low, high = [0], 0, -math.inf, math.inf
    for k in range(1, n):
        span = k - start
        low = max(low, (values[k] - band - values[start]) / span)
        high = min(high, (values[k] + band - values[start]) / span)
        if low > high:
            start = k - 1
            keep.append(start)
            low, high = values[k] - band - values[start], values[k] + band - values[start]
    keep.append(n - 1)
    return np.interp(np.arange(n), keep, values[keep])
