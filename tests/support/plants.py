"""Simulated loops: one under PI in plain Python, and those of `sim_plants` as the monitor takes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from sim_plants.loops import Block
from sim_plants.specs import LoopSpec
from sim_plants.truth import loop_table

Array = NDArray[np.float64]
START = 1_767_225_600_000_000_000
"""2026-01-01 [ns]."""
SECOND = 1_000_000_000
"""[ns]"""


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
    lag: float = 0.0,
    period: float = 1.0,
    low: float = -math.inf,
    high: float = math.inf,
    disturb: Callable[[int, float], float] = lambda _k, pv: pv,
    load: Callable[[int], float] = lambda _k: 0.0,
) -> tuple[Array, Array]:
    """PV and OP of an integrating process under PI, a ``period`` [s] a sample, starting at rest.

    ``gain`` [PV/(OP s)], ``lag`` [s], ``dead`` samples of dead time and the one of the sampling. ``disturb`` is done
    to PV as the controller sees it, ``load`` [OP] is added to what goes into the process. OP stays between ``low``
    and ``high``; the integral stands still while it is at a limit.
    """
    rng = np.random.default_rng(seed)
    y = x = integral = 0.0
    share = -math.expm1(-period / lag) if lag else 1.0
    past = [0.0] * (dead + 1)
    pv, op = np.empty(len(sp)), np.empty(len(sp))
    for k in range(len(sp)):
        pv[k] = disturb(k, sp[0] + y + noise * rng.normal())
        e = sp[k] - pv[k]
        more = integral + kp / ti * e * period
        wish = op0 + kp * e + more
        op[k] = min(max(wish, low), high)
        if op[k] == wish:
            integral = more
        past.append(op[k] - op0 + load(k))
        x = past[-dead - 1] if lag == 0 else x + share * (past[-dead - 1] - x)
        y += gain * period * x
    return pv, op


def stepped(n: int = 900, at: int = 200, size: float = 4.0, **facts: Any) -> Samples:
    """One loop with a set-point step, at rest before it."""
    sp = np.full(n, 50.0)
    sp[at:] += size
    pv, op = pi_loop(sp, **facts)
    return Samples.of(0, times(n), sp, pv, op)


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
