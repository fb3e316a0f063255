"""What an event's window holds: units, offset and slope, nothing moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.detect.event import EventWindow
from monitor.identify.direct import fit_window
from sim_plants.plants import Plant
from sim_plants.settings import simc
from tests.monitor.identify.tools import random_plant, window_of
from tuners.models import INTEGRATING, SELF_REGULATING


@pytest.mark.parametrize("process", [INTEGRATING, SELF_REGULATING])
@pytest.mark.parametrize(
    "window",
    [
        np.zeros((0, 4)),
        np.zeros((5, 4)),
        np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50), np.ones(50)]),
        np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50), np.arange(50) > 20]),
        np.column_stack([np.arange(50.0), np.zeros(50), np.arange(50.0), np.full(50, 3.0)]),
    ],
    ids=["empty", "short", "dead", "PV rests", "OP rests"],
)
def test_nothing_moved_is_no_model(process, window):
    """None instead of a figure where OP or PV did not move, or there is too little."""
    assert fit_window(EventWindow(*window.T, 20), process) is None


def test_a_positive_offset_and_slope_do_not_matter():
    """A level that is not 0 and a load that OP had not balanced leave the model alone."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    window = window_of(plant, simc(plant, 1.0), 300.0)
    plain = fit_window(window, INTEGRATING)
    drifting = window.pv + 500.0 + 1e-3 * window.time
    other = replace(window, sp=window.sp + 500.0, pv=drifting, op=window.op + 33.0)
    moved = fit_window(other, INTEGRATING)
    assert plain is not None
    assert moved is not None
    for name in ("gain", "lag", "dead_time"):
        assert getattr(moved, name) == pytest.approx(getattr(plain, name), rel=1e-3), name


@settings(max_examples=15)
@given(a=st.floats(1e-3, 1e3), c=st.floats(1e-3, 1e3), seed=st.integers(0, 20))
def test_fit_scales_with_its_units(a, c, seed):
    """PV times a, OP times c: gain times a/c, times and quality unchanged."""
    plant = random_plant(np.random.default_rng(seed))
    window = window_of(plant, simc(plant, 1.0), 300.0, 0.01, seed)
    plain = fit_window(window, INTEGRATING)
    scaled = replace(window, sp=a * window.sp, pv=a * window.pv, op=c * window.op)
    other = fit_window(scaled, INTEGRATING)
    assert plain is not None
    assert other is not None
    assert other.gain == pytest.approx(plain.gain * a / c, rel=1e-5)
    assert other.t0 == pytest.approx(plain.t0, rel=1e-4)
    assert other.quality == pytest.approx(plain.quality, rel=1e-6)
    assert np.sqrt(other.cov[0, 0]) == pytest.approx(np.sqrt(plain.cov[0, 0]), rel=1e-3)
