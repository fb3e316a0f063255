"""The fleets of the benchmark `detection`: loops to which nothing, something slow, or something known happens.

Each kind draws loops from a seed. What they have in common, and what is drawn for each loop, is said in the
benchmark's docstring.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sim_plants.controllers import Controller
from sim_plants.fleet import random_fleet
from sim_plants.loops import Simulation
from sim_plants.margins import settling_time
from sim_plants.plants import Plant
from sim_plants.specs import NEVER, LoopSpec, Steps

LEAST, MOST = 5.0, 50.0
"""Size of a known event in standard deviations of PV's noise."""
EVENTS = 6
"""Known events of a loop."""
HEALTHY = {"good": 1.0}
_LEVEL = Plant("integrating", 0.02, 4.0)


@dataclass(frozen=True)
class Kind:
    """What one row of the table is about."""

    draw: Callable[[LoopSpec, np.random.Generator], LoopSpec]
    most_loads: float
    """False load events that are allowed in a loop-week; `inf` where the events are known."""
    mix: dict[str, float] | None
    """Shares of the tunings; None for those of a plant."""
    events: str = ""
    """Known events: `setpoint` or `load`."""


def fleet(kind: Kind, n: int, seed: int) -> list[LoopSpec]:
    """Draw loops of a kind, sampled at 1 Hz."""
    mix = {} if kind.mix is None else {"mix": kind.mix}
    streams = np.random.SeedSequence([seed, 1]).spawn(n)
    specs = random_fleet(n, seed, period=1.0, **mix)
    return [
        kind.draw(replace(s, setpoint=NEVER, load=NEVER, noise=0.0), np.random.default_rng(stream))
        if not kind.events
        else kind.draw(s, np.random.default_rng(stream))
        for s, stream in zip(specs, streams, strict=True)
    ]


def lasts(spec: LoopSpec) -> float:
    """How long to watch a loop of known events [s]."""
    times = (*spec.setpoint.times, *spec.load.times)
    return times[-1] + 1.5 * (times[-1] - times[0]) / (len(times) - 1)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _span(spec: LoopSpec) -> float:
    return spec.pv_high - spec.pv_low


def _white(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    return replace(spec, noise=_span(spec) * _log(rng, 1e-4, 1e-2))


def _coloured(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    return replace(_white(spec, rng), noise_time=_log(rng, 2.0, 200.0))


def _quantised(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    quantum = _span(spec) / 2.0 ** int(rng.integers(8, 13))
    return replace(
        spec, quantum=quantum, noise=quantum * _log(rng, 0.05, 2.0), wander=0.002, wander_time=3600.0
    )


def _cycling(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    """A valve that sticks: the loop hunts for ever."""
    settings = Controller(
        1.0 / (2.0 * _LEVEL.gain * _LEVEL.dead_time), 16.0 * _LEVEL.dead_time, op_low=0.0, op_high=100.0
    )
    stiction = _log(rng, 0.3, 3.0)
    return replace(
        spec,
        plant=_LEVEL,
        controller=settings,
        stiction=stiction,
        noise=stiction * _log(rng, 0.003, 0.1),
        wander=0.01,
        wander_time=3600.0,
        pv0=50.0,
        op0=50.0,
        pv_low=0.0,
        pv_high=100.0,
    )


def _wander(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    """Up to 5 % of OP within a walk's memory of ten minutes to a day."""
    time = _log(rng, 600.0, 86400.0)
    wander = _log(rng, 0.2, 5.0) / math.sqrt(time / 2)
    return replace(_white(spec, rng), wander=wander, wander_time=time)


def _coarse(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    """The same, seen by a coarse transmitter."""
    spec = _wander(spec, rng)
    return replace(spec, quantum=spec.noise * _log(rng, 0.5, 10.0))


def _ramps(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    move, takes, rests = (
        _span(spec) * _log(rng, 0.005, 0.05),
        _log(rng, 120.0, 3600.0),
        _log(rng, 300.0, 7200.0),
    )
    half = float(math.ceil(takes + rests))
    moves = Steps((1000.0, 1000.0 + half), (move, -move), 2 * half)
    return replace(_white(spec, rng), setpoint=moves, setpoint_rate=move / takes)


def _cascade(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    return replace(
        _white(spec, rng),
        master=_span(spec) * _log(rng, 0.001, 0.03),
        master_time=_log(rng, 30.0, 1000.0),
        master_scan=float(rng.choice([1, 1, 2, 5, 10, 30])),
    )


def _setpoint(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    times = _times(spec, rng)
    step = 0.03 * _span(spec)
    if spec.setpoint.sizes:
        step = max(abs(size) for size in spec.setpoint.sizes)
    sizes = step * rng.uniform(0.5, 1.0, len(times)) * np.where(np.arange(len(times)) % 2, -1, 1)
    moves = Steps(tuple(float(round(t)) for t in times), tuple(float(s) for s in sizes))
    return replace(spec, setpoint=moves, load=NEVER, noise=0.5 * step / _log(rng, LEAST, MOST))


def _load(spec: LoopSpec, rng: np.random.Generator) -> LoopSpec:
    times = _times(spec, rng)
    size = max((abs(size) for size in spec.load.sizes), default=5.0)
    sizes = size * rng.uniform(0.7, 1.0, len(times)) * np.where(np.arange(len(times)) % 2, -1, 1)
    moves = Steps(tuple(float(np.round(t, 3)) for t in times), tuple(float(s) for s in sizes))
    bare = replace(spec, setpoint=NEVER, load=moves, noise=0.0)
    peak = smallest_peak(bare)
    return replace(bare, noise=peak / _log(rng, LEAST, MOST))


def smallest_peak(spec: LoopSpec) -> float:
    """Least over its load steps of the largest deviation of PV that each causes, without noise [PV]."""
    block = Simulation([spec]).advance(lasts(spec))
    t, away = block.time - block.time[0], np.abs(block.pv - block.sp)
    bounds = [*spec.load.times, math.inf]
    return min(float(away[(t >= a) & (t < b)].max()) for a, b in pairwise(bounds))


def _times(spec: LoopSpec, rng: np.random.Generator) -> np.ndarray:
    """The first one after a quiet stretch, each next one when the loop has had time to settle [s]."""
    settle = max(settling_time(spec.plant, spec.controller, spec.true_period), 100.0)
    first = max(400.0, 4 * spec.plant.t0) * rng.uniform(1.0, 2.0)
    return first + np.concatenate([[0.0], np.cumsum(settle * rng.uniform(1.5, 4.0, EVENTS - 1))])


KINDS = {
    "white": Kind(_white, 0.02, HEALTHY),
    "coloured": Kind(_coloured, 0.02, HEALTHY),
    "quantised": Kind(_quantised, 0.02, HEALTHY),
    "cycling": Kind(_cycling, 0.1, HEALTHY),
    "wander": Kind(_wander, 0.1, HEALTHY),
    "coarse": Kind(_coarse, 0.1, HEALTHY),
    "ramps": Kind(_ramps, 0.1, HEALTHY),
    "cascade": Kind(_cascade, 0.1, HEALTHY),
    "setpoint": Kind(_setpoint, math.inf, None, "setpoint"),
    "load": Kind(_load, math.inf, None, "load"),
}
