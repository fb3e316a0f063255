"""Loops to the records and the pool of the compiled step."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from sim_plants import kernel
from sim_plants.controllers import AntiWindup
from sim_plants.plants import GRID_TOLERANCE, Discrete, delay_of, discretise, hold
from sim_plants.specs import LoopSpec, Steps

Floats = NDArray[np.float64]

_WINDUP = dict(
    zip(get_args(AntiWindup), (kernel.CONDITIONAL, kernel.TRACKING, kernel.NO_ANTI_WINDUP), strict=True)
)


@dataclass(frozen=True, eq=False)
class Arrays:
    """What the compiled step works on and changes."""

    loops: kernel.Records
    """(L,) of `kernel.LOOP`."""
    plan: kernel.Records
    """Steps of all loops and channels, of `kernel.STEP`."""
    pool: kernel.Pool
    """States, matrices and delay lines."""


class _Pool:
    """A growing flat array that tells where each part begins."""

    def __init__(self) -> None:
        self.parts: list[Floats] = []
        self.size = 0

    def add(self, values: Floats) -> int:
        self.parts.append(values.ravel())
        self.size += values.size
        return self.size - values.size


def to_arrays(loops: Sequence[LoopSpec]) -> Arrays:
    """Make the arrays of loops at rest before their first sample."""
    pool, plan = _Pool(), list[tuple[int, float, int]]()
    rows = np.zeros(len(loops), kernel.LOOP)
    for row, loop in zip(rows, loops, strict=True):
        step = discretise(loop.plant, loop.true_period)
        facts = _settings(loop) | _start(loop) | _places(loop, step, pool)
        for name, value in facts.items():
            row[name] = value
        for channel in range(kernel.CHANNELS):
            schedule = (loop.setpoint, loop.load, loop.modes, loop.output)[channel]
            row["step_first"][channel] = row["step_next"][channel] = len(plan)
            row["step_repeat"][channel] = round(schedule.repeat / loop.true_period)
            plan += _loads(loop, step, pool) if channel == kernel.LOAD else _moves(loop, schedule)
            row["step_end"][channel] = len(plan)
    return Arrays(rows, np.array(plan, kernel.STEP), np.concatenate(pool.parts))


def _settings(loop: LoopSpec) -> dict[str, float]:
    """Return the numbers that stay, under their names in `kernel.LOOP`."""
    pid, period = loop.controller, loop.true_period
    return {
        "period_ns": loop.period_ns,
        "period": period,
        "pv0": loop.pv0,
        "op0": loop.op0,
        "kp": pid.kp,
        "ki": pid.kp / pid.ti,
        "kd": pid.kp * pid.lead,
        "lead": pid.lead if pid.form == "series" else 0.0,
        "tf": pid.filter_time,
        "b": pid.b,
        "c": pid.c,
        "op_low": pid.op_low,
        "op_high": pid.op_high,
        "windup": _WINDUP[pid.anti_windup],
        "track": period / (period + pid.tracking_time),
        "noise": loop.noise,
        "quantum": loop.quantum,
        "colour": _stays(loop.noise_time, period),
        "wander": loop.wander * math.sqrt(period),
        "wander_back": _stays(loop.wander_time, period),
        "ramp": loop.setpoint_rate * period,
        "master": loop.master,
        "master_stays": _stays(loop.master_time, max(loop.master_scan, period)),
        "master_scan": max(round(loop.master_scan / period), 1),
        "stiction": loop.stiction,
    }


def _stays(time: float, period: float) -> float:
    """Share of a first-order random signal that is left after a period; none at a time of 0, all at inf."""
    return math.exp(-period / time) if time > 0 else 0.0


def _start(loop: LoopSpec) -> dict[str, float]:
    """Return the state at rest; what is not named here begins at 0."""
    pid = loop.controller
    return {
        "target": loop.pv0,
        "moving": loop.pv0,
        "sp": loop.pv0,
        "op": loop.op0,
        "valve": loop.op0,
        "auto": loop.auto,
        "integral": loop.op0 - pid.kp * (pid.b - 1) * loop.pv0,
        "slope_in": (pid.c - 1) * loop.pv0,
        "random": np.random.SeedSequence(loop.seed).generate_state(1, np.uint64)[0],
    }


def _places(loop: LoopSpec, step: Discrete, pool: _Pool) -> dict[str, int]:
    """Put a plant into the pool and return where its parts are."""
    return {
        "order": loop.plant.order,
        "x": pool.add(np.zeros(loop.plant.order)),
        "phi": pool.add(step.phi),
        "older": pool.add(step.older),
        "newer": pool.add(step.newer),
        "ring": pool.add(np.zeros(step.delay + 1)),
        "ring_size": step.delay + 1,
    }


def _moves(loop: LoopSpec, schedule: Steps) -> list[tuple[int, float, int]]:
    """Return the steps that act at samples, as rows of `kernel.STEP`."""
    return [
        (loop.sample_at(time), size, 0) for time, size in zip(schedule.times, schedule.sizes, strict=True)
    ]


def _loads(loop: LoopSpec, step: Discrete, pool: _Pool) -> list[tuple[int, float, int]]:
    """Return the load steps, each within the period in which it reaches the plant, as `kernel.STEP`."""
    rows = []
    for time, size in zip(loop.load.times, loop.load.sizes, strict=True):
        sample, rest = delay_of(time + loop.plant.dead_time, loop.true_period)
        left = loop.true_period - rest
        whole = rest <= GRID_TOLERANCE * loop.true_period
        kick = step.older + step.newer if whole else hold(loop.plant, left)[1]
        rows.append((sample, size, pool.add(kick)))
    return rows
