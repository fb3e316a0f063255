"""What the tests here share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from sim_plants.fleet import random_fleet
from sim_plants.loops import Simulation
from tests.support.plants import samples_of


@pytest.fixture(scope="session")
def fleet() -> tuple[list[Loop], Samples]:
    """Twelve loops of several periods over 2,000 s, interleaved in time, some samples bad."""
    specs = random_fleet(12, 3, noise=(0.0, 0.02))
    samples = samples_of(Simulation(specs).advance(2000.0))
    rng = np.random.default_rng(0)
    pv = samples.pv.copy()
    pv[rng.random(len(pv)) < 0.01] = np.nan
    auto = samples.auto.copy()
    auto[(samples.loop == 3) & (np.arange(len(pv)) % 5000 < 40)] = False
    return [Loop(name=s.name) for s in specs], replace(samples, pv=pv, auto=auto)
