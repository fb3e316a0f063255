"""The search finds the model itself where there is no noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.identify.direct import fit_window
from sim_plants.plants import Plant
from sim_plants.settings import simc
from tests.monitor.identify.tools import random_plant, window_of
from tuners.models import INTEGRATING, SELF_REGULATING


@pytest.mark.parametrize("seed", range(12))
def test_fit_is_exact_without_noise(seed):
    """On a plant of the model's own order: gain within 0.1 %, T0 and dead time within 1 % of T0 or a tenth period."""
    rng = np.random.default_rng(seed)
    plant = random_plant(rng)
    base = simc(plant, 1.0)
    controller = replace(
        base, kp=base.kp * float(rng.uniform(0.3, 1.0)), ti=base.ti * float(rng.uniform(0.7, 3.0))
    )
    fit = fit_window(window_of(plant, controller, 500.0), INTEGRATING)
    assert fit is not None
    assert fit.gain == pytest.approx(plant.gain, rel=1e-3)
    near = max(0.01 * plant.t0, 0.1)
    assert fit.t0 == pytest.approx(plant.t0, abs=near)
    assert fit.dead_time == pytest.approx(plant.dead_time, abs=2 * near)
    assert fit.quality > 0.99999


@pytest.mark.parametrize("seed", range(8))
def test_fit_of_a_self_regulating_plant_is_exact_without_noise(seed):
    """The same for first order plus dead time."""
    rng = np.random.default_rng(100 + seed)
    plant = random_plant(rng, SELF_REGULATING)
    fit = fit_window(window_of(plant, simc(plant, 1.0), 500.0), SELF_REGULATING)
    assert fit is not None
    assert fit.gain == pytest.approx(plant.gain, rel=5e-3)
    assert fit.t0 == pytest.approx(plant.t0, rel=0.02)


def test_a_lag_shorter_than_a_block_is_found():
    """Of a long window, in which two or three points make a block: the lag is not taken for dead time."""
    plant = Plant("integrating", 0.01, 9.0, (2.5,))
    window = window_of(plant, replace(simc(plant, 1.0), kp=simc(plant, 1.0).kp / 3), 900.0)
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    assert fit.lag == pytest.approx(2.5, abs=0.1)
    assert fit.dead_time == pytest.approx(9.0, abs=0.1)
