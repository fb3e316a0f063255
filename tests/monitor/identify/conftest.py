"""What the tests here share."""

from __future__ import annotations

import pytest

from monitor.identify.direct import fit_kinds
from monitor.identify.fit import Fit
from sim_plants.plants import Plant
from tests.monitor.identify.tools import load_event, with_second_lag
from tuners.models import INTEGRATING, SELF_REGULATING


@pytest.fixture(scope="session")
def after_loads() -> list[tuple[Plant, list[Fit]]]:
    """Forty self-regulating plants after a load step at 1 % of noise, both kinds fitted."""
    found = []
    for seed in range(40):
        plant, controller = with_second_lag(seed)
        event = load_event(plant, controller, 0.02, seed)
        if event is not None:
            found.append((plant, fit_kinds(event, [INTEGRATING, SELF_REGULATING], True, 1.0)))
    assert len(found) >= 35
    return found
