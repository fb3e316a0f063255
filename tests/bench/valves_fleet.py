"""Loops with and without a valve that sticks or has play, whose truth is known: PI loops at scans of 1 s.

One draw is one loop, of 4 blocks of 1024 samples, taken every 1, 5 or 10 s. All draws of sizes are logarithmic.
Process gains are 1 PV/OP, or 1 PV/OP within a closed loop's time where the process integrates. A third of the loops is
far too slow. What the valve's element does to PV is counted in standard deviations of its noise: `effect` = gain *
band / noise.

Loops without an element (what they have beside noise): *healthy* (wandering load, in two of three steps of set point
and load), *brink* (gain near the limit of stability), *integral* (integral time 3 to 8 times too short), *sine*,
*square*, *triangle* (load of that shape), *drift* (ramps of load), *walk* (a large wandering load), *setpoint*
(steps), *quantised* (PV, or OP, in coarse steps). With one: *play* (backlash), *slip* (play from which the valve
jumps), *stick* (jumps the whole way).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.bench.health_fleet import log_uniform

Array = NDArray[np.float64]
SOUND = (
    "healthy",
    "brink",
    "integral",
    "sine",
    "square",
    "triangle",
    "drift",
    "walk",
    "setpoint",
    "quantised",
)
STICKING = ("play", "slip", "stick")
KINDS = (*SOUND, *STICKING)
PROCESSES = ("flow", "level")
"""Fast and self-regulating; integrating."""
BLOCK, BLOCKS = 1024, 4
EVERY = (1, 5, 10)
"""Scans in a sample."""
SLUGGISH_SHARE = 0.35
"""Of the loops, whose gain is far too low, as that of many in a plant: OP takes long to pass a band."""
SETTLING = 600
"""Samples before the first that is looked at."""


@dataclass(frozen=True)
class Case:
    """A loop, its samples, and the truth."""

    kind: str
    process: str
    every: int
    band: float
    """[OP]; 0 where no element is."""
    effect: float
    """What the band does to PV, in standard deviations of its noise."""
    sp: Array
    pv: Array
    op: Array
    valve: Array
    """Where the valve is [OP]."""
    turns: int
    """How often the valve turned; 0 without an element."""


@dataclass
class _Loop:
    integrating: bool
    gain: float
    lag: float
    delay: int
    kp: float
    ti: float
    time: float


@numba.njit(cache=True)
def simulate(plant, pi, valve, signals, every):
    """Run a PI loop; return SP, PV, OP and the valve.

    Plant: integrating, gain, lag, delay; law: kp, ti, steps of OP; valve: kind, band, jump; signals: SP, load, noise.
    """
    integrating, gain, lag, delay = plant[0] > 0.5, plant[1], plant[2], int(plant[3])
    kp, ki, op_quantum = pi[0], pi[0] / pi[1], pi[2]
    kind, band, jump = int(valve[0]), valve[1], valve[2]
    sp, load, noise = signals[0], signals[1], signals[2]
    n = len(sp)
    out = np.empty((4, n // every))
    ring = np.zeros(delay + 1)
    op = pv = slow = v = 0.0
    last = sp[0]
    decay = np.exp(-1.0 / lag) if lag > 0 else 0.0
    pulled = 0.0
    for t in range(n):
        measured = pv + noise[t]
        e = sp[t] - measured
        op += kp * (e - last) + ki * e
        op = min(max(op, -50.0), 50.0)
        last = e
        shown = np.round(op / op_quantum) * op_quantum if op_quantum > 0 else op
        if kind == 0:
            v = shown
        elif kind == 1:
            v = min(max(v, shown - band / 2), shown + band / 2)
        elif kind == 2:  # rests until OP has passed the band, jumps, follows until OP turns
            d = shown - v
            way = 1.0 if d > 0 else -1.0
            if pulled * d > 0 and abs(d) >= (band - jump) / 2:
                v = shown - way * (band - jump) / 2
            elif abs(d) >= (band + jump) / 2:
                v = shown - way * (band - jump) / 2
                pulled = way
            else:
                pulled = 0.0
        elif abs(shown - v) > band:
            v = shown
        ring[t % (delay + 1)] = v + load[t]
        x = ring[(t + 1) % (delay + 1)]
        slow = decay * slow + (1 - decay) * x
        if integrating:
            pv += gain * slow
        else:
            pv = gain * slow
        if t % every == 0 and t // every < out.shape[1]:
            out[0, t // every] = sp[t]
            out[1, t // every] = measured
            out[2, t // every] = shown
            out[3, t // every] = v
    return out


def draw(kind: str, process: str, number: int, seed: int) -> Case:
    """Draw one loop; the same arguments give the same loop."""
    rng = np.random.default_rng([seed, number, KINDS.index(kind), PROCESSES.index(process)])
    while True:
        case = _try(rng, kind, process)
        if case is not None:
            return case


def _plant(rng: np.random.Generator, process: str, every: int) -> _Loop:
    integrating = process == "level"
    if integrating:
        delay, lag = round(log_uniform(rng, 1, 4) * every), log_uniform(rng, 0.5, 5.0) * every
        t0 = delay + lag
        time = t0 * log_uniform(rng, 1.5, 6.0)
        return _Loop(True, 1.0 / time, lag, delay, time / (time + t0) * 1.0, 4.0 * (time + t0), time)
    delay, lag = (
        round(log_uniform(rng, 1, 3) * every ** rng.uniform(0, 1)),
        log_uniform(rng, 1.0, 10.0) * every ** rng.uniform(0, 1),
    )
    time = max(delay, 1) * log_uniform(rng, 1.0, 5.0)
    return _Loop(False, 1.0, lag, delay, lag / (time + delay), max(min(lag, 4.0 * (time + delay)), 1.0), time)


def _spoilt(rng: np.random.Generator, loop: _Loop, kind: str) -> None:
    """Tune the loop to the brink, or make its integral too strong."""
    w = np.geomspace(1e-4, 3.0, 4000)
    plant = (
        loop.gain
        / (1j * w) ** loop.integrating
        / (1 + 1j * w * loop.lag)
        * np.exp(-1j * w * (loop.delay + 0.5))
    )
    if kind == "integral":
        loop.ti /= log_uniform(rng, 3.0, 8.0)
    for _ in range(40):
        ms = _peak(plant * loop.kp * (1 + 1 / (1j * w * loop.ti)))
        if kind == "brink":
            if ms > 6.0:
                break
            loop.kp *= 1.1
        elif ms > 4.0:
            loop.kp *= 1.15 if loop.integrating else 0.87
        else:
            break
    if kind == "brink" and ms > 15.0:
        loop.kp /= 1.1


def _peak(open_loop: NDArray[np.complex128]) -> float:
    return float(np.max(1 / np.abs(1 + open_loop)))


def _moves(rng: np.random.Generator, n: int, count: int, size: float) -> Array:
    """Steps to new places at irregular times."""
    out = np.zeros(n)
    for at in np.sort(rng.integers(0, n, count)):
        out[at:] = size * rng.uniform(-1, 1)
    return out


def _wander(rng: np.random.Generator, n: int, time: float) -> Array:
    """Load that walks and comes back within a time, of standard deviation 1."""
    a = np.exp(-1 / time)
    return np.asarray(lfilter([np.sqrt(1 - a * a)], [1, -a], rng.normal(size=n)))


def _wave(rng: np.random.Generator, n: int, kind: str, period: float) -> Array:
    """A load of a neighbour's making; its period may vary from cycle to cycle."""
    spread = rng.choice([0.0, 0.05, 0.2])
    lengths = period * np.exp(spread * rng.normal(size=int(2 * n / period) + 10))
    phase = (
        np.interp(np.arange(n), np.concatenate([[0], np.cumsum(lengths)]), np.arange(len(lengths) + 1)) % 1.0
    )
    if kind == "sine":
        return np.sin(2 * np.pi * phase)
    if kind == "square":
        return np.where(phase < 0.5, 1.0, -1.0)
    return 2 * np.abs(2 * phase - 1) - 1


