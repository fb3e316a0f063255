"""Verdicts: what is flagged and what is not, what the evidence cannot carry, and the words for it.

Of what a historian drew between the values that it kept the model is still right, its intervals are wider.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE, SETPOINT
from monitor.contract.samples import Samples
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.bench.health_archive import interpolated, swinging_door
from tests.monitor.assess.tools import assessed
from tests.support.plants import pi_loop, samples_of, stepped, table_of, times
from tests.support.runs import run

LOOP = Loop(name="L", process="integrating", kp=1.2, ti=200.0, op_low=0, op_high=100, pv_low=0, pv_high=100)
"""Slow for a gain of 0.01 and a dead time of 10 s."""


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
        assert found.gain_lo <= 2.0 <= found.gain_hi < 3.5 * found.gain_lo  # the load may have been no step
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


def recorded(deviation: float, seed: int = 0, noise: float = 0.04) -> Samples:
    """Two set-point steps as an archive gives them back; without a deviation as they were."""
    sp = np.full(10_000, 50.0)
    sp[2000:6000] += 6.0
    pv, op = pi_loop(sp, kp=1.2, ti=200.0, gain=0.01, dead=10, noise=noise, seed=seed)
    if deviation > 0:
        pv, op = (interpolated(x, swinging_door(x, deviation)) for x in (pv, op))
    return Samples.of(0, times(len(sp)), sp, pv, op)


@pytest.mark.parametrize("deviation", [0.08, 0.12])
@pytest.mark.parametrize("seed", range(2))
def test_a_compressed_loop_is_judged_and_named(deviation, seed):
    """The flag stays, the words say so, the true gain is inside, and nothing is withheld for it alone."""
    engine, seen = run(LOOP, recorded(deviation, seed))
    assert [a.amplitude for a in seen.assessments] == [6.0, -6.0]
    assert all(a.gain_lo < 0.01 < a.gain_hi for a in seen.assessments)
    row = engine.row(0)
    assert "compressed" in row.flags
    assert "the historian compressed these data" in row.reason
    assert "intervals are wider" in row.reason
    assert row.verdict != INCONCLUSIVE


@pytest.mark.parametrize("deviation", [0.2, 0.3])
@pytest.mark.parametrize("seed", range(2))
def test_what_is_left_of_little_is_not_made_much_of(deviation, seed):
    """Where the deviation is a twentieth of the step, the gain comes out too low: no settings beyond safe ones."""
    engine, _ = run(LOOP, recorded(deviation, seed))
    row = engine.row(0)
    assert "compressed" in row.flags
    assert row.verdict == INCONCLUSIVE or row.new_kp is None or row.new_kp < 5.0  # SIMC's, at tc = dead time


def test_its_intervals_are_wider():
    """Than on the data as they were, by the model's mismatch at least."""
    widths = []
    for deviation in (0.0, 0.2):
        _, seen = run(LOOP, recorded(deviation))
        steps = [a for a in seen.assessments if a.kind == SETPOINT]
        widths.append([a.gain_hi / a.gain_lo for a in steps])
    assert all(wide > 1.3 * narrow - 0.3 for narrow, wide in zip(*widths, strict=True))
    assert min(widths[1]) > np.exp(2 * 1.96 * 0.02)
