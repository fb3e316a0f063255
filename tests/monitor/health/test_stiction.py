"""A valve that sticks, told from other oscillations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from monitor.health import stiction
from monitor.health.block import BLOCK_LENGTH
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.specs import LoopSpec, Steps
from tests.monitor.health.cycles import FLOW, LEVEL, health, noise, of_error, simulated
from tests.monitor.health.naive import cycles_of


@pytest.mark.parametrize("plant", [LEVEL, FLOW])
@pytest.mark.parametrize("seed", range(3))
def test_a_sticking_valve_is_told_from_a_sine(plant, seed):
    """On an integrating and on a self-regulating process; noise of a twentieth of the amplitude."""
    stuck = simulated(plant, stiction=1.0, load=Steps((10.0,), (3.3,)), noise=0.02, seed=seed)
    assert stuck.oscillating
    assert stuck.stiction is not None
    assert stuck.stiction > 0.5
    angles = 2 * np.pi * np.arange(25) / 24
    sine = Steps(tuple(np.arange(24) * 60 / 24), tuple(np.diff(3 * np.sin(angles))), 60.0)
    disturbed = simulated(plant, load=sine, noise=0.05, seed=seed)
    assert disturbed.oscillating
    assert disturbed.oscillation_period == pytest.approx(60, rel=0.02)
    assert disturbed.stiction is not None
    assert disturbed.stiction < 0.2


def test_steps_do_not_hide_a_sticking_valve():
    """Steps of set point and load make a few large cycles among the valve's own."""
    times = tuple(np.arange(900.0, 7800.0, 530.0))
    steps = Steps(times, tuple(4.0 * (-1.0) ** i for i in range(len(times))))
    for seed in range(3):
        found = simulated(
            FLOW, stiction=1.0, load=Steps((10.0,), (3.3,)), setpoint=steps, noise=0.04, seed=seed
        )
        assert found.oscillating
        assert found.stiction is not None
        assert found.stiction > 0.5


@pytest.mark.parametrize("shape", ["triangle", "sawtooth", "square", "sine"])
def test_shapes_are_told_apart(shape):
    """In noise of a fifth of their amplitude; the cycles' lengths vary by a tenth."""
    rng = np.random.default_rng(1)
    lengths = rng.normal(50, 5, 200)
    phase = np.concatenate([np.arange(int(n)) / int(n) for n in lengths])
    x = {
        "triangle": 1 - 4 * np.abs(phase - 0.5),
        "sawtooth": np.where(phase < 0.8, phase / 0.4 - 1, (1 - phase) / 0.1 - 1),
        "square": np.sign(phase - 0.5),
        "sine": np.sin(2 * np.pi * phase),
    }[shape]
    found = of_error(x + 0.2 * rng.normal(size=len(x)))
    assert found.oscillating
    assert found.stiction is not None
    assert (found.stiction > 0.5) == (shape in {"sawtooth", "square"}) or shape == "triangle"
    assert shape != "sine" or found.stiction < 0.2


def test_without_an_oscillation_nothing_is_said_of_the_valve():
    """Noise, a walk."""
    assert of_error(noise(5000)).stiction is None
    assert of_error(np.cumsum(noise(5000))).stiction is None


def test_a_limit_cycle_of_the_limits_is_not_the_valves():
    """An unstable loop between its output's limits."""
    spec = LoopSpec(
        "L",
        LEVEL,
        Controller(9.0, 32.0, op_low=40.0, op_high=60.0),
        pv0=50.0,
        op0=50.0,
        load=Steps((10.0,), (3.0,)),
        noise=0.02,
    )
    block = Simulation([spec]).advance(8000)
    found = health(block.sp, block.pv, block.op)
    assert found.oscillating
    assert found.saturation is not None
    assert found.saturation > 0.1
    assert (found.stiction or 0.0) < 0.5


def test_sums_over_cycles_equal_their_naive_twin_at_every_prefix():
    """Cycles of all lengths and shapes: a resonance that noise excites, a sawtooth."""
    w = noise(900)
    swing = lfilter([1], [1, -2 * 0.98 * np.cos(2 * np.pi / 21), 0.98**2], w)
    saw = np.arange(600) % 25 / 12.5 - 1 + 0.05 * noise(600)
    for e in (swing, saw):
        own = np.zeros(1, stiction.DTYPE)[0]
        block = np.zeros(BLOCK_LENGTH)
        for k, value in enumerate(e):
            at = k % BLOCK_LENGTH
            block[at] = value
            stiction.update(own, block, value, at)
            if k % 11 == 0 or k == len(e) - 1:
                for name, expected in cycles_of(e[: k + 1]).items():
                    assert own[name] == pytest.approx(expected, rel=1e-6, abs=1e-9), name
        assert own["cycles"] > 20


def test_cycles_of_one_size_are_alike():
    """The spread of the amplitudes is that of a normal distribution with the same shortest half."""
    rng = np.random.default_rng(0)
    own = np.zeros(1, stiction.DTYPE)[0]
    for spread in (0.1, 0.3):
        classes = np.round(spread * rng.normal(size=4000) / np.log(2) * stiction.CLASSES_PER_OCTAVE).astype(
            int
        )
        own["times"] = np.bincount(classes % stiction.SIZE_CLASSES, minlength=stiction.SIZE_CLASSES)
        assert stiction.spread_of(own) == pytest.approx(spread, rel=0.1)
