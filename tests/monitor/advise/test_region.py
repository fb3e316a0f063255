"""The compiled search against the exact figures, and the region that it searches."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.advise.region import fastest_safe, found, uncertain_models, worst_peaks
from monitor.advise.stages import ORDERS, stages
from tests.support.fits import make_fit
from tuners.models import SELF_REGULATING, IntegratingModel, Model, SelfRegulatingModel
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


@settings(max_examples=30, deadline=None)
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


def test_the_region_holds_what_the_data_allow():
    """The fit first; gain and T0 reach to their ends; a lag found too long may be none, far longer ones are not in."""
    fit = make_fit(lag=6.0, dead_time=10.0, sd=(0.1, 3.0, 3.0))
    opposite = fit.scatter.copy()
    opposite[1, 2] = opposite[2, 1] = -0.98 * 9.0  # only T0 is well known
    region = uncertain_models(replace(fit, scatter=opposite), 0.0)
    gain, dead_time, lag = (np.ravel(x) for x in (region.gain, region.dead_time, region.lags[0]))
    assert (gain[0], dead_time[0], lag[0]) == (0.05, 10.0, 6.0)
    sd = math.sqrt(fit.cov[0, 0])
    assert np.log(gain.max() / gain.min()) / 2 == pytest.approx(2.795 * sd, rel=1e-3)
    assert lag.min() < 1.0
    assert dead_time.max() > 15.0
    assert lag.max() < 6.0 + 2.0 * 3.0
    assert np.ptp(dead_time + lag) < 6.0
    assert found(region) == IntegratingModel(gain[:1], dead_time[:1], lag[:1])


@settings(max_examples=50, deadline=None)
@given(
    gain=st.floats(1e-6, 1e6),
    lag=st.floats(0.0, 1e4),
    dead_time=st.floats(0.0, 1e4),
    sd=st.tuples(st.floats(0.0, 30.0), st.floats(0.0, 1e5), st.floats(0.0, 1e5)),
    process=st.sampled_from(["integrating", SELF_REGULATING]),
    period=st.floats(0.0, 100.0),
)
def test_no_covariance_is_too_wide_or_too_narrow(gain, lag, dead_time, sd, process, period):
    """Times stay at or above 0, gains keep their sign, all is finite: also without any uncertainty, or with much."""
    fit = make_fit(-gain, lag, dead_time, sd, process)
    for region in (uncertain_models(f, period) for f in (fit, replace(fit, floor=np.zeros(3)))):
        for times in (region.dead_time, *region.lags):
            assert np.all(np.isfinite(times))
            assert np.all(np.asarray(times) >= 0)
        assert np.all(np.asarray(region.gain) < 0)
        assert np.all(np.isfinite(region.gain))


def test_the_unit_of_time_does_not_matter():
    """The same region in minutes as in seconds."""
    scatter = np.array([[0.01, 0.02, -0.01], [0.02, 4.0, -2.0], [-0.01, -2.0, 3.0]])
    fit: Any = replace(make_fit(0.6, 5.0, 4.0), scatter=scatter)
    unit = np.array([1.0, 1 / 60, 1 / 60])
    other = replace(
        fit,
        gain=36.0,
        lag=5 / 60,
        dead_time=4 / 60,
        scatter=scatter * np.outer(unit, unit),
        floor=fit.floor * unit**2,
    )
    one, two = uncertain_models(fit, 6.0), uncertain_models(other, 0.1)
    controller = Settings(0.2, 40.0, 3.0, 0.3)
    slow = worst_peaks(one, controller)
    fast = worst_peaks(two, Settings(0.2, 40.0 / 60, 3.0 / 60, 0.3 / 60))
    assert fast == pytest.approx(slow, rel=1e-6)


def test_stages_take_the_safest_way():
    """A rolling integrator whose gain has to rise: with the old reset time the gain first, not both half-way."""
    fit = make_fit(lag=0.0, dead_time=2.0, sd=(0.2, 0.5, 0.5))
    region = uncertain_models(fit, 0.2)
    today, new = Settings(0.3, 10.0), Settings(3.0, 40.0)
    way = stages(region, today, new, 2.2)
    assert len(way) == 3
    assert way[-1] == new
    worst = worst_peaks(
        region, Settings(*(np.array([float(getattr(s, n)) for s in way]) for n in ("kp", "ti")))
    )
    assert worst.max() <= worst_peaks(region, today)[0]
    assert stages(region, new, replace(new, kp=2.0), 2.2) == [replace(new, kp=2.0)]
    assert {order(1.0) for order in ORDERS} == {(1.0, 1.0)}


def test_a_self_regulating_process_keeps_its_slope():
    """Gain and lag that are uncertain together, by a third, share their ratio in every model of the region."""
    fit = make_fit(2.0, 30.0, 4.0, process=SELF_REGULATING)
    scatter = np.diag([0.3**2, (0.3 * 30) ** 2, 0.01])
    scatter[0, 1] = scatter[1, 0] = 0.9999 * 0.3 * 0.3 * 30
    region = uncertain_models(replace(fit, scatter=scatter, floor=np.zeros(3)), 0.0)
    slope = np.log(np.ravel(region.gain) / np.ravel(region.lags[0]))
    assert np.ptp(np.log(np.ravel(region.gain))) > 1.5
    assert np.ptp(slope) < 0.05
    assert np.ptp(np.ravel(region.dead_time)) < 1.0
