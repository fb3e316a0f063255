"""Naive twins of what is fast, in plain Python, and the short way from a simulated plant to records."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.evidence import Window
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment, Event, LoopRow, Record, Suggestion
from monitor.contract.samples import Samples
from monitor.engine import Engine
from sim_plants.loops import Block, Simulation
from sim_plants.specs import LoopSpec
from sim_plants.truth import loop_table

Array = NDArray[np.float64]
START = 1_767_225_600_000_000_000
"""2026-01-01 [ns]."""
SECOND = 1_000_000_000
"""[ns]"""


# ---------------------------------------------------------------------------------------------------
# twins


def step_response(h: float, kind: int, lag: float, lag2: float) -> float:
    """Unit-gain model without dead time, a time ``h`` after a unit step of its input: the textbook's formulas.

    0 at the instant of the step itself: PV is measured before OP moves.
    """
    if h <= 0:
        return 0.0
    e1 = math.exp(-h / lag) if lag else 0.0
    e2 = math.exp(-h / lag2) if lag2 else 0.0
    if lag == lag2:  # the limit of the formulas below
        rise = 1.0 - e1 * (1.0 + h / lag) if lag else 1.0
        return h - 2.0 * lag + e1 * (h + 2.0 * lag) if kind == 0 else rise
    if kind == 0:
        return h - lag - lag2 + (lag**2 * e1 - lag2**2 * e2) / (lag - lag2)
    return 1.0 - (lag * e1 - lag2 * e2) / (lag - lag2)


def response(t: Array, u: Array, kind: int, dead_time: float, lag: float, lag2: float) -> Array:
    """Unit-gain model's response to held input, from rest: the sum of what each move of the input does."""
    moves = np.diff(u, prepend=0.0)
    return np.array(
        [
            sum(
                move * step_response(now - dead_time - at, kind, lag, lag2)
                for at, move in zip(t, moves, strict=True)
            )
            for now in t
        ]
    )


def integrals(window: Array, pv0: float, op0: float) -> dict[str, float]:
    """Running integrals over a window that starts at the onset: OP held, PV and integrals by trapezoids."""
    s1 = s2 = s3 = y1 = y2 = iae = 0.0
    for (t0, sp, pv_a, op), (t1, _, pv_b, _) in pairwise(window):
        dt = t1 - t0
        s1_new = s1 + (op - op0) * dt
        s2_new = s2 + (s1 + s1_new) / 2 * dt
        s3 += (s2 + s2_new) / 2 * dt
        s1, s2 = s1_new, s2_new
        y1_new = y1 + (pv_a - pv0 + pv_b - pv0) / 2 * dt
        y2 += (y1 + y1_new) / 2 * dt
        y1 = y1_new
        iae += (abs(sp - pv_a) + abs(sp - pv_b)) / 2 * dt
    return {"s1": s1, "s2": s2, "s3": s3, "y1": y1, "y2": y2, "iae": iae}


def noise_through(kp: float, td: float, tf: float, period: float, noise: Array) -> float:
    """Standard deviation of OP that this noise causes in a standard P(D) controller, backward differences."""
    d = last = 0.0
    out = []
    for v in noise:
        d = (tf * d + v - last) / (tf + period)
        last = float(v)
        out.append(kp * (v + td * d))
    return float(np.std(out))


# ---------------------------------------------------------------------------------------------------
# from a plant to records


@dataclass
class Seen:
    """What an engine said, sorted by kind of record."""

    events: list[Event] = field(default_factory=list)
    assessments: list[Assessment] = field(default_factory=list)
    suggestions: list[Suggestion] = field(default_factory=list)
    windows: list[Window] = field(default_factory=list)

    @property
    def closed(self) -> list[Event]:
        return [e for e in self.events if e.state != "open"]

    @property
    def opened(self) -> list[Event]:
        return [e for e in self.events if e.state == "open"]


def sorted_records(records: Iterable[Record]) -> Seen:
    seen = Seen()
    for record in records:
        if isinstance(record, Event):
            seen.events.append(record)
        elif isinstance(record, Assessment):
            seen.assessments.append(record)
        elif isinstance(record, Suggestion):
            seen.suggestions.append(record)
        else:
            seen.windows.append(record)
    return seen


def table_of(specs: Sequence[LoopSpec], **facts: Any) -> list[Loop]:
    """Loop table of simulated loops, as it would be read from their export."""
    loops = []
    for row in loop_table(specs):
        loop, wrong = parse_row({**row, **facts})
        assert loop is not None, wrong
        loops.append(loop)
    return loops


def samples_of(block: Block) -> Samples:
    return Samples.of(block.loop, block.time_ns, block.sp, block.pv, block.op, block.auto)


def watch(
    specs: Sequence[LoopSpec], seconds: float, loops: Sequence[Loop] | None = None, **facts: Any
) -> tuple[Engine, Seen]:
    """Simulate loops and run an engine over them."""
    engine = Engine(LoopTable(table_of(specs, **facts) if loops is None else loops))
    records = engine.step(samples_of(Simulation(specs).advance(seconds)))
    return engine, sorted_records(records + engine.flush())


def run(loop: Loop, samples: Samples) -> tuple[Engine, Seen]:
    """Run an engine over one loop's samples, to the end of the data."""
    engine = Engine(LoopTable([loop]))
    return engine, sorted_records(engine.step(samples) + engine.flush())


def times(n: int, period: float = 1.0, start: int = START) -> NDArray[np.int64]:
    return start + np.round(np.arange(n) * period * 1e9).astype(np.int64)


def pi_loop(
    sp: Array,
    *,
    kp: float = 2.0,
    ti: float = 40.0,
    gain: float = 0.05,
    dead: int = 4,
    noise: float = 0.0,
    seed: int = 0,
    op0: float = 50.0,
    disturb: Callable[[int, float], float] = lambda _k, pv: pv,
    load: Callable[[int], float] = lambda _k: 0.0,
) -> tuple[Array, Array]:
    """PV and OP of an integrator with ``dead`` samples of dead time under PI, 1 s a sample, starting at rest.

    ``disturb`` is done to PV as the controller sees it, ``load`` [OP] is added to what goes into the process.
    """
    rng = np.random.default_rng(seed)
    y = integral = 0.0
    past = [0.0] * (dead + 1)
    pv, op = np.empty(len(sp)), np.empty(len(sp))
    for k in range(len(sp)):
        pv[k] = disturb(k, sp[0] + y + noise * rng.normal())
        e = sp[k] - pv[k]
        integral += kp / ti * e
        op[k] = op0 + kp * e + integral
        past.append(op[k] - op0 + load(k))
        y += gain * past[-dead - 1]
    return pv, op


def row_of(engine: Engine, name: str) -> LoopRow:
    return engine.row(engine.loops.by_name[name])
