"""Loops with a known state of health: healthy, with a sticking valve, under a sinusoidal load, or tuned to the brink.

One draw is one loop, integrating or self-regulating, of 8,000 samples with 2 to 12 samples in a dead time. All draws
are logarithmic. Noise is white; what drives a loop is scaled by a run without noise, so that its amplitude is known.

- *healthy*: Ms at most 2; noise, a wandering load of 0.2 to 10 times the noise's effect, and (in two of three) steps
  of set point and load of 5 to 40 sigma at irregular times.
- *sticking*: the same loop behind a valve that sticks, where that ends in a limit cycle; amplitude 2.5 to 40 sigma.
- *sinusoidal load*: the same loop under a sine (in 24 stairs) of 12 to 100 samples; amplitude 2 to 40 sigma.
- *aggressive*: the gain raised until the loop is unstable, held by the limits of its output; or until Ms is 10 to 20,
  driven by the noise and a wandering load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_plants.controllers import Controller
from sim_plants.loops import Block, Simulation
from sim_plants.margins import at_sensitivity, margin
from sim_plants.plants import Plant, Process
from sim_plants.settings import robust_simc
from sim_plants.specs import LoopSpec, Steps

CLASSES = ("healthy", "sticking", "sinusoidal", "aggressive")
SAMPLES = 8000
STAIRS = 24
"""A sine in so many stairs has 4 % of ripple, far above the loop's bandwidth."""
LEAST_CYCLES = 15


@dataclass(frozen=True)
class Case:
    """A loop, its samples, and what is wrong with it."""

    truth: str
    spec: LoopSpec
    block: Block
    ratio: float
    """Amplitude over noise; for a healthy loop that of the wander's effect."""


def draw(truth: str, process: Process, number: int, seed: int) -> Case:
    """Draw one loop; the same arguments give the same loop."""
    rng = np.random.default_rng([seed, number, CLASSES.index(truth), process == "integrating"])
    while True:
        plant = _plant(rng, process)
        controller = _healthy(rng, plant)
        spec = LoopSpec("x", plant, controller, pv0=50.0, op0=50.0, seed=int(rng.integers(2**62)))
        case = {"healthy": _quiet, "sticking": _sticking, "sinusoidal": _sine, "aggressive": _brink}[truth](
            rng, spec
        )
        if case is not None:
            spec, ratio = case
            return Case(truth, spec, Simulation([spec]).advance(SAMPLES), ratio)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _plant(rng: np.random.Generator, process: Process) -> Plant:
    dead_time = log_uniform(rng, 2.0, 12.0)
    count = int(rng.integers(0 if process == "integrating" else 1, 3))
    ratio = (0.2, 2.0) if process == "integrating" else (0.5, 6.0)
    lags = tuple(dead_time * log_uniform(rng, *ratio) for _ in range(count))
    gain = 0.2 / dead_time if process == "integrating" else 1.0
    return Plant(process, gain * float(rng.choice([-1.0, 1.0])), dead_time, lags)


def _healthy(rng: np.random.Generator, plant: Plant) -> Controller:
    derivative = plant.integrating and bool(rng.random() < 0.2)
    base = robust_simc(plant, 1.0, derivative)
    slower = replace(base, kp=base.kp * log_uniform(rng, 0.5, 1.0))
    if plant.integrating:  # a lower gain with the same reset would roll
        slower = replace(slower, ti=slower.ti * base.kp / slower.kp)
    return slower if margin(plant, slower, 1.0).ms <= 2.0 else base


def _error(spec: LoopSpec, last: float = 0.5) -> NDArray[np.float64]:
    """Error of the last part of a run."""
    block = Simulation([spec]).advance(SAMPLES)
    e: NDArray[np.float64] = block.sp - block.pv
    return e[int(len(e) * (1 - last)) :]


def _disturbed(rng: np.random.Generator, spec: LoopSpec, share: float) -> LoopSpec:
    """Add steps of set point and load at irregular times, in a share of the loops."""
    if rng.random() > share:
        return spec
    return with_steps(rng, spec, int(rng.integers(2, 12)), (300, SAMPLES - 300))


