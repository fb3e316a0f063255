"""Closed loops around a controller's block as plants have them: filter, pace, limits, laws that are not linear."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.detect.event import EventWindow

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """A PID block; times in samples of one second."""

    kp: float = 1.5
    ti: float = 80.0
    td: float = 0.0
    tf: float | None = None
    form: str = "standard"
    b: float = 1.0
    c: float = 1.0
    pv_filter: float = 0.0
    delay: int = 0
    """OP acts, and is recorded, so many samples late."""
    scan: int = 1
    low: float = -math.inf
    high: float = math.inf
    squared: float = 0.0
    """The error's size at which the gain is kp; the gain grows with it. 0: linear."""
    gap: float = 0.0
    """Error within which a tenth of the gain acts."""
    ramp: float = 0.0
    """Most that the working set point moves in a sample; 0: at once."""

    def facts(self) -> Loop:
        """The loop table's row of it."""
        tf = self.tf if self.td else None
        return Loop(name="L", kp=self.kp, ti=self.ti, td=self.td, tf=tf, form=self.form, b=self.b, c=self.c)


class Running:
    """A block at work; backward differences."""

    def __init__(self, block: Block, sp: float, pv: float, op: float) -> None:
        self.block = block
        self.sp, self.f = sp, pv
        td, lead = block.td, block.td
        self.tf = 0.0 if td == 0 else td / 10 if block.tf is None else block.tf
        if block.form == "series" and td > 0:
            lead = td - self.tf
        self.lead = lead
        self.slope = 0.0
        self.slope_in = block.c * sp - pv
        self.op, self.integral = op, op - self._gained(block.b * sp - pv)
        self.sent = [op] * (block.delay + 1)

    def _gained(self, e: float) -> float:
        block = self.block
        if block.squared:
            return block.kp * abs(e) / block.squared * e
        if block.gap:
            inside = min(max(e, -block.gap), block.gap)
            return block.kp * (e - inside + 0.1 * inside)
        return block.kp * e

    def step(self, k: int, sp: float, pv: float, forward: float) -> float:
        """Return OP after sample k; ``forward`` is a feed-forward [OP]."""
        block = self.block
        if k % block.scan == 0:
            dt = float(block.scan)
            self.sp = (
                sp if not block.ramp else self.sp + min(max(sp - self.sp, -block.ramp * dt), block.ramp * dt)
            )
            self.f += dt / (block.pv_filter + dt) * (pv - self.f)
            now = block.c * self.sp - self.f
            self.slope = (self.tf * self.slope + now - self.slope_in) / (self.tf + dt)
            self.slope_in = now
            e = self.sp - self.f
            series = self.lead * self.slope if block.form == "series" else 0.0
            more = self._gained(e + series) * dt / block.ti
            rest = self._gained(block.b * self.sp - self.f) + block.kp * self.lead * self.slope + forward
            wish = rest + self.integral + more
            inside = min(max(wish, block.low), block.high)
            if inside == wish or (wish - inside) * more < 0:
                self.integral += more
            self.op = inside
        self.sent.append(self.op)
        self.sent.pop(0)
        return self.sent[0]


@dataclass(frozen=True)
class Process:
    """Gain and two lags behind a dead time; an integrator where ``leak`` is 0."""

    gain: float = 0.05
    lag: float = 3.0
    dead: int = 4
    leak: float = 0.0


def recorded(
    block: Block,
    n: int = 600,
    at: int = 128,
    step: float = 5.0,
    load: float = 0.0,
    noise: float = 0.0,
    forward: Array | None = None,
    process: Process = Process(),
    seed: int = 0,
) -> tuple[Array, Array, Array]:
    """SP, PV and OP of a loop: ``step`` [PV] of the set point, ``load`` [OP] at once; the block sees the noise."""
    rng = np.random.default_rng(seed)
    sp = np.full(n, 50.0)
    sp[at:] += step
    pv, op = np.empty(n), np.empty(n)
    x = y = 0.0
    past = [50.0] * (process.dead + 1)
    running = Running(block, 50.0, 50.0, 50.0)
    for k in range(n):
        pv[k] = 50.0 + y + noise * rng.normal()
        ff = 0.0 if forward is None else float(forward[k])
        op[k] = running.step(k, float(sp[k]), float(pv[k]), ff)
        past.append(op[k] + (load if k >= at else 0.0))
        u = past.pop(0) - 50.0
        x += (u - x) / (process.lag + 1.0)
        y += process.gain * x - process.leak * y
    return sp, pv, op


def window_of(sp: Array, pv: Array, op: Array, before: int = 128, period: float = 1.0) -> EventWindow:
    """Samples as an event's window."""
    return EventWindow((np.arange(len(sp)) - before) * period, sp, pv, op, before)
