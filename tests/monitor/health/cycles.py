"""Loops that swing, and the figures that come of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.health.loop_health import Health, figures
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec
from tests.support.plants import SECOND, START

Array = NDArray[np.float64]
LEVEL = Plant("integrating", 0.05, 4.0)
FLOW = Plant("self-regulating", 1.0, 3.0, (8.0,))
GOOD = {LEVEL: Controller(2.5, 32.0), FLOW: Controller(0.8, 8.0)}


def noise(n: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=n)


def health(sp: object, pv: object, op: object, period: float = 1.0) -> Health:
    n = max(np.size(v) for v in (sp, pv, op))
    time = START + np.round(np.arange(n) * period * SECOND).astype(np.int64)
    detector = Detector([Loop(name="L")])
    detector.run(Samples.of(0, time, *(np.broadcast_to(v, (n,)) for v in (sp, pv, op))))
    return figures(detector.health[0], float(detector.state["clock"]["period"][0]))


def of_error(e: Array, period: float = 1.0) -> Health:
    """Figures of a loop with this error, under a P controller."""
    return health(50.0, 50.0 - e, 30.0 + e, period)


def simulated(plant: Plant, n: int = 8000, **facts: object) -> Health:
    spec = LoopSpec("L", plant, GOOD[plant], pv0=50.0, op0=50.0, **facts)  # type: ignore[arg-type]
    block = Simulation([spec]).advance(n)
    return health(block.sp, block.pv, block.op)
