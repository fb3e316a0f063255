"""An outlier in the midst of an event costs nothing; a response is none, however fast."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.identify.outliers import outliers
from tests.support.plants import pi_loop

N = 1000


def load_step(outlier: float, at: int, noise: float = 0.05):
    """PV and OP of an integrator whose load steps by 5 at 500 s, with one outlier that the controller sees, too."""
    sp = np.full(N, 50.0)
    pv, op = pi_loop(
        sp,
        noise=noise,
        seed=1,
        disturb=lambda k, pv: pv + outlier * (k == at),
        load=lambda k: 5.0 * (k >= 500),
    )
    return sp, pv, op


def setpoint_step(outlier: float, at: int, noise: float = 0.05):
    """The same loop, whose set point steps by 5; the outlier is the historian's alone."""
    sp = np.where(np.arange(N) < 500, 50.0, 55.0)
    pv, op = pi_loop(sp, noise=noise, seed=1)
    pv[at] += outlier
    return sp, pv, op


def assessed(columns) -> list[Assessment]:
    engine = Engine(LoopTable([Loop(name="L", kp=2.0, ti=40.0)]))
    records = engine.step(Samples.of(0, np.arange(N) * 1_000_000_000, *columns, True)) + engine.flush()
    return [r for r in records if isinstance(r, Assessment)]


@pytest.mark.parametrize("make", [setpoint_step, load_step])
@pytest.mark.parametrize("outlier", [-3.0, 10.0, 100.0])
@pytest.mark.parametrize("at", [515, 540, 600])
def test_an_outlier_costs_no_event(make, outlier, at):
    """The event is found once, with the gain that it has, and a verdict rests on it."""
    [event] = assessed(make(outlier, at))
    assert event.gain == pytest.approx(0.05, rel=0.05)
    assert event.verdict != "inconclusive"


@pytest.mark.parametrize("at", [515, 540, 600])
def test_an_index_does_not_count_an_outlier(at):
    """That of the historian's alone: integrated error and index are as without it."""
    [event], [clean] = assessed(setpoint_step(100.0, at)), assessed(setpoint_step(0.0, at))
    assert event.iae == pytest.approx(clean.iae, rel=0.01)
    assert event.ci == pytest.approx(clean.ci, rel=0.03)


@given(st.integers(0, 2**31), st.floats(0.3, 30.0), st.floats(0.0, 0.3))
def test_nothing_that_a_process_does_is_an_outlier(seed, lag, noise):
    """A step through two lags, a sine, and noise have no outlier, at any number of samples in a lag."""
    rng = np.random.default_rng(seed)
    t = np.arange(200.0)
    after = np.maximum(t - 50, 0)
    step = 1 - (1 + after / lag) * np.exp(-after / lag)
    for pv in (step, np.sin(t / lag), np.zeros(200)):
        assert len(outliers(pv + noise * rng.normal(size=200), 10 * noise)) == 0


def test_an_outlier_is_seen_where_it_is():
    """Two in a row are none: somebody may have measured them."""
    pv = 50 + 0.1 * np.random.default_rng(0).normal(size=100)
    pv[40] += 5
    pv[[70, 71]] += 5
    assert list(outliers(pv, 1.0)) == [40]
