"""The rehearsal: what is compiled at its first use is used once, before the first real event waits for it."""

from __future__ import annotations

import numpy as np

from monitor.contract.entries import ENTRY
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.samples import Samples
from monitor.engine import Engine

from .reorder import Reorder


def warm_up() -> None:
    """Compile (or load) all kernels on two small loops: one is sluggish, one swings."""
    loops = LoopTable([Loop(name="sluggish", kp=0.4, ti=300.0), Loop(name="swinging")])
    engine, reorder = Engine(loops), Reorder(2)
    n = 1500
    k = np.arange(n)
    sp = np.where((k >= 200) & (k < n - 20), 4.0, 0.0)  # one event that ends, one that is open at the end
    pv, op = np.zeros(n), np.zeros(n)
    integral = 0.0
    for j in range(1, n):
        pv[j] = pv[j - 1] + (0.05 * op[j - 5] if j >= 5 else 0.0)
        integral += (sp[j] - pv[j]) / 300.0
        op[j] = 0.4 * (sp[j] - pv[j] + integral)
    wave = np.sin(0.15 * k)
    time_ns = 10**18 + k * 10**9
    engine.step(Samples.of(0, time_ns, sp, pv + 1e-3 * np.sin(37.0 * k), op))
    engine.step(Samples.of(1, time_ns, 0.0, wave, -wave))
    engine.flush()
    engine.rows()
    reorder.push(np.zeros(1, ENTRY), 0.0)
    reorder.release(0.0)
