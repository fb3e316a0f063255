"""The rehearsal: what is compiled at its first use is used once, before the first real event waits for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.contract.entries import ENTRY
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.samples import Samples
from monitor.engine import Engine

from .reorder import Reorder


def warm_up() -> None:
    """Compile (or load) all kernels on small loops: one is sluggish, one regulates itself under noise, one swings."""
    loops = LoopTable(
        [Loop(name="sluggish", kp=0.4, ti=300.0), Loop(name="noisy", kp=1.0, ti=40.0), Loop(name="swinging")]
    )
    engine, reorder = Engine(loops), Reorder(2)
    n = 1500
    k = np.arange(n)
    sp = np.where((k >= 200) & (k < n - 20), 4.0, 0.0)  # one event that ends, one that is open at the end
    noise = np.sin(37.0 * k)
    time_ns = 10**18 + k * 10**9
    pv, op = _under_pi(sp, 1e-3 * noise, 0.4, 300.0, 0.05, 1.0)
    engine.step(Samples.of(0, time_ns, sp, pv, op))
    pv, op = _under_pi(sp, 0.1 * noise, 1.0, 40.0, 0.04, 0.975)
    engine.step(Samples.of(1, time_ns, sp, pv, op))
    wave = np.sin(0.15 * k)
    engine.step(Samples.of(2, time_ns, 0.0, wave, -wave))
    engine.flush()
    engine.rows()
    reorder.push(np.zeros(1, ENTRY), 0.0)
    reorder.release(0.0)


def _under_pi(
    sp: NDArray[np.float64], noise: NDArray[np.float64], kp: float, ti: float, gain: float, keep: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """PV and OP of a process that keeps this share of its level each second; 1: it integrates. A load steps later."""
    level, integral = 0.0, 0.0
    pv, op = np.zeros(len(sp)), np.zeros(len(sp))
    for j in range(1, len(sp)):
        level = keep * level + (gain * (op[j - 5] + (5.0 if j >= 900 else 0.0)) if j >= 5 else 0.0)
        pv[j] = level + noise[j]
        integral += (sp[j] - pv[j]) / ti
        op[j] = kp * (sp[j] - pv[j] + integral)
    return pv, op
