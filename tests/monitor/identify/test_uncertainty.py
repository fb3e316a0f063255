"""Intervals: they hold the truth, are of use, and grow with what is not known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.detect.event import EventWindow
from monitor.identify.direct import fit_window
from monitor.identify.fit import Fit
from monitor.identify.uncertainty import beyond_noise, tangent_scatter
from sim_plants.controllers import Controller
from sim_plants.plants import Plant
from sim_plants.settings import simc
from tests.monitor.identify.tools import BEFORE, load_event, random_plant, window_of
from tuners.models import INTEGRATING


def without_point(window: EventWindow, k: int) -> EventWindow:
    """The window, one sample after the onset lost."""
    columns = (np.delete(column, k) for column in (window.time, window.sp, window.pv, window.op))
    return EventWindow(*columns, window.before)


@pytest.fixture(scope="module")
def noisy() -> list[tuple[Plant, Fit]]:
    """A hundred loops at 1 % of noise, fitted from one set-point step each."""
    found = []
    for seed in range(100):
        rng = np.random.default_rng(1000 + seed)
        plant = random_plant(rng)
        base = simc(plant, 1.0)
        controller = replace(base, kp=base.kp * float(rng.uniform(0.3, 1.0)))
        seconds = 60 * plant.t0
        fit = fit_window(window_of(plant, controller, seconds, 0.01, seed), INTEGRATING)
        assert fit is not None
        found.append((plant, fit))
    return found


def test_gains_interval_covers_the_truth(noisy):
    """At 1 % noise the 95 % interval of the gain holds the true gain in at least 90 of 100 loops."""
    inside = sum(fit.interval("gain")[0] <= plant.gain <= fit.interval("gain")[1] for plant, fit in noisy)
    assert inside >= 90


def test_intervals_are_of_use(noisy):
    """They are not bought by width: the gain's is below 15 % either way in the median."""
    widths = [math.log(abs(fit.interval("gain")[1] / fit.interval("gain")[0])) for _, fit in noisy]
    assert np.median(np.abs(widths)) < 0.3


def test_t0_at_one_percent_of_noise(noisy):
    """T0 within 15 % in at least 95 of 100 loops."""
    assert sum(abs(fit.t0 / plant.t0 - 1) < 0.15 for plant, fit in noisy) >= 95


def test_interval_of_dead_time_covers_the_truth(noisy):
    """In at least 85 of 100: noise that travels round the loop biases a direct fit."""
    inside = sum(
        fit.interval("dead_time")[0] <= plant.dead_time <= fit.interval("dead_time")[1]
        for plant, fit in noisy
    )
    assert inside >= 85


def test_intervals_after_a_load_step_cover_the_truth(after_loads):
    """Of gain, T0 and the half rule's dead time, in nine of ten at least."""
    inside = np.array(
        [
            [
                fit.interval("gain")[0] <= plant.gain <= fit.interval("gain")[1],
                fit.interval("t0")[0] <= plant.t0 <= fit.interval("t0")[1],
                abs(fit.dead_time + fit.lag2 / 2 - plant.half_rule()[0]) <= 1.96 * math.sqrt(fit.cov[2, 2]),
            ]
            for plant, (_, fit) in after_loads
        ]
    )
    assert (inside.mean(axis=0) >= 0.9).all()


def test_the_valley_lies_about_the_fit(after_loads):
    """A way of models from less to more dead time, the best among them, none better than the best."""
    for _, (integrating, fit) in after_loads:
        assert integrating.valley is None
        if fit.valley is None:  # not believed
            continue
        assert (np.diff(fit.valley.models[:, 2]) >= 0).all()
        assert fit.valley.deficit.min() == 0.0
        assert (fit.valley.deficit >= 0).all()
        assert fit.valley.models[0, 2] - 0.5 <= fit.dead_time <= fit.valley.models[-1, 2] + 0.5
        assert np.linalg.eigvalsh(fit.valley.across).min() >= -1e-9


def test_a_lost_sample_widens_the_intervals():
    """The row of the derivative's kick is lost: the gain is wrong by a tenth, and its interval says so."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    controller = replace(simc(plant, 1.0), kp=0.5 * simc(plant, 1.0).kp, td=6.0, tf=0.6)
    window = window_of(plant, controller, 300.0, 0.002)
    whole = fit_window(window, INTEGRATING)
    fits = [fit_window(without_point(window, BEFORE + k), INTEGRATING) for k in (1, 2, 150)]
    assert whole is not None
    for fit in fits:
        assert fit is not None
        low, high = fit.interval("gain")
        assert low <= plant.gain <= high
    assert fits[0] is not None
    assert fits[2] is not None
    assert fits[0].scatter[0, 0] > 20 * whole.scatter[0, 0]
    assert fits[2].scatter[0, 0] < 4 * whole.scatter[0, 0]  # nothing but noise moved there


def test_more_noise_widens_the_intervals():
    """Honest: three times the noise, about three times the scatter."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    scatter = []
    for noise in (0.01, 0.03):
        fit = fit_window(window_of(plant, simc(plant, 1.0), 300.0, noise, 5), INTEGRATING)
        assert fit is not None
        scatter.append(math.sqrt(fit.scatter[0, 0]))
    assert scatter[1] == pytest.approx(3 * scatter[0], rel=0.5)


def test_what_is_no_noise_counts_as_one_disturbance_along_a_parameter():
    """Residuals of one size, white: as large as the noise before they tell much, beyond it one point's worth."""
    rng = np.random.default_rng(0)
    residual = rng.normal(0.0, 0.1, 600)
    jacobian = np.column_stack([np.sin(np.linspace(0.1, k, 600)) for k in (1.0, 3.0, 5.0)])
    noise, model = (tangent_scatter(residual, jacobian, 10.0, 1.0, quiet) for quiet in (0.2, 0.0))
    assert model[0, 0] > 50.0 * noise[0, 0]
    exact = np.linalg.pinv(jacobian.T @ jacobian)[0, 0] * float(residual @ residual)
    assert model[0, 0] == pytest.approx(exact, rel=0.2)


@pytest.mark.parametrize("seed", range(6))
def test_a_plant_of_more_lags_is_inside_its_interval(seed):
    """Five lags, no noise, P alone after a load step: the model of one lag lacks most there; its gain is not sure."""
    rng = np.random.default_rng(seed)
    lags = tuple(float(x) for x in rng.uniform(2.0, 8.0, 5))
    plant = Plant("integrating", 0.05, 4.0, lags)
    controller = Controller(float(rng.uniform(0.25, 0.6)) / (0.05 * plant.t0), math.inf)
    event = load_event(plant, controller, 0.0, seed)
    assert event is not None
    fit = fit_window(event, INTEGRATING, load=True, period=1.0)
    assert fit is not None
    low, high = fit.interval("gain")
    assert low < 0.05 < high


def test_what_goes_on_is_no_noise_however_small():
    """A slow error half hidden in noise that was white before; none where noise itself was as slow."""
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 0.1, 600)
    slow = 0.07 * np.sin(np.linspace(0.0, 15.0, 600))
    assert beyond_noise(noise, 0.15, 1.0) == 0.0
    assert beyond_noise(noise + slow, 0.15, 1.0) == pytest.approx(0.07**2 / 2, rel=0.4)
    assert beyond_noise(noise + slow, 0.15, 30.0) == 0.0
    assert beyond_noise(noise, 0.05, 1.0) == pytest.approx(0.1**2 - 0.05**2, rel=0.15)
