"""The worst of many models: the compiled figure is the exact one, bisection finds what a look at all finds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.advise.region import fastest_safe, uncertain_models, worst_peaks
from tests.support.fits import make_fit
from tuners.models import IntegratingModel, Model, SelfRegulatingModel
from tuners.robustness import peak_sensitivity
from tuners.settings import Settings
from tuners.simc import simc_pid


def random_loop(rng: np.random.Generator) -> tuple[Model, Settings]:
    """SIMC of one model on another, detuned: from sluggish to unstable, all forms and structures."""

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    theta = log(0.01, 100.0) * rng.choice([0.0, 1.0, 1.0, 1.0])
    unit = theta or log(0.01, 100.0)
    lags = unit * log(0.05, 20.0) * rng.choice([0.0, 1.0]), unit * log(0.05, 3.0) * rng.choice([0.0, 1.0])
    gain = log(1e-3, 1e3) * rng.choice([-1.0, 1.0])
    if rng.random() < 0.6:
        model: Model = IntegratingModel(gain / unit, theta, lags[0])
        kp, ti = 1 / (gain / unit * 2 * unit), 8 * unit
    else:
        model = SelfRegulatingModel(gain, theta, lags[0] + 0.1 * unit, lags[1])
        kp, ti = (lags[0] + unit) / (gain * 2 * unit), lags[0] + unit
    td = rng.choice([0.0, 1.0]) * (lags[0] + 0.1 * unit)
    form = str(rng.choice(["standard", "series", "parallel"]))
    ti = math.inf if rng.random() < 0.2 else ti * log(0.3, 10.0)
    return model, Settings(kp * log(0.02, 5.0), ti, td, td / log(3.0, 30.0), form)


def test_the_compiled_figure_is_the_exact_one():
    """Ms to 1 % where it is of interest, and unstable where the exact one says so."""
    rng = np.random.default_rng(5)
    stable = 0
    for _ in range(1500):
        model, controller = random_loop(rng)
        exact = float(peak_sensitivity(model, controller))
        (compiled,) = worst_peaks(model, controller)
        if exact < 4:
            stable += 1
            assert compiled == pytest.approx(exact, rel=0.01, abs=0.055), (model, controller)
        else:
            assert compiled > 3.5, (model, controller)
    assert 500 < stable < 1400


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.floats(1.3, 3.0))
def test_bisection_finds_what_a_look_at_all_finds(seed, ms_max):
    """The first candidate that is safe for all models, by the exact Ms of each."""
    rng = np.random.default_rng(seed)
    dead_time, lag = rng.uniform(0.5, 5.0), rng.uniform(0.0, 8.0)
    fit = make_fit(0.1, lag, dead_time, tuple(rng.uniform(0.01, 0.3, 3) * [1.0, dead_time, dead_time]))
    times = dead_time * np.geomspace(0.5, 30.0, 40)
    rule = simc_pid(IntegratingModel(0.1, dead_time, lag), times)
    columns = [np.broadcast_to(x, (1, 40)) for x in (rule.kp, rule.ti, rule.td, rule.tf)]
    many = Settings(*columns, form="series")  # type: ignore[misc]
    models = uncertain_models(fit, 0.1)
    (at,) = fastest_safe(models, many, ms_max)
    flat = replace(many, **{n: np.asarray(getattr(many, n)) for n in ("kp", "ti", "td", "tf")})
    worst = np.max(peak_sensitivity(models, flat), axis=0)
    safe = np.flatnonzero(worst <= ms_max)
    if not safe.size:
        assert at >= 39
    else:
        assert abs(int(at) - int(safe[0])) <= 1
