"""Windows of simulated events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from monitor.contract.loops import Loop
from monitor.detect.detector import Detector
from monitor.detect.event import ClosedEvent, EventWindow
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.settings import simc
from sim_plants.specs import LoopSpec, Steps
from tests.support.plants import samples_of
from tuners.models import INTEGRATING

BEFORE = 60


def window_of(
    plant: Plant, controller: Controller, seconds: float, noise: float = 0.0, seed: int = 0
) -> EventWindow:
    """Window of a set-point step of 1 after 60 samples of rest, 1 s a sample."""
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=controller,
        setpoint=Steps((float(BEFORE),), (1.0,)),
        noise=noise,
        seed=seed,
    )
    block = Simulation([spec]).advance(BEFORE + seconds)
    t = (block.time_ns - block.time_ns[0]) * 1e-9 - BEFORE
    return EventWindow(t, block.sp, block.pv, block.op, BEFORE)


def random_plant(rng: np.random.Generator, process: str = INTEGRATING) -> Plant:
    """A plant of no or one lag: the model's own order, so that a fit can be exact."""
    dead_time = float(rng.uniform(2.0, 12.0))
    lags = (float(dead_time * rng.uniform(0.3, 4.0)),)
    gain = float(rng.choice([-1, 1]) * np.exp(rng.uniform(-5, 1)))
    if process == INTEGRATING:
        return Plant("integrating", gain, dead_time, lags if rng.random() < 0.7 else ())
    return Plant("self-regulating", gain, dead_time, lags)


def load_event(plant: Plant, controller: Controller, noise: float, seed: int) -> EventWindow | None:
    """Window of a load step of 5 between samples; None where it is not noticed."""
    spec = LoopSpec(
        name="L", plant=plant, controller=controller, load=Steps((150.4,), (5.0,)), noise=noise, seed=seed
    )
    detector = Detector([Loop(name="L")])
    found = detector.run(samples_of(Simulation([spec]).advance(150 + 40 * plant.t0))) + detector.flush()
    windows = [e.window for e in found if isinstance(e, ClosedEvent)]
    return windows[0] if windows else None


def with_second_lag(seed: int) -> tuple[Plant, Controller]:
    """A self-regulating plant of two lags under a PI that is slower than SIMC's."""
    rng = np.random.default_rng(seed)
    dead_time = float(rng.uniform(3.0, 8.0))
    first = dead_time * float(rng.uniform(2.0, 10.0))
    plant = Plant("self-regulating", 2.0, dead_time, (first, first * float(rng.uniform(0.05, 0.4))))
    base = simc(plant, 1.0)
    return plant, replace(base, kp=base.kp * float(rng.uniform(0.3, 1.0)), td=0.0)
