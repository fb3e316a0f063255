"""Indices of unit steps by the settings of today."""

from __future__ import annotations

import math

import pytest

from monitor.assess.predicted import NO_INDICES, predicted_indices
from monitor.contract.loops import Loop
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.support.plants import samples_of, table_of
from tests.support.runs import run
from tuners.models import IntegratingModel, SelfRegulatingModel

HARDLY = 1e-6
"""Sample period that adds no dead time [s]."""


@pytest.mark.parametrize(
    ("kp", "ti", "td", "gain", "theta", "lag", "sp", "ld"),
    [  # reference loops of docs/theory.md section 5
        (0.5, 8.0, 0.0, 1.0, 1.0, 0.0, 1.005, 1.000),
        (0.25, 80.0, 2.0, 0.2, 3.5, 4.5, 0.406, 0.1225),
        (0.6, 30.0, 3.0, 0.2, 3.5, 4.5, 0.782, 0.784),
    ],
)
def test_reference_loops(kp, ti, td, gain, theta, lag, sp, ld):
    """On the half rule's model the indices are those of the true plants, but for what the model leaves out."""
    loop = Loop(name="L", kp=kp, ti=ti, td=td, tf=td / 10, form="series", closed_loop_time=theta)
    found = predicted_indices(loop, IntegratingModel(gain, theta, lag), 1.7, HARDLY)
    assert found == pytest.approx((sp, ld), rel=0.06)


def test_what_is_not_known_is_not_predicted():
    """No settings, an unstable loop, a load without integral action."""
    level = IntegratingModel(0.05, 4.0)
    assert predicted_indices(Loop(name="L"), level, None, 1.0) == NO_INDICES
    assert predicted_indices(Loop(name="L", kp=20.0, ti=10.0), level, math.inf, 1.0) == NO_INDICES
    setpoint, load = predicted_indices(Loop(name="L", kp=2.0), level, 1.5, 1.0)
    assert setpoint is not None
    assert load is None
    lagless = SelfRegulatingModel(2.0, 5.0, 0.0)
    assert predicted_indices(Loop(name="L", kp=0.1, ti=5.0), lagless, 1.5, 1.0)[1] is not None


@pytest.mark.parametrize("objective", ["both", "load"])
def test_a_loop_that_follows_well_and_recovers_slowly_is_to_be_retuned(objective):
    """A set-point step alone tells it, where the settings are known; what is suggested is better for loads."""
    spec = LoopSpec(
        "L",
        Plant("integrating", 0.05, 4.0),
        Controller(2.2, 240.0),
        setpoint=Steps((200.0,), (4.0,)),
        noise=0.01,
    )
    loop = table_of([spec], objective=objective)[0]
    engine, seen = run(loop, samples_of(Simulation([spec]).advance(1500.0)))
    record, row = seen.assessments[0], engine.row(0)
    assert record.ci is not None
    assert record.ci > 0.6
    assert record.verdict == row.verdict == "retune"
    assert "CI_ld" in row.reason
    assert "predicted" in row.reason
    assert row.ci_load is None  # measured ones alone
    assert row.new_kp is not None
    assert row.new_ti is not None
    assert row.new_ti / row.new_kp < 0.8 * 240.0 / 2.2
    follows = table_of([spec], objective="setpoint")[0]
    assert run(follows, samples_of(Simulation([spec]).advance(1500.0)))[0].row(0).verdict == "good"
