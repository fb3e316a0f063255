"""Simulator of the benchmark `plant_life`: the loop of `mismatch_sim`, with what a plant does to it in a week.

Plant, block and valve are those of `mismatch_sim`. Added here: manual and automatic, a transmitter that freezes, a
valve that no longer moves, a gain that changes with time, a drive's least speed, and an output recorded as the relay
that it switches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit
from tests.bench.mismatch_plant import Floats, Law, Plant, held
from tests.bench.mismatch_sim import LAWS, VALVES, Valve, _law, _step, _valve

Bools = NDArray[np.bool_]
STEP_S = 1.0
"""One step of the simulation and one execution of the controller [s]."""


@dataclass(frozen=True)
class Body:
    """What a loop is made of; OP and PV are deviations from where it rests at first."""

    plant: Plant
    law: Law
    op_low: float
    op_high: float
    """Limits of OP."""
    valve: Valve = field(default_factory=Valve)
    floor: float = -math.inf
    """OP below which the drive runs no slower."""
    pulses: int = 0
    """Length of a cycle of pulse-width modulation [steps]; OP is then 0 or 100 % itself. 0 for an OP that is sent."""
    tracks: bool = False
    """Whether the set point goes with PV in manual."""
    pv_quantum: float = 0.0


@dataclass
class Inputs:
    """What happens to a loop, one value a step."""

    sp: Floats
    """[PV]"""
    load: Floats
    """At the process input [OP]."""
    noise: Floats
    """On PV as measured [PV]."""
    beyond: Floats
    """Load behind the process [PV]."""
    factor: Floats
    """On what the valve lets through."""
    added: Floats
    """By a feed-forward, to OP [OP]."""
    auto: Bools
    moved: Floats
    """By how much the operator moves OP in manual [OP]."""
    frozen: Bools
    """Whether the transmitter shows its last value."""
    shut: Bools
    """Whether the valve stays where it is."""

    @classmethod
    def quiet(cls, n: int) -> Inputs:
        """Nothing happens for ``n`` steps."""
        return cls(
            *(np.zeros(n) for _ in range(4)), np.ones(n), np.zeros(n), np.ones(n, np.bool_), np.zeros(n),
            np.zeros(n, np.bool_), np.zeros(n, np.bool_),
        )  # fmt: skip


@dataclass(frozen=True)
class Lived:
    """What came of it, one value a step, as deviations."""

    sp: Floats
    pv: Floats
    """As measured."""
    op: Floats
    true: Floats
    """PV without noise."""
    stem: Floats
    """What the valve lets through [OP]."""


def live(body: Body, what: Inputs) -> Lived:
    """Let a loop at rest live through what happens."""
    law, plant = body.law, body.plant
    settings = np.array(
        [
            law.kp, law.ti, law.lead, law.tf, law.b, law.c, law.filter, float(law.form == "series"),
            LAWS.index(law.kind), law.width, law.inside, body.op_low, body.op_high,
            0.0, body.pv_quantum, VALVES.index(body.valve.kind), body.valve.first, body.valve.second,
        ]
    )  # fmt: skip
    free = settings.copy()
    free[11], free[12] = -math.inf, math.inf
    phi, gamma = held(plant.space, STEP_S)
    sp = what.sp.copy()
    line = np.zeros(round(plant.dead_time / STEP_S) + 1)
    columns = _live(
        phi, gamma, plant.space.c, settings, free, (body.floor, float(body.pulses), float(body.tracks)), line, sp,
        what.load, what.noise, what.beyond, what.factor, what.added, what.auto, what.moved, what.frozen, what.shut,
    )  # fmt: skip
    return Lived(sp, *columns)


@jit
def _live(
    phi, gamma, c, settings, free, more, line, sp, load, noise, beyond, factor, added, auto, moved, frozen, shut
):  # fmt: skip
    n, m, delay = len(sp), len(gamma), len(line) - 1
    pvs, ops, trues, stems = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    memory, state, fresh = np.zeros(9), np.zeros(m), np.empty(m)
    floor, pulses, tracks = more
    low, high = settings[11], settings[12]
    seen, stem, op, wanted = 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        pv = beyond[k]
        for i in range(m):
            pv += c[i] * state[i]
        if not frozen[k]:
            seen = pv + noise[k]
            if settings[14] > 0:
                seen = round(seen / settings[14]) * settings[14]
        if auto[k]:
            wanted = min(max(_law(settings, memory, sp[k], seen, 1.0) + added[k], low), high)
        else:
            if tracks > 0:
                sp[k] = seen
            rest = _law(free, memory, sp[k], seen, 1.0) - memory[4]
            wanted = min(max(wanted + moved[k], low), high)
            memory[4] = wanted - rest - added[k]  # ready to take over without a bump
        op = wanted
        if pulses > 0:  # on for as large a share of the cycle as is wanted
            op = high if (k % pulses) < (wanted - low) / (high - low) * pulses else low
        pvs[k], ops[k], trues[k] = seen, op, pv
        if not shut[k]:
            stem = _valve(settings, memory, max(op, floor), pv, 1.0) * factor[k]
        stems[k] = stem
        line[k % (delay + 1)] = stem + load[k]
        _step(phi, gamma, line[(k + 1) % (delay + 1)], state, fresh)
    return pvs, ops, trues, stems
