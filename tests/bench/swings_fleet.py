"""Records with a known truth: swings of some cycles, healthy loops, outputs without an answer, moves of set points.

- *swings*: an error of white noise (a third with as much of coloured noise) with some cycles of a sine, square,
  sawtooth or triangle, the noise 0.1 to 0.4 of the amplitude; alone in a record that just holds them, or in a longer
  one; in bursts that take a share of the record.
- *healthy*: tuned PI on integrating and self-regulating processes (`health_fleet`), under white noise, a coloured or a
  randomly walking load, irregular steps of load and set point, and a set point that goes to and fro.
- *shut*: a PI loop whose PV no longer follows: it wanders a little, away from its set point, while OP integrates.
- *moves*: set points of tuned, of ringing and of crawling loops, and of loops whose valve sticks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.margins import at_sensitivity, margin
from sim_plants.plants import Plant
from sim_plants.settings import robust_simc
from sim_plants.specs import LoopSpec, Steps
from tests.bench.health_fleet import log_uniform, with_steps

Array = NDArray[np.float64]
SHAPES = ("sine", "square", "sawtooth", "triangle")
LOADS = ("white", "coloured", "walk", "steps", "to and fro")
MOVES = ("tuned", "ringing", "crawling", "sticking")
BLOCK = 1024


@dataclass(frozen=True)
class Record:
    """Samples of one loop, a second apart."""

    sp: Array
    pv: Array
    op: Array
    noise: float = 0.0
    """Standard deviation of PV's white noise [PV]."""


@dataclass(frozen=True)
class Swing:
    """An error that swings for some of its time."""

    error: Array
    spans: tuple[tuple[int, int], ...]
    period: float
    amplitude: float


def wave(shape: str, phase: Array) -> Array:
    """Return a wave of amplitude 1 at phases [cycles]."""
    part = phase % 1.0
    return {
        "sine": np.sin(2 * np.pi * part),
        "square": np.where(part < 0.5, 1.0, -1.0),
        "sawtooth": 2.0 * part - 1.0,
        "triangle": 1.0 - 4.0 * np.abs(part - 0.5),
    }[shape]


def swing(rng: np.random.Generator, shape: str, cycles: float, within: bool) -> Swing:
    """Draw an error with so many cycles, ``within`` a record up to five times as long or filling it."""
    period = log_uniform(rng, 6.0, 100.0)
    length = math.ceil(cycles * period)
    if length < 60:
        period, length = 60.0 / cycles, 60
    n = min(max(int(length * rng.uniform(1.5, 5.0)), length), max(BLOCK, length)) if within else length
    start = int(rng.integers(0, n - length + 1))
    return _swinging(rng, shape, n, ((start, start + length),), period)


def bursts(rng: np.random.Generator, shape: str, share: float) -> Swing:
    """Draw an error that swings for a share of a block, in one or two bursts of at least eight cycles."""
    count = int(rng.integers(1, 3))
    length = int(share * BLOCK / count)
    period = log_uniform(rng, 5.0, length / 8.0)
    slot = BLOCK // count
    starts = [k * slot + int(rng.integers(0, slot - length)) for k in range(count)]
    return _swinging(rng, shape, BLOCK, tuple((s, s + length) for s in starts), period)


def _swinging(
    rng: np.random.Generator, shape: str, n: int, spans: tuple[tuple[int, int], ...], period: float
) -> Swing:
    error = rng.uniform(0.1, 0.4) * _noise(rng, n)
    amplitude = log_uniform(rng, 0.1, 10.0)
    for start, end in spans:
        error[start:end] += wave(shape, rng.random() + np.arange(end - start) / period)
    return Swing(error * amplitude, spans, period, amplitude)


def _noise(rng: np.random.Generator, n: int) -> Array:
    """White, or half of its power coloured."""
    white = rng.normal(size=n)
    if rng.random() > 1 / 3:
        return white
    keep = math.exp(-1.0 / log_uniform(rng, 2.0, 30.0))
    other = lfilter([math.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=n + 200))[200:]
    return np.asarray(math.sqrt(0.5) * (white + other))


def plant_of(rng: np.random.Generator, integrating: bool, fastest: float = 2.0) -> Plant:
    """Draw a process of 2 to 12 seconds dead time."""
    dead_time = log_uniform(rng, fastest, 12.0)
    count = int(rng.integers(0 if integrating else 1, 3))
    ratio = (0.2, 2.0) if integrating else (0.5, 6.0)
    lags = tuple(dead_time * log_uniform(rng, *ratio) for _ in range(count))
    gain = 0.2 / dead_time if integrating else 1.0
    process = "integrating" if integrating else "self-regulating"
    return Plant(process, gain * float(rng.choice([-1.0, 1.0])), dead_time, lags)


def tuned(rng: np.random.Generator, plant: Plant) -> Controller:
    """Draw PI settings with a peak sensitivity of at most 2."""
    base = robust_simc(plant, 1.0)
    slower = replace(base, kp=base.kp * log_uniform(rng, 0.5, 1.0))
    if plant.integrating:  # a lower gain with the same reset would roll
        slower = replace(slower, ti=slower.ti * base.kp / slower.kp)
    return slower if margin(plant, slower, 1.0).ms <= 2.0 else base


