"""Oscillation and stiction: what swings on is found, with its period; what passes, wanders or fades is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.health.autocorrelation import BLOCK, LAGS
from monitor.health.loop_health import Health, figures
from monitor.health.oscillation import cycle
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.support.plants import SECOND, START

Array = NDArray[np.float64]
LEVEL = Plant("integrating", 0.05, 4.0)
FLOW = Plant("self-regulating", 1.0, 3.0, (8.0,))
GOOD = {LEVEL: Controller(2.5, 32.0), FLOW: Controller(0.8, 8.0)}


def noise(n: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=n)


def health(sp: object, pv: object, op: object, period: float = 1.0) -> Health:
    n = max(np.size(v) for v in (sp, pv, op))
    time = START + np.round(np.arange(n) * period * SECOND).astype(np.int64)
    detector = Detector([Loop(name="L")])
    detector.run(Samples.of(0, time, *(np.broadcast_to(v, (n,)) for v in (sp, pv, op))))
    return figures(detector.health[0], float(detector.state["period"][0]))


def of_error(e: Array, period: float = 1.0) -> Health:
    """Figures of a loop with this error, under a P controller."""
    return health(50.0, 50.0 - e, 30.0 + e, period)


def simulated(plant: Plant, n: int = 8000, **facts: object) -> Health:
    spec = LoopSpec("L", plant, GOOD[plant], pv0=50.0, op0=50.0, **facts)  # type: ignore[arg-type]
    block = Simulation([spec]).advance(n)
    return health(block.sp, block.pv, block.op)


# -- oscillation ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("cycle_time", [6, 9, 15.5, 20.6, 21, 40, 83, 84, 300, 1000, 2500])
@pytest.mark.parametrize("ratio", [1.5, 20.0])
def test_a_sine_is_found_with_its_period(cycle_time, ratio):
    """From six samples to thousands, in noise up to two thirds of its amplitude; at gaps between two levels too."""
    n = 20_000 if cycle_time < 1000 else 100_000
    e = ratio * np.sin(2 * np.pi * np.arange(n) / cycle_time) + noise(n)
    found = of_error(e, 2.0)
    assert found.oscillating
    assert found.oscillation_period == pytest.approx(2.0 * cycle_time, rel=0.02)
    assert found.oscillation_regularity is not None
    assert found.oscillation_regularity > 0.75


@pytest.mark.parametrize("every", [2, 5, 10])
@pytest.mark.parametrize("kind", ["sine in noise", "limit cycle"])
def test_the_period_is_the_same_at_any_sampling(kind, every):
    """Of a sine in noise of half its amplitude; of a sticking valve in a slow loop, whose cycles are uneven."""
    if kind == "sine in noise":
        sp: object = 50.0
        pv = 50.0 + np.sin(2 * np.pi * np.arange(60_000) / 430) + 0.5 * noise(60_000)
        op = 100.0 - pv
    else:
        slow = Plant("self-regulating", 1.0, 60.0, (160.0,))
        valve = LoopSpec(
            "L", slow, Controller(0.8, 160.0), pv0=50.0, op0=50.0, stiction=1.0, load=Steps((10.0,), (3.3,))
        )
        block = Simulation([replace(valve, noise=0.05)]).advance(100_000)
        sp, pv, op = block.sp[::every], block.pv, block.op
        assert health(block.sp, pv, op).stiction == pytest.approx(1, abs=0.5)
    reference = health(50.0, pv, op)
    seen = health(sp, pv[::every], op[::every], float(every))
    assert reference.oscillation_period is not None
    assert seen.oscillation_period == pytest.approx(reference.oscillation_period, rel=0.05)
    assert kind != "sine in noise" or seen.oscillation_period == pytest.approx(430, rel=0.02)


def test_a_new_sample_period_begins_anew():
    """A cycle's length in samples changes with it; nothing of the old is mixed in."""
    wave = np.sin(2 * np.pi * np.arange(30_000) / 200) + 0.2 * noise(30_000)
    e = np.concatenate([wave, wave[::5]])
    time = START + np.concatenate([np.arange(30_000), 30_000 + 5 * np.arange(6000)]) * SECOND
    detector = Detector([Loop(name="L")])
    detector.run(Samples.of(0, time, np.full(len(e), 50.0), 50.0 - e, 30.0 + e))
    found = figures(detector.health[0], float(detector.state["period"][0]))
    assert found.oscillation_period == pytest.approx(200, rel=0.03)


