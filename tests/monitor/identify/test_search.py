"""The search finds the model itself where there is no noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.identify.direct import fit_window
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.settings import simc
from sim_plants.specs import LoopSpec, Steps
from tests.monitor.identify.tools import random_plant, window_of
from tests.support.detection import detected, loads_of
from tests.support.plants import samples_of
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


@pytest.mark.parametrize("size", [3.0, -1e-4])
@pytest.mark.parametrize("process", [INTEGRATING, SELF_REGULATING])
@pytest.mark.parametrize("seed", range(6))
def test_a_load_step_without_noise_is_found_and_exact_in_a_long_record(process, seed, size):
    """However small it is, and however long the sluggish loop's tail that thins the window: no false minimum."""
    rng = np.random.default_rng(seed)
    plant = random_plant(rng, process)
    base = simc(plant, 1.0)
    slow = replace(
        base, kp=base.kp * float(rng.uniform(0.15, 1.0)), ti=base.ti * float(rng.uniform(0.4, 4.0))
    )
    spec = LoopSpec(
        name="L", plant=plant, controller=slow, pv0=40.0, op0=50.0, load=Steps((150.4,), (size,)), seed=seed
    )
    _, found = detected(samples_of(Simulation([spec]).advance(200.0 * plant.t0)))
    (event,) = loads_of(found)
    fit = fit_window(event.window, process, load=True, period=1.0)
    assert fit is not None
    assert fit.gain == pytest.approx(plant.gain, rel=0.01)
    assert fit.size == pytest.approx(size, rel=0.01)
    assert fit.t0 == pytest.approx(plant.t0, rel=0.02, abs=0.2)
    assert fit.quality > 0.9999


@pytest.mark.parametrize(
    ("dead_time", "lags", "gain", "reset", "period"),
    [
        (
            2.6,
            (),
            0.65,
            36.0,
            0.26,
        ),  # all but unstable, then a tail a hundred times as long: points of two periods
        (10.0, (30.0, 10.0), 0.16, 8.0, 1.7),  # it rolls
        (7.0, (5.0,), 0.4, 40.0, 0.35),
        (20.0, (), 0.3, 35.0, 1.1),
    ],
)
def test_a_long_window_has_no_false_minimum(dead_time, lags, gain, reset, period):
    """All may have happened within a few points of the window (kp = gain/(K T0), ti = reset T0)."""
    plant = Plant("integrating", 0.5, dead_time, lags)
    controller = Controller(gain / (0.5 * plant.t0), reset * plant.t0)
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=controller,
        pv0=70.0,
        op0=50.0,
        period=period,
        load=Steps((150.4 * period,), (-1.2,)),
    )
    _, found = detected(samples_of(Simulation([spec]).advance(8000.0 * period)))
    fit = fit_window(loads_of(found)[0].window, INTEGRATING, load=True, period=period)
    assert fit is not None
    assert fit.gain == pytest.approx(0.5, rel=0.01)
    assert fit.quality > 0.999
