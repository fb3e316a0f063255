"""Simulator of the benchmark `mismatch`: one loop on a fine grid, with valve, block and recording as they are.

A rig keeps its state, so that a campaign goes on where the last event ended.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field

import numpy as np

from monitor.compiled import jit
from tests.bench.mismatch_plant import Floats, Law, Plant, held

VALVES = ("linear", "percentage", "direction", "backlash", "stiction", "rate", "drum", "root")
LAWS = ("linear", "squared", "gap")


@dataclass(frozen=True)
class Valve:
    """What lies between OP and the plant: a kind of `VALVES` and its numbers."""

    kind: str = "linear"
    first: float = 0.0
    second: float = 0.0

    def slope(self, op: float, level: float) -> float:
        """Factor on the plant's gain with OP and PV (both as deviations) at rest there."""
        if self.kind == "percentage":
            return math.exp(self.first * op)
        if self.kind in {"drum", "root"}:
            return float(_level_factor(VALVES.index(self.kind), level, self.first, self.second))
        return 1.0


@dataclass
class Rig:
    """One loop: plant, controller, valve; periods as whole numbers of fine steps."""

    plant: Plant
    law: Law
    step: float
    """Fine step [s]."""
    scan: int
    valve: Valve = field(default_factory=Valve)
    op_low: float = -math.inf
    op_high: float = math.inf
    """Limits of OP, as deviations from where it rests at first."""
    op_quantum: float = 0.0
    pv_quantum: float = 0.0

    def __post_init__(self) -> None:
        self.phi, self.gamma = held(self.plant.space, self.step)
        self.state = np.zeros(len(self.gamma))
        self.line = np.zeros(round(self.plant.dead_time / self.step) + 1)
        self.outputs = np.zeros(self.law.late + 1)
        self.memory = np.zeros(9)
        """Fine steps done, PV filtered, last derivative input, derivative, integral, valve, its memory, OP, PV."""

    def copy(self) -> Rig:
        return copy.deepcopy(self)

    def type_in(self, law: Law) -> None:
        """Take new settings at rest, without a bump (the filtered PV stands where the set point does)."""
        self.memory[4] += (self.law.kp - law.kp) * (law.b - 1) * self.memory[1]
        self.law = law

    def run(
        self, sp: Floats, load: Floats, noise: Floats | None = None, added: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Go on for as many fine steps as there are set points; return PV as measured, and OP as it acts."""
        law = self.law
        zero = np.zeros(len(sp))
        settings = np.array(
            [
                law.kp, law.ti, law.lead, law.tf, law.b, law.c, law.filter, float(law.form == "series"),
                LAWS.index(law.kind), law.width, law.inside, self.op_low, self.op_high,
                self.op_quantum, self.pv_quantum, VALVES.index(self.valve.kind), self.valve.first, self.valve.second,
            ]
        )  # fmt: skip
        return _run(
            self.phi, self.gamma, self.plant.space.c, settings, self.step, self.scan, self.state, self.line,
            self.outputs, self.memory, sp, load, zero if noise is None else noise, zero if added is None else added,
        )  # fmt: skip


@jit
def _level_factor(kind, level, span, start):
    """Gain of a vessel whose area depends on its level, against that where it stood at first."""
    now = min(max(start + level / span, 0.02), 0.98)
    if kind == 6:  # horizontal drum: area ~ sqrt(L (1 - L))
        return math.sqrt(start * (1 - start) / (now * (1 - now)))
    return math.sqrt(start / now)


@jit
def _law(settings, memory, sp, pv, ts):
    """One execution of the block: OP."""
    kp, ti, lead, tf, b, c, flt = settings[:7]
    memory[1] += ts / (flt + ts) * (pv - memory[1])
    f = memory[1]
    error = sp - f
    factor = 1.0
    if settings[8] == 1:
        factor = abs(error) / settings[9]
    elif settings[8] == 2:  # beyond the gap the rest of the error counts in full
        beyond = max(1 - settings[9] / max(abs(error), 1e-300), 0.0)
        factor = settings[10] + (1 - settings[10]) * beyond
    drive = c * sp - f
    rate = (tf * memory[3] + drive - memory[2]) / (tf + ts)
    prop = b * sp - f
    if settings[7] == 1:
        prop += lead * rate
    # the series lead goes before the integral too
    inner = error + lead * rate if settings[7] == 1 else error
    grown = memory[4] + kp * factor * ts / ti * inner
    out = kp * factor * prop + (0.0 if settings[7] == 1 else kp * factor * lead * rate)
    wanted = out + grown
    limited = min(max(wanted, settings[11]), settings[12])
    if limited == wanted or (wanted - limited) * (grown - memory[4]) < 0:
        memory[4] = grown  # conditional integration
    limited = min(max(out + memory[4], settings[11]), settings[12])
    memory[2], memory[3] = drive, rate
    return limited


@jit
def _valve(settings, memory, op, pv, step):
    """Flow of the valve for this OP; its stem is kept in the memory."""
    kind, first, second = int(settings[15]), settings[16], settings[17]
    stem = memory[5]
    if kind == 1:
        return (math.exp(first * op) - 1) / first
    if kind == 2:
        return first * op if op > 0 else second * op
    if kind == 3:  # backlash: a band between OP and stem
        stem = min(max(stem, op - first), op + first)
    elif kind == 4:  # stiction: sticks within a band, then jumps nearly all the way
        if abs(op - stem) > first:
            stem = op - second * (1.0 if op > stem else -1.0)
    elif kind == 5:
        stem += min(max(op - stem, -first * step), first * step)
    else:
        stem = op
    memory[5] = stem
    if kind in (6, 7):
        return stem * _level_factor(kind, pv, first, second)
    return stem


@jit
def _step(phi, gamma, u, state, fresh):
    """Let the plant's state go on by a step under an input (in place); ``fresh`` is room for it."""
    m = len(state)
    for i in range(m):
        total = gamma[i] * u
        for j in range(m):
            total += phi[i, j] * state[j]
        fresh[i] = total
    for i in range(m):
        state[i] = fresh[i]


@jit
def _run(
    phi, gamma, c, settings, step, scan, state, line, outputs, memory, sp, load, noise, added
):  # fmt: skip
    n, m = len(sp), len(state)
    pvs, ops = np.empty(n), np.empty(n)
    late, delay = len(outputs) - 1, len(line) - 1
    fresh = np.empty(m)
    for k in range(n):
        pv = 0.0
        for i in range(m):
            pv += c[i] * state[i]
        seen = pv + noise[k]
        if settings[14] > 0:
            seen = round(seen / settings[14]) * settings[14]
        at = int(memory[0])
        if at % scan == 0:
            op = _law(settings, memory, sp[k], seen, scan * step) + added[k]
            op = min(max(op, settings[11]), settings[12])
            if settings[13] > 0:
                op = round(op / settings[13]) * settings[13]
            turn = (at // scan) % (late + 1)
            outputs[turn] = op
            memory[7] = outputs[(turn + 1) % (late + 1)]
        pvs[k], ops[k] = seen, memory[7]
        line[at % (delay + 1)] = _valve(settings, memory, memory[7], pv, step) + load[k]
        _step(phi, gamma, line[(at + 1) % (delay + 1)], state, fresh)
        memory[0] += 1
    return pvs, ops
