"""Verdicts: what is flagged and what is not, what the evidence cannot carry, and the words for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, RETUNE
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.monitor.assess.tools import assessed
from tests.support.plants import samples_of, stepped, table_of
from tests.support.runs import run


def test_a_good_loop():
    """Fast and robust: `good`, without a word, with an index near 1."""
    found, _, _ = assessed(stepped(noise=0.02))
    assert (found.verdict, found.reason) == (GOOD, "")
    assert found.process == "integrating"
    assert found.ci is not None
    assert 0.8 < found.ci < 1.2
    assert found.ms is not None
    assert 1.4 < found.ms < 2.2
    assert found.gain == pytest.approx(0.05, rel=0.03)
    assert found.coverage == pytest.approx(1.0)


def test_a_sluggish_loop():
    """A fifth of the gain: `retune` for speed, the index in the reason."""
    found, _, _ = assessed(stepped(4000, kp=0.4, ti=300.0, noise=0.02), kp=0.4, ti=300.0)
    assert found.verdict == RETUNE
    assert found.ci is not None
    assert found.ci < 0.4
    assert f"CI_sp = {found.ci:.2f}" in found.reason
    assert "instability" not in found.reason


def test_an_aggressive_loop():
    """Close to instability: `retune` for robustness, whatever the speed."""
    found, _, _ = assessed(stepped(kp=4.4, ti=20.0, noise=0.02), kp=4.4, ti=20.0)
    assert found.verdict == RETUNE
    assert "instability" in found.reason
    assert found.ms is not None
    assert found.ms > 2.75


def test_a_rolling_loop_is_told_the_integral_too_strong():
    """Too much integral action for the gain: the cure is a longer Ti or a higher gain, not a lower one."""
    found, _, _ = assessed(stepped(3000, kp=0.4, ti=30.0, noise=0.02), kp=0.4, ti=30.0)
    assert found.verdict == RETUNE
    assert "a lower gain makes it worse" in found.reason
    assert "Kc K Ti = 0.6" in found.reason


def test_a_direct_acting_loop():
    """Negative gains on both sides are as good as positive ones."""
    samples = stepped(noise=0.02)
    found, _, _ = assessed(replace(samples, op=100 - samples.op), kp=-2.0)
    assert found.verdict == GOOD
    assert found.gain == pytest.approx(-0.05, rel=0.03)


def test_a_load_step_on_a_self_regulating_loop():
    """Shows its gain, the load's size and when it came; the loop is told that it is slow, its kind given or not."""
    plant = Plant("self-regulating", 2.0, 5.0, (40.0, 6.0))
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=Controller(0.6, 46.0),
        load=Steps((150.4,), (5.0,)),
        noise=0.02,
        seed=1,
    )
    samples = samples_of(Simulation([spec]).advance(1800.0))
    for process in ("self-regulating", "auto"):
        engine, seen = run(Loop(name="L", kp=0.6, ti=46.0, process=process), samples)
        (found,) = seen.assessments
        assert (found.kind, found.process, found.verdict) == ("load", "self-regulating", RETUNE)
        assert "slow to recover" in found.reason
        assert found.gain_lo is not None
        assert found.gain_hi is not None
        assert found.gain_lo <= 2.0 <= found.gain_hi < 2.0 * found.gain_lo
        assert found.amplitude == pytest.approx(5.0, rel=0.05)
        assert (found.start - int(samples.time[0])) / 1e9 == pytest.approx(150.4, abs=5.0)
        new = engine.row(0)
        assert new.new_kp is not None
        assert new.new_kp > 0.6


def test_a_loop_without_settings_has_those_of_the_data():
    """The table says nothing of the controller: its settings are seen in what it does, and so is its robustness."""
    samples = stepped(noise=0.02)
    (unknown, _, _), (known, _, _) = assessed(samples, kp=None, ti=math.inf), assessed(samples)
    assert unknown.ms == pytest.approx(known.ms, rel=0.02)
    assert unknown.ci is not None


def test_a_loop_whose_controller_is_not_seen_has_no_ms():
    """Half of OP comes from somewhere else: the index is given, Ms is not."""
    samples = stepped(noise=0.02)
    rng = np.random.default_rng(3)
    wandering = replace(samples, op=samples.op + np.cumsum(rng.normal(0.0, 0.3, len(samples))))
    found, _, _ = assessed(wandering, kp=None, ti=math.inf)
    assert found.ms is None


def test_a_load_beside_a_set_point_step_leaves_no_index():
    """The model is found in spite of it, but the error is not the step's alone."""
    plant = Plant("integrating", 0.05, 4.0)
    spec = LoopSpec(
        "L",
        plant,
        Controller(2.0, 40.0),
        setpoint=Steps((200.0,), (4.0,)),
        load=Steps((240.3,), (6.0,)),
        noise=0.01,
    )
    _, seen = run(table_of([spec])[0], samples_of(Simulation([spec]).advance(900.0)))
    record = seen.assessments[0]
    assert record.kind == "setpoint"
    assert record.ci is None
    assert record.gain == pytest.approx(0.05, rel=0.1)
