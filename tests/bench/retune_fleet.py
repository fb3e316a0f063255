"""The loops of the benchmark `retune`: plants, detuned settings, one event each, and how their data are spoilt.

A loop depends on its fleet, its number and the seed alone: the cases of a fleet (set point and load, more and
less noise) show the same loops, and the first loops of a longer run are those of a shorter one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from sim_plants.controllers import Controller
from sim_plants.loops import Block, Simulation
from sim_plants.plants import Plant
from sim_plants.specs import NEVER, LoopSpec, Steps
from sim_plants.truth import loop_table

SETPOINT, LOAD = "setpoint", "load"
PID, PI, SELF = "integrating, pid", "integrating, pi", "self-regulating, pi"
MOST_SAMPLES = 3000
"""Samples of a record: what is slower is cut off by the end of the data."""
LOST, REPEATED, NOT_A_NUMBER = 0.02, 0.02, 0.01
"""Shares of bad data's rows."""
STEPS_OF_RESPONSE = 500.0
"""Largest deviation of bad data's PV over its resolution."""


@dataclass(frozen=True)
class Case:
    """What one row of the table is about."""

    name: str
    fleet: str
    kind: str
    noise: float
    """Standard deviation as a share of PV's largest deviation."""
    cured: float | None
    """Goal: share of the loops in need that the first suggestion cures; None for information only."""
    bad_data: bool = False
    process_given: bool = True
    settings_given: bool = True


def _both(name: str, fleet: str, noise: float, cured: float | None, **more: bool) -> list[Case]:
    return [
        Case(f"{name}-{short}", fleet, kind, noise, cured, **more)
        for short, kind in (("sp", SETPOINT), ("ld", LOAD))
    ]


CASES = {
    case.name: case
    for case in (
        *_both("clean", PID, 0.0, 0.5),
        *_both("noise1", PID, 0.01, 0.5),
        *_both("noise3", PID, 0.03, 0.5),
        *_both("bad", PID, 0.01, 0.5, bad_data=True),
        *_both("auto", PID, 0.01, 0.5, process_given=False),
        *_both("pi", PI, 0.01, 0.5),
        *_both("unknown", PID, 0.01, 0.5, settings_given=False),
        *_both("self", SELF, 0.01, 0.5),
        *_both("self-auto", SELF, 0.01, None, process_given=False),
    )
}


def draw(case: Case, number: int, seed: int, stable: Any) -> LoopSpec:
    """Draw one loop of a case with its event, noise included.

    Parameters
    ----------
    stable
        Function of spec and controller: whether the true loop is stable; what is not is drawn again.
    """
    word = [ord(letter) for letter in case.fleet]
    rng = np.random.default_rng([seed, number, *word])
    while True:
        spec = draw_loop(rng, case.fleet, f"{case.name}-{number}", number)
        if stable(spec, spec.controller):
            break
    first = int(rng.integers(100, 151)) * spec.true_period
    size, push = _log(rng, 0.1, 100.0) * rng.choice([-1, 1]), _log(rng, 1.0, 20.0) * rng.choice([-1, 1])
    first_load = first - rng.uniform(0.0, 1.0) * spec.true_period  # a load comes between samples
    if case.kind == SETPOINT:
        spec = replace(spec, setpoint=Steps((first,), (float(size),)))
    else:
        spec = replace(spec, load=Steps((float(first_load),), (float(push),)))
    peak = float(np.abs(_run(spec, MOST_SAMPLES).pv - spec.pv0).max())
    quantum = peak / STEPS_OF_RESPONSE if case.bad_data else 0.0
    return replace(spec, noise=case.noise * peak, quantum=quantum, seed=int(rng.integers(2**62)))


