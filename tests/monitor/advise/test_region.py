"""The compiled search against the exact figures, and the region that it searches."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from monitor.advise.region import nominal, uncertain_models, worst_peaks
from tests.monitor.advise.tools import given_advice, sluggish
from tests.support.fits import make_fit
from tuners.models import SELF_REGULATING, IntegratingModel
from tuners.settings import Settings


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
    assert nominal(region) == IntegratingModel(gain[:1], dead_time[:1], lag[:1])


@example(1.0, 2.2e-313, 0.0, (0.0, 0.0, 0.0), SELF_REGULATING, 0.0)
@settings(max_examples=50)
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


def test_the_region_grows_with_correlation():
    """The joint covariance counts: gain and dead time that rise together are worse than apart."""
    fit = make_fit(sd=(0.2, 0.1, 1.5))
    together = fit.scatter.copy()
    together[0, 2] = together[2, 0] = 0.9 * 0.2 * 1.5
    apart = fit.scatter.copy()
    apart[0, 2] = apart[2, 0] = -0.9 * 0.2 * 1.5
    worse = given_advice(sluggish(), replace(fit, scatter=together))
    better = given_advice(sluggish(), replace(fit, scatter=apart))
    assert float(worse.aim.kp) < float(better.aim.kp)