def healthy(rng: np.random.Generator, load: str, n: int = BLOCK) -> Record:
    """Draw a healthy loop under a kind of load, seen every 1 to 6 seconds as averages."""
    plant = plant_of(rng, bool(rng.random() < 0.5))
    spec = LoopSpec("x", plant, tuned(rng, plant), pv0=50.0, op0=50.0, seed=int(rng.integers(2**62)))
    width = int(rng.choice([1, 1, 2, 4, 6]))
    total = n * width + 300
    effect = _spread(replace(spec, wander=1.0))
    wander = 0.1 * log_uniform(rng, 0.5, 10.0) / effect
    spec = replace(spec, noise=0.1)
    if load == "coloured":
        t0 = plant.dead_time + sum(plant.lags)
        spec = replace(spec, wander=wander, wander_time=t0 * log_uniform(rng, 0.5, 20.0))
    elif load != "white":
        spec = replace(spec, wander=wander if load == "walk" else 0.2 * wander)
    if load == "steps":
        spec = _stepped(rng, spec, total)
    if load == "to and fro":
        half = log_uniform(rng, 3.0, 30.0) * (plant.dead_time + sum(plant.lags))
        size = 0.1 * log_uniform(rng, 5.0, 50.0)
        spec = replace(spec, setpoint=Steps((half, 2 * round(half)), (size, -size), 2.0 * round(half)))
    return record(spec, total, width, 300)


def record(spec: LoopSpec, total: int, width: int = 1, skip: int = 0) -> Record:
    """Simulate a loop, and average so many samples into one."""
    block = Simulation([spec]).advance(total)
    columns = [np.asarray(c[skip:], dtype=float) for c in (block.sp, block.pv, block.op)]
    m = len(columns[0]) // width * width
    sp, pv, op = (c[:m].reshape(-1, width).mean(axis=1) for c in columns)
    return Record(sp, pv, op, spec.noise / math.sqrt(width))


def _spread(spec: LoopSpec) -> float:
    block = Simulation([spec]).advance(4000)
    return float(np.std(block.sp[1000:] - block.pv[1000:]))


def _stepped(rng: np.random.Generator, spec: LoopSpec, total: int) -> LoopSpec:
    return with_steps(rng, spec, int(rng.integers(1, 7)), (50, total - 50))


def shut(rng: np.random.Generator) -> Record:
    """Draw a loop whose PV does not follow: noise, a wandering of up to a fifth of the error, a constant error."""
    n = int(rng.integers(300, BLOCK))
    error = float(rng.choice([-1.0, 1.0]))
    noise = log_uniform(rng, 0.02, 0.15)
    walk = np.cumsum(rng.normal(size=n))
    walk *= rng.uniform(0.0, 0.2) / max(float(np.max(np.abs(walk))), 1e-9)
    pv = 50.0 - error + noise * rng.normal(size=n) + walk
    kp = float(rng.choice([-1.0, 1.0])) * log_uniform(rng, 0.2, 3.0)
    ti = log_uniform(rng, 10.0, 200.0)
    e = 50.0 - pv
    op = 50.0 + kp * (e + np.cumsum(e) / ti)
    return Record(np.full(n, 50.0), pv, op, noise)


def ramped_load(rng: np.random.Generator) -> Record:
    """Draw a healthy loop under a load that ramps: a constant error, small or not, that OP follows."""
    plant = plant_of(rng, bool(rng.random() < 0.5))
    controller = tuned(rng, plant)
    times = np.arange(100.0, BLOCK, 4.0)
    slope = log_uniform(rng, 0.002, 0.02) * rng.choice([-1.0, 1.0])
    load = Steps(tuple(times), tuple(np.full(len(times), 4.0 * slope)))
    seed = int(rng.integers(2**62))
    return record(
        LoopSpec("x", plant, controller, pv0=50.0, op0=50.0, load=load, noise=0.1, seed=seed), BLOCK
    )


def moves(rng: np.random.Generator, kind: str) -> Record:
    """Draw a loop whose set point moves two to five times, by 12 to 80 deviations of PV's noise."""
    integrating = kind in ("ringing", "sticking") and bool(rng.random() < 0.5)
    plant = Plant("self-regulating", float(rng.choice([-1.0, 1.0])), log_uniform(rng, 0.2, 2.0), (3.0,))
    controller = robust_simc(plant, 1.0, ms=1.5)
    if kind != "tuned":
        plant = plant_of(rng, integrating, 1.0)
        controller = tuned(rng, plant)
    if kind == "ringing":
        controller = at_sensitivity(plant, controller, 1.0, log_uniform(rng, 3.5, 8.0))
    if kind == "crawling":
        controller = replace(
            controller, kp=0.1 * controller.kp, ti=controller.ti * log_uniform(rng, 1.0, 4.0)
        )
    count = int(rng.integers(2, 6))
    gap = (BLOCK - 150) // count
    times = tuple(float(100 + k * gap + rng.integers(0, gap // 4)) for k in range(count))
    size = 0.1 * log_uniform(rng, 12.0, 80.0)
    sizes = tuple(size * rng.choice([-1.0, 1.0], count) * rng.uniform(0.7, 1.0, count))
    spec = LoopSpec("x", plant, controller, pv0=50.0, op0=50.0, setpoint=Steps(times, sizes), noise=0.1)
    if kind == "sticking":
        own = abs(plant.gain) * (plant.dead_time if integrating else 1.0)
        spec = replace(spec, stiction=size / own * rng.uniform(0.5, 2.0))
    return record(replace(spec, seed=int(rng.integers(2**62))), BLOCK)
