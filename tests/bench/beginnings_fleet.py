"""The records of the benchmark `beginnings`: loops not at rest when their data begin, and set points of every kind.

A record depends on its kind, its number and the seed alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from monitor.contract.samples import Samples
from sim_plants.loops import Simulation
from sim_plants.margins import settling_time
from sim_plants.specs import NEVER, LoopSpec, Steps
from tests.bench.retune_fleet import PID, SELF, draw_loop
from tests.bench.retune_truth import stable
from tests.support.plants import samples_of

LEAST_NOISE, MOST_NOISE = 1e-3, 3e-2
"""Standard deviation of PV's noise, of the size of the steps."""
MOST_SETTLING_SAMPLES = 3000
"""Loops that take longer are drawn again: a record is eight times as long."""
MANY_MOVES = 6


@dataclass(frozen=True)
class Record:
    """A record, and what happens in it."""

    spec: LoopSpec
    samples: Samples
    setpoints: list[int]
    """Times of its set-point steps, or begins of the ramps [ns since 1970]."""
    loads: list[int]
    """Of its load steps [ns since 1970]."""


def draw(kind: str, number: int, seed: int) -> Record:
    """Draw one record of a kind."""
    rng = np.random.default_rng([seed, number, *map(ord, kind)])
    while True:
        spec = draw_loop(rng, SELF if number % 3 == 0 else PID, f"{kind}-{number}", number)
        settle = settling_time(spec.plant, spec.controller, spec.true_period)
        if stable(spec, spec.controller) and settle < MOST_SETTLING_SAMPLES * spec.true_period:
            break
    spec = replace(spec, noise=_log(rng, LEAST_NOISE, MOST_NOISE), seed=int(rng.integers(2**62)))
    return KINDS[kind](spec, settle, rng)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def load_of(spec: LoopSpec, settle: float) -> float:
    """Return the load step after which PV deviates by one unit at most, without noise [OP]."""
    bare = replace(spec, setpoint=NEVER, load=Steps((0.0,), (1.0,)), noise=0.0)
    return 1.0 / float(np.abs(Simulation([bare]).advance(settle).pv - spec.pv0).max())


def _steps(sizes: dict[float, float]) -> Steps:
    at = sorted(sizes)
    return Steps(tuple(at), tuple(sizes[t] for t in at))


def _record(
    spec: LoopSpec, setpoint: dict[float, float], load: dict[float, float], span: float, cut: float
) -> Record:
    """Simulate ``span`` [s], and leave out what comes before ``cut`` [s]."""
    spec = replace(spec, setpoint=_steps(setpoint), load=_steps(load))
    simulation = Simulation([spec])
    samples = samples_of(simulation.advance(span))
    shown = samples.take(np.flatnonzero(samples.time >= simulation.start_ns + round(cut * 1e9)))
    times = [[simulation.start_ns + round(t * 1e9) for t in sorted(at) if t > cut] for at in (setpoint, load)]
    return Record(spec, shown, *times)


def _tail(spec: LoopSpec, settle: float, rng: np.random.Generator) -> Record:
    """A record that begins within a response; a set-point and a load step of one unit when it is over."""
    setpoint = {2.5 * settle: _sign(rng)}
    unit = load_of(spec, settle)
    load = {5.0 * settle: _sign(rng) * unit}
    big = _sign(rng) * _log(rng, 1.0, 20.0)
    if rng.random() < 0.5:
        setpoint[0.0] = big
    else:
        load[0.0] = big * unit
    return _record(
        spec, setpoint, load, 7.5 * settle, max(rng.uniform(0.0, 0.8) * settle, 3 * spec.true_period)
    )


def _moves(spec: LoopSpec, settle: float, rng: np.random.Generator) -> Record:
    """Set-point steps at any time after one another, after a far larger upset with which the data begin."""
    at = settle * np.cumsum(np.r_[rng.uniform(0.2, 0.8), rng.uniform(0.15, 2.0, MANY_MOVES - 1)])
    setpoint = {float(t): _sign(rng) * rng.uniform(0.3, 1.0) for t in at}
    load = {0.0: _sign(rng) * _log(rng, 1.0, 20.0) * load_of(spec, settle)}
    record = _record(spec, setpoint, load, float(at[-1]) + settle, 3 * spec.true_period)
    return replace(record, loads=[])


def _manual(spec: LoopSpec, settle: float, rng: np.random.Generator) -> Record:
    """Set-point steps some time after a switch from manual, in which PV had gone elsewhere."""
    back = 0.7 * settle
    moves = Steps((spec.true_period, back), (-1.0, 1.0))
    spec = replace(
        spec, modes=moves, output=Steps((2 * spec.true_period,), (_sign(rng) * load_of(spec, settle),))
    )
    at = back + settle * np.cumsum(np.r_[rng.uniform(0.1, 0.6), rng.uniform(0.3, 2.0, 2)])
    setpoint = {float(t): _sign(rng) * rng.uniform(0.5, 1.0) for t in at}
    return _record(spec, setpoint, {}, float(at[-1]) + settle, 0.0)


def _ramps(spec: LoopSpec, settle: float, rng: np.random.Generator) -> Record:
    """A ramp up and another one down, from rest."""
    takes = float(settle * _log(rng, 0.1, 1.0))
    lasts = takes + settle * rng.uniform(1.0, 2.0)
    spec = replace(spec, setpoint_rate=1.0 / takes)
    quiet = 130 * spec.true_period
    return _record(spec, {quiet: 1.0, quiet + lasts: -1.0}, {}, quiet + 2.0 * lasts, 0.0)


def _slave(spec: LoopSpec, settle: float, rng: np.random.Generator) -> Record:
    """A master moves the set point all the time, with a memory of some of the loop's own times."""
    memory = spec.plant.half_rule()[0] * _log(rng, 3.0, 30.0)
    spec = replace(spec, master=1.0, master_time=memory, master_scan=spec.true_period)
    return _record(spec, {}, {}, max(2500 * spec.true_period, settle), 0.0)


KINDS: dict[str, Callable[[LoopSpec, float, np.random.Generator], Record]] = {
    "tail": _tail,
    "moves": _moves,
    "manual": _manual,
    "ramps": _ramps,
    "slave": _slave,
}
