"""What the tests of detection share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from monitor.contract.samples import Samples
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.settings import robust_simc
from sim_plants.specs import LoopSpec
from tests.support.plants import samples_of

REFERENCE = {
    "REF-1": (1.0, 1.0, 1.0, 3.922, 16.0),
    "REF-2": (1.0, 2.0, 0.5, 2.272, 4.0),
    "REF-3": (0.2, 8.0, 3.5, 33.98, 320.0),
    "REF-4": (0.2, 8.0, 3.5, 17.64, 50.0),
}


LEVEL = Plant("integrating", 0.03, 4.0, (2.0,))
TUNED = robust_simc(LEVEL, 1.0)


def simulated(seconds: float, **facts: Any) -> Samples:
    """A well tuned level."""
    return samples_of(
        Simulation([replace(LoopSpec("L", LEVEL, TUNED, 50.0, 50.0), **facts)]).advance(seconds)
    )