def test_an_oscillation_is_found_after_some_cycles():
    """Not in four, but in fifteen."""
    e = np.sin(2 * np.pi * np.arange(300) / 20) + 0.1 * noise(300)
    assert not of_error(e[:70]).oscillating
    assert of_error(e).oscillating


def test_an_oscillation_on_a_ramp_and_an_offset_is_found():
    """The trend of each block is taken away."""
    t = np.arange(5000)
    found = of_error(40 + 0.01 * t + np.sin(2 * np.pi * t / 50) + 0.3 * noise(5000))
    assert found.oscillation_period == pytest.approx(50, rel=0.02)


@pytest.mark.parametrize("n", [300, 1000, 5000, 30_000])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "kind", ["white", "walk", "double walk", "lag", "long lag", "ramp", "walk in noise", "constant", "damped"]
)
def test_what_does_not_swing_on_is_no_oscillation(kind, seed, n):
    """Noise of any colour, walks, ramps; a resonance as damped as that of a loop with Ms 1.6."""
    w = noise(n, seed)
    damped = np.exp(-0.4 * 2 * np.pi / 30)
    e = {
        "white": w,
        "walk": np.cumsum(w),
        "double walk": np.cumsum(np.cumsum(w)),
        "lag": lfilter([1], [1, -0.9], w),
        "long lag": lfilter([1], [1, -0.99], w),
        "ramp": 0.01 * np.arange(n) + 0.1 * w,
        "walk in noise": 0.3 * np.cumsum(w) + noise(n, seed + 100),
        "constant": np.zeros(n),
        "damped": lfilter([1], [1, -2 * damped * np.cos(0.92 * 2 * np.pi / 30), damped**2], w),
    }[kind]
    assert not of_error(e).oscillating


def test_decaying_responses_are_no_oscillation():
    """To a load step now and then; nor regular pulses."""
    t = np.arange(8000)
    ringing = np.exp(-(t % 1000) / 100) * np.sin(2 * np.pi * t / 40)
    assert not of_error(ringing + 0.02 * noise(8000)).oscillating
    pulses = (t % 200 < 12) - 1.0 * ((t + 100) % 200 < 12)
    assert not of_error(pulses + 0.02 * noise(8000)).oscillating


@pytest.mark.parametrize("plant", [LEVEL, FLOW])
def test_healthy_loops_do_not_oscillate(plant):
    """In noise, under a wandering load, with steps of the set point at irregular times, with regular ones."""
    irregular = Steps((900.0, 2050.0, 2600.0, 4700.0, 6300.0), (5.0, -5.0, 4.0, -8.0, 4.0))
    regular = Steps((200.0, 400.0), (5.0, -5.0), 400.0)
    for seed in range(3):
        assert not simulated(plant, noise=0.1, seed=seed).oscillating
        assert not simulated(plant, noise=0.1, wander=0.1, seed=seed).oscillating
        assert not simulated(plant, noise=0.1, wander=0.02, setpoint=irregular, seed=seed).oscillating
        assert not simulated(plant, noise=0.1, setpoint=regular, seed=seed).oscillating


def test_a_quantised_pv_that_flips_is_no_oscillation():
    """Between two neighbouring values."""
    pv = np.round(50.45 + 0.1 * np.sin(2 * np.pi * np.arange(4000) / 40) + 0.02 * noise(4000))
    assert not health(50.0, pv, 30.0 - 0.01 * np.cumsum(pv - 50.45)).oscillating


def test_the_cycle_in_an_exact_autocorrelation():
    """The shortest of all periods that fit, and how it fades."""
    lags = np.arange(LAGS)
    for period in (5.0, 7.3, 12.0, 20.0):
        found, strength, fading = cycle(np.cos(2 * np.pi * lags / period))
        assert found == pytest.approx(period, rel=0.02)
        assert strength == pytest.approx(1, abs=0.05)
        assert fading == pytest.approx(1, abs=0.05)
    half = 0.5 ** (lags / 12.0) * np.cos(2 * np.pi * lags / 12.0)
    assert cycle(half)[2] == pytest.approx(0.5, abs=0.03)
    assert cycle(np.cos(2 * np.pi * lags / 3.0))[0] == 0
    assert cycle(np.cos(2 * np.pi * lags / (2 * BLOCK)))[0] == 0


# -- stiction ------------------------------------------------------------------------------------------


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