def record(spec: LoopSpec, bad_data: bool) -> Samples:
    """Samples until the response, noise apart, is over and has lain still as long again; at most 3000."""
    pure = _run(replace(spec, noise=0.0, quantum=0.0), MOST_SAMPLES)
    error = np.abs(pure.sp - pure.pv)
    first = spec.sample_at((spec.setpoint.times or spec.load.times)[0])
    over = int(np.flatnonzero(error > 0.01 * error.max())[-1])
    last = min(first + 2 * (over - first) + 150, MOST_SAMPLES)
    block = _run(spec, last)
    if not bad_data:
        return _samples(block)
    rng = np.random.default_rng([spec.seed, 1])
    kept = np.flatnonzero(rng.random(len(block)) >= LOST)
    rows = np.sort(np.concatenate([kept, rng.choice(kept, round(REPEATED * len(kept)))]))
    block = block.rows(rows)
    where = np.flatnonzero(rng.random(len(block)) < NOT_A_NUMBER)
    for column, row in zip(rng.integers(0, 3, len(where)), where, strict=True):
        (block.pv, block.op, block.sp)[column][row] = np.nan
    return _samples(block)


def table_row(spec: LoopSpec, case: Case) -> Loop:
    """Return the loop as its table describes it: no ranges, period measured, settings and kind where given."""
    row = loop_table([spec])[0] | {"period": None}
    row["controller"] = "pi" if case.fleet in {PI, SELF} else "pid"
    if not case.process_given:
        row["process"] = "auto"
    if not case.settings_given:
        row |= dict.fromkeys(("kp", "ki", "kd", "ti", "td", "tf"))
        # the form stays: a suggestion has to be typed in somewhere
    loop, wrong = parse_row(row)
    if loop is None:
        raise ValueError(f"{spec.name}: {wrong}")
    return loop


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _three(value: float) -> float:
    """Three digits, as on a faceplate."""
    return float(f"{value:.3g}")


def draw_loop(rng: np.random.Generator, fleet: str, name: str, number: int) -> LoopSpec:
    """Draw a plant of a fleet and detuned settings; nothing happens to it."""
    dead_time = _log(rng, 1.0, 100.0)
    period = round(dead_time / _log(rng, 3.0, 20.0), 3)
    gain = _log(rng, 1e-4, 1.0) * rng.choice([-1, 1])
    if fleet == SELF:
        first = dead_time * _log(rng, 1.0, 30.0)
        lags = (first, *[x for x in (first * rng.uniform(0.0, 0.3),) if x > 0.01 * first])
        plant = Plant("self-regulating", 1e2 * gain, dead_time, lags)
    else:
        lags = tuple(dead_time * _log(rng, 0.1, 6.3) for _ in range(rng.integers(0, 4)))
        plant = Plant("integrating", gain, dead_time, lags)
    return LoopSpec(
        name=name,
        plant=plant,
        controller=_settings(rng, fleet, plant),
        pv0=float(rng.uniform(-100.0, 100.0)),
        op0=float(rng.uniform(20.0, 80.0)),
        period=period,
        setpoint=NEVER,
        load=NEVER,
        seed=number,
    )


def _settings(rng: np.random.Generator, fleet: str, plant: Plant) -> Controller:
    """SIMC with tc = theta of the half-rule model, detuned in gain and reset; td none, half or right."""
    theta, lag = plant.half_rule()
    td = 0.0
    if fleet == SELF:
        kp, ti = lag / (plant.gain * 2 * theta), min(lag, 8 * theta)
    else:
        if fleet == PI:
            theta = plant.t0 - max(plant.lags, default=0.0) / 2
        kp, ti = 1 / (plant.gain * 2 * theta), 8 * theta
    kp, ti = kp * _log(rng, 0.13, 2.2), ti * _log(rng, 0.4, 5.0)
    share, form = float(rng.choice([0.0, 0.5, 1.0])), str(rng.choice(["series", "standard", "parallel"]))
    if fleet == PID:
        td = share * lag
    if td and form != "series":  # the rule is for the series form
        factor = 1 + td / ti
        kp, ti, td = kp * factor, ti * factor, td / factor
    return Controller(_three(kp), _three(ti), _three(td), form=form)  # type: ignore[arg-type]


def _run(spec: LoopSpec, samples: int) -> Block:
    return Simulation([spec]).advance((samples - 0.5) * spec.true_period)


def _samples(block: Block) -> Samples:
    return Samples.of(block.loop, block.time_ns, block.sp, block.pv, block.op, block.auto)