def with_steps(rng: np.random.Generator, spec: LoopSpec, n: int, between: tuple[int, int]) -> LoopSpec:
    """Add as many steps of set point, and of load, at irregular times ``between`` two samples."""
    times = np.sort(rng.choice(np.arange(*between), 2 * n, replace=False)).astype(float)
    kinds = rng.permutation(2 * n) < n
    size = spec.noise * log_uniform(rng, 5.0, 40.0)
    up = size * rng.choice([-1.0, 1.0], n) * rng.uniform(0.5, 1.0, n)
    load = size * abs(spec.controller.kp) * rng.choice([-1.0, 1.0], n) * rng.uniform(0.5, 1.0, n)
    return replace(
        spec, setpoint=Steps(tuple(times[kinds]), tuple(up)), load=Steps(tuple(times[~kinds]), tuple(load))
    )


def _quiet(rng: np.random.Generator, spec: LoopSpec) -> tuple[LoopSpec, float]:
    effect = float(np.std(_error(replace(spec, wander=1.0))))
    ratio = log_uniform(rng, 0.2, 10.0)
    return _disturbed(rng, replace(spec, noise=0.1, wander=0.1 * ratio / effect), 0.67), ratio


def _sticking(rng: np.random.Generator, spec: LoopSpec) -> tuple[LoopSpec, float] | None:
    stuck = replace(spec, stiction=1.0, load=Steps((10.0,), (3.3,)))
    e = _error(stuck)
    amplitude = float(np.ptp(e) / 2)
    halves = np.ptp(e[: len(e) // 2]), np.ptp(e[len(e) // 2 :])
    # it cycles, and goes on to
    if min(halves) < 0.8 * max(halves) or _crossings(e) < LEAST_CYCLES:
        return None
    ratio = log_uniform(rng, 2.5, 40.0)
    noise = amplitude / ratio
    if noise * abs(spec.controller.kp) > 0.2:  # the noise on OP would shake the valve free
        return None
    wander = float(rng.choice([0.0, 0.003]))
    noisy = replace(stuck, noise=noise, wander=wander)
    # it cycles with the noise, too
    if np.std(_error(noisy)) ** 2 - noise**2 < 0.7 * np.std(e) ** 2:
        return None
    return _disturbed(rng, noisy, 0.2), ratio


def _crossings(e: NDArray[np.float64]) -> int:
    positive = e > np.mean(e)
    return int(np.sum(positive[1:] & ~positive[:-1]))


def _sine(rng: np.random.Generator, spec: LoopSpec) -> tuple[LoopSpec, float]:
    period = round(log_uniform(rng, 12.0, 100.0))
    times = np.arange(STAIRS) * period / STAIRS
    sizes = np.diff(np.sin(2 * np.pi * (np.arange(STAIRS + 1)) / STAIRS))
    load = Steps(tuple(times), tuple(sizes), float(period))
    amplitude = float(np.ptp(_error(replace(spec, load=load))) / 2)
    ratio = log_uniform(rng, 2.0, 40.0)
    effect = float(np.std(_error(replace(spec, wander=1.0))))
    noise = amplitude / ratio
    wander = noise * log_uniform(rng, 0.1, 1.0) / effect
    return replace(spec, load=load, noise=noise, wander=wander), ratio


def _brink(rng: np.random.Generator, spec: LoopSpec) -> tuple[LoopSpec, float] | None:
    brink = at_sensitivity(spec.plant, spec.controller, 1.0, log_uniform(rng, 10.0, 20.0))
    if rng.random() < 0.5:
        spec = replace(spec, controller=brink, noise=0.1)
        effect = float(np.std(_error(replace(spec, noise=0.0, wander=1.0))))
        if not effect < 1e4:  # unstable after all
            return None
        return replace(spec, wander=0.1 * log_uniform(rng, 1.0, 10.0) / effect), 1.0
    limits = replace(brink, kp=brink.kp * log_uniform(rng, 1.15, 1.5), op_low=40.0, op_high=60.0)
    beyond = replace(spec, controller=limits, load=Steps((10.0,), (float(rng.uniform(-5, 5)),)))
    e = _error(beyond)
    if _crossings(e) < LEAST_CYCLES or not 1e-6 < np.ptp(e) < 1e6:
        return None
    ratio = log_uniform(rng, 3.0, 40.0)
    return replace(beyond, noise=float(np.ptp(e)) / 2 / ratio), ratio