def _upset(rng: np.random.Generator, n: int, kind: str, time: float) -> Array:
    """A load of the kind's own."""
    if kind in {"sine", "square", "triangle"}:
        return log_uniform(rng, 2.0, 30.0) * _wave(rng, n, kind, log_uniform(rng, 4.0, 100.0) * time)
    if kind == "drift":
        turns = np.sort(rng.integers(0, n, int(rng.integers(2, 30))))
        return log_uniform(rng, 3.0, 50.0) * np.interp(np.arange(n), turns, rng.uniform(-1, 1, len(turns)))
    if kind == "walk":
        return log_uniform(rng, 3.0, 50.0) * _wander(rng, n, n / log_uniform(rng, 1.0, 20.0))
    return np.zeros(n)


def _try(rng: np.random.Generator, kind: str, process: str) -> Case | None:
    every = int(rng.choice(EVERY))
    n = (BLOCK * BLOCKS + SETTLING) * every
    loop = _plant(rng, process, every)
    if kind in {"brink", "integral"}:
        _spoilt(rng, loop, kind)
    elif rng.random() < SLUGGISH_SHARE:
        slower = log_uniform(rng, 1.5, 10.0)
        loop.kp /= slower
        loop.ti *= slower if loop.integrating else log_uniform(rng, 1.0, 3.0)
    band = log_uniform(rng, 0.5, 5.0) if kind in STICKING else 0.0
    effect = log_uniform(rng, 1.0, 30.0) if kind in STICKING else 0.0
    noise = band / effect if band else log_uniform(rng, 0.05, 1.0)
    unit = band or noise
    slow = max(loop.time, loop.ti, every)
    wide = log_uniform(rng, 0.02, 0.3) if band and rng.random() < 0.4 else log_uniform(rng, 0.1, 3.0)
    load = unit * wide * _wander(rng, n, slow * log_uniform(rng, 2.0, 100.0))
    sp = np.zeros(n)
    if rng.random() < {"setpoint": 1.0, "healthy": 0.67}.get(kind, 0.3):
        sp += _moves(rng, n, int(rng.integers(2, 20)), unit * log_uniform(rng, 3.0, 40.0))
    if rng.random() < (0.0 if band and wide < 0.1 else {"healthy": 0.5}.get(kind, 0.2)):
        load += _moves(rng, n, int(rng.integers(2, 20)), unit * log_uniform(rng, 3.0, 30.0))
    load += unit * _upset(rng, n, kind, max(loop.time, every))
    measured = rng.normal(size=n)
    if rng.random() < 0.3:
        measured = _wander(rng, n, every * log_uniform(rng, 1.0, 5.0))
    op_quantum = 0.0
    if kind == "quantised" and rng.random() < 0.5:
        op_quantum = noise * loop.kp * log_uniform(rng, 0.5, 5.0)
    jump = band * rng.uniform(0.2, 0.9) if kind == "slip" else 0.0
    which = STICKING.index(kind) + 1 if band else 0
    plant = np.array([float(loop.integrating), loop.gain, loop.lag, float(loop.delay)])
    out = simulate(
        plant,
        np.array([loop.kp, loop.ti, op_quantum]),
        np.array([which, band, jump]),
        np.stack([sp, load, noise * measured]),
        every,
    )
    sp, pv, op, v = out[:, SETTLING:]
    ways = np.diff(v)
    ways = np.sign(ways[ways != 0])
    if np.ptp(op) > 95.0 or not np.all(np.isfinite(pv)):
        return None
    if kind == "quantised":
        quantum = noise * log_uniform(rng, 0.5, 5.0)
        pv = np.round(pv / quantum) * quantum
    gain = float(rng.choice([-1.0, 1.0])) * log_uniform(rng, 0.05, 20.0)
    # a valve that opens where the controller closes is as usual
    return Case(
        kind,
        process,
        every,
        band,
        effect,
        50.0 + abs(gain) * sp,
        50.0 + abs(gain) * pv,
        50.0 + np.sign(gain) * op,
        50.0 + np.sign(gain) * v,
        int(np.sum(ways[1:] != ways[:-1])) if band else 0,
    )
