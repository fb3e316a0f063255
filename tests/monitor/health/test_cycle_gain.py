"""The gain of an integrating process from its own cycle, against the plant that made it."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from monitor.health import cycle_gain as own
from monitor.health.cycle_gain import CycleGain, cycle_gain
from sim_plants.controllers import Controller
from sim_plants.loops import Block, Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.monitor.health.cycles import noise
from tests.support.places import SHARED

CASES = SHARED / "cases"


def rolling(plant: Plant, noise_sd: float, seed: int) -> Block:
    """Run a PI loop whose integral is so strong that its cycle grows to its output's limits."""
    ti = 0.95 * plant.dead_time
    controller = Controller(0.1 / (plant.gain * ti), ti, op_low=45.0, op_high=55.0)
    load = Steps((20.0,), (2.0,))
    spec = LoopSpec("x", plant, controller, pv0=50.0, op0=50.0, load=load, noise=noise_sd, seed=seed)
    return Simulation([spec]).advance(12_000)


def judged(block: Block, width: int) -> CycleGain | None:
    """Look at the last thousand averages of so many samples."""
    pv, op = (
        np.asarray(c, dtype=float)[-1000 * width :].reshape(-1, width).mean(axis=1)
        for c in (block.pv, block.op)
    )
    return cycle_gain(pv, op, float(width))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("noise_sd", [0.0, 0.1])
@pytest.mark.parametrize("dead_time", [8.0, 20.0])
def test_the_gain_of_a_rolling_level_is_the_plants(sign: float, noise_sd: float, dead_time: float) -> None:
    plant = Plant("integrating", sign * 0.01, dead_time)
    found = judged(rolling(plant, noise_sd, seed=4), int(dead_time / 4))
    assert found is not None
    assert found.integrating
    assert found.gain == pytest.approx(plant.gain, rel=0.1)
    assert found.gain_lo < found.gain < found.gain_hi
    assert found.gain_hi - found.gain_lo < 0.4 * abs(found.gain)
    assert found.dead_time == pytest.approx(dead_time + 0.5, rel=0.25)


def test_it_is_exact_where_pv_is_the_integral_of_op() -> None:
    t = np.arange(800)
    omega, gain = 2 * np.pi / 80.0, 0.02
    op = 3.0 * np.sin(omega * t / 1.0)
    pv = 50.0 - gain / omega * 5.0 * 3.0 * np.cos(omega * t)
    found = cycle_gain(pv, 40.0 + op, 5.0)
    assert found is not None
    assert found.gain == pytest.approx(gain, rel=0.01)
    assert found.phase == pytest.approx(-math.pi / 2, abs=0.02)
    assert found.period == pytest.approx(400.0, rel=0.005)
    assert found.op_amplitude == pytest.approx(3.0, rel=0.01)
    assert found.cycles in (9, 10)


@pytest.mark.parametrize("length", [4.0, 6.3, 40.0])
def test_harmonics_are_those_of_least_squares(length: float) -> None:
    x = np.sin(2 * np.pi * np.arange(200) / length) + noise(200)
    harmonics, share = own._harmonics(x, length)
    first, whole = 0.0, 0.0
    for k, found in enumerate(harmonics):
        at = np.arange(round(k * length), min(round((k + 1) * length), 200))
        line = np.stack([np.ones(len(at)), at - at.mean()], axis=1)
        wave = np.stack([np.cos(2 * np.pi * at / length), np.sin(2 * np.pi * at / length)], axis=1)
        b = np.linalg.lstsq(np.hstack([line, wave]), x[at], rcond=None)[0]
        assert found == pytest.approx(complex(b[2], -b[3]), rel=1e-9)
        first += np.sum((wave @ b[2:]) ** 2)
        whole += len(at) * np.var(x[at] - line @ b[:2])
    assert share == pytest.approx(first / whole)
    assert len(harmonics) == int(200.5 / length)


def test_the_strongest_period_is_that_of_the_transform() -> None:
    tried = np.linspace(30.0, 50.0, 61)
    x = np.sin(2 * np.pi * np.arange(300) / 37.0) + noise(300)
    power = np.abs(np.exp(-2j * np.pi * np.outer(1.0 / tried, np.arange(300))) @ x)
    assert own._strongest(x, 2.0 * np.pi / tried) == np.argmax(power)


def test_the_interval_covers_the_truth_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    t, inside, n = np.arange(400), 0, 120
    for _ in range(n):
        op = np.sin(2 * np.pi * t / 40) + 0.1 * rng.normal(size=400)
        pv = -np.cos(2 * np.pi * t / 40) + 0.3 * rng.normal(size=400)
        found = cycle_gain(pv, op, 1.0)
        assert found is not None
        inside += found.gain_lo <= 2 * np.pi / 40 <= found.gain_hi
    assert 0.87 <= inside / n <= 1.0


def test_a_phase_that_no_integrator_has_is_said() -> None:
    t = np.arange(800)
    op = np.sin(2 * np.pi * t / 80)
    for lead, fits in ((-0.6, True), (0.6, True), (-0.2, False), (-0.1, False), (0.4, False)):
        pv = np.sin(2 * np.pi * (t / 80) + math.pi * lead)
        found = cycle_gain(pv, op, 1.0)
        assert found is not None
        if lead in (-0.6, -0.2, -0.1):
            assert found.integrating == fits, lead


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_units_of_pv_and_op_scale_the_gain(scale: float) -> None:
    t = np.arange(600)
    pv, op = np.cos(2 * np.pi * t / 50) + 0.05 * noise(600), np.sin(2 * np.pi * t / 50)
    one, other = cycle_gain(pv, op, 2.0), cycle_gain(scale * pv + 7.0, -op, 2.0)
    assert one is not None
    assert other is not None
    assert other.gain == pytest.approx(-scale * one.gain, rel=1e-6)
    assert (other.gain_hi - other.gain_lo) == pytest.approx(scale * (one.gain_hi - one.gain_lo), rel=1e-6)


def test_without_a_cycle_in_both_there_is_no_gain() -> None:
    t = np.arange(600)
    wave = np.sin(2 * np.pi * t / 50)
    assert cycle_gain(noise(600), wave, 1.0) is None
    assert cycle_gain(wave, noise(600), 1.0) is None
    assert cycle_gain(wave, np.full(600, 30.0), 1.0) is None
    assert cycle_gain(wave[:100], wave[:100], 1.0) is None
    missing = wave.copy()
    missing[7] = np.nan
    assert cycle_gain(wave, missing, 1.0) is None
    assert cycle_gain(missing, wave, 1.0) is None


@pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is not there")
@pytest.mark.parametrize(
    ("case", "loop", "period", "width", "gain"),
    [
        ("fryer-level-cycle", "FRYER-cycle", 10.0, 2, 5e-4),
        ("evaporator-cycle", "EVAP-cycle", 1.0, 2, 0.145 / 3.0),
        ("evaporator-cycle", "EVAP-tiwrong", 1.0, 2, 0.145 / 3.0),
    ],
)
def test_cycles_of_the_field_show_the_gain(
    case: str, loop: str, period: float, width: int, gain: float
) -> None:
    frame = pd.read_csv(CASES / case / "data.csv")
    own = frame[frame.loop == loop]
    if loop == "EVAP-tiwrong":
        period = 2.0
    m = len(own) // width * width
    pv, op = (own[c].to_numpy(float)[:m].reshape(-1, width).mean(axis=1) for c in ("pv", "op"))
    found = cycle_gain(pv, op, period * width)
    assert found is not None
    assert found.integrating
    assert found.gain == pytest.approx(gain, rel=0.2)
