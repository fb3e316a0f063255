"""The loops of the benchmark `upsets`: one upset each, of seven shapes, and what is true of it without noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from tests.bench.mismatch_fleet import KINDS, settings
from tests.bench.mismatch_plant import INTEGRATING, Floats, Plant, peak
from tests.bench.mismatch_shapes import SHAPES, Rng, log
from tests.bench.mismatch_sim import Rig

STEP, LAG, RAMP, PULSE, OUTPUT, SEVERAL, HALF_SINE = (
    "step",
    "lag",
    "ramp",
    "pulse",
    "output",
    "several",
    "half-sine",
)
UPSETS = (STEP, LAG, RAMP, PULSE, OUTPUT, SEVERAL, HALF_SINE)
SUBSTEPS = 4
"""Fine steps in a sample; the controller executes once a sample."""
MOST_SAMPLES = 4000
"""Samples of a record from the upset on."""
LEAST_SD, MOST_SD = 3.0, 200.0
"""Size of an upset in standard deviations of PV's noise."""
LEAST_NOISE, MOST_NOISE = 1e-3, 3e-2
"""Standard deviation of PV's noise as a share of its span."""
SPAN = 100.0
"""[PV]"""
MOST_PEAK = 6.0
"""Ms above which a loop is drawn again: it would swing by itself."""
START_S = 1_767_225_600.0
BAND_SHARE, QUIET_SD = 0.05, 4.0
"""An upset is over when the error stays within this share of its size, or this many standard deviations of the error's
short average when quiet."""
TOUCHES, CLEAR_SHARE = (0.8, 1.25), 0.1
"""Bands beside it, and the relative difference up to which a recovery does not depend on which it is."""
BEGUN_SHARE = 0.01
"""Share of its size at which it has begun."""


@dataclass
class Upset:
    """A loop with one upset, as it is recorded, and the truth (times from the first sample)."""

    shape: str
    number: int
    loop: Loop
    samples: Samples
    noise: float
    """Standard deviation of PV's noise [PV]."""
    size: float
    """Largest excursion, signed [PV]."""
    onset: float
    """When PV begins to move [s]."""
    over: float
    """When the error stays within the band [s]; NaN where it does not."""
    clear: bool
    """Whether that is so for a band that is somewhat wider or narrower, too: no half wave just touches it."""
    overshoot: float
    natural: float
    """Time in which the loop could answer [s]."""
    plant: Plant
    changes: tuple[float, ...] = ()
    """When the load stepped, where it is made of steps [s]."""

    @property
    def recovery(self) -> float:
        """[s]"""
        return self.over - self.onset


def draw(shape: str, number: int, seed: int) -> Upset:
    """Draw a loop with an upset of a shape, and record it until it has lain still as long again."""
    rng = np.random.default_rng([seed, number, *map(ord, shape)])
    rig, natural = _loop(rng, number)
    every = SUBSTEPS
    quiet = int(rng.integers(400, 1500)) * every
    onset = quiet - int(rng.integers(0, every))
    fine = MOST_SAMPLES * every + quiet
    seconds = (np.arange(fine) - onset) * rig.step
    load, moved, changes = _upset(rng, shape, seconds, natural)
    pv, _ = rig.copy().run(np.zeros(fine), load, moved)
    largest = float(np.abs(pv).max())
    noise = SPAN * log(rng, LEAST_NOISE, MOST_NOISE)
    scale = noise * log(rng, LEAST_SD, MOST_SD) / largest * float(rng.choice([-1, 1]))
    pv, load, moved = pv * scale, load * scale, moved * scale
    heard = noise * np.repeat(rng.standard_normal(fine // every + 1), every)[:fine]
    alone, _ = rig.copy().run(np.zeros(fine), np.zeros(fine), heard)
    short = lfilter([0.2], [1.0, -0.8], alone[::every])
    true = pv[::every]
    size = float(true[np.argmax(np.abs(true))])
    band = max(BAND_SHARE * abs(size), QUIET_SD * float(np.std(short[50:])))
    begun = int(np.flatnonzero(np.abs(true) > BEGUN_SHARE * abs(size))[0])
    over, *others = (_over(true, band * factor) for factor in (1.0, *TOUCHES))
    clear = all(abs((other - begun) / (over - begun) - 1.0) <= CLEAR_SHARE for other in others)
    moving = np.flatnonzero(np.abs(true) > 0.01 * abs(size))[-1]
    last = min(2 * int(moving) - quiet // every + 150, len(true))
    seen, op = rig.run(np.zeros(last * every), load[: last * every], (heard + moved)[: last * every])
    beyond = -true * math.copysign(1.0, size)
    return Upset(
        shape,
        number,
        _table(rng, rig, f"{shape}-{number}"),
        _samples(rng, rig, seen[::every], op[::every]),
        noise,
        size,
        begun * rig.step * every,
        over * rig.step * every,
        clear,
        max(float(beyond[np.argmax(np.abs(true)) :].max()), 0.0) / abs(size),
        natural,
        rig.plant,
        tuple(change + onset * rig.step for change in changes),
    )


def _over(error: Floats, band: float) -> float:
    """Return the sample from which an error stays within a band; NaN where it does not, or never left it."""
    out = np.flatnonzero(np.abs(error) > band)
    return float(out[-1] + 1) if len(out) and out[-1] < len(error) - 2 else math.nan


def _loop(rng: Rng, number: int) -> tuple[Rig, float]:
    """Return a loop at rest, and its natural time [s]; even numbers are integrating."""
    while True:
        dead = log(rng, 1.0, 100.0)
        step = dead / log(rng, 3.0, 20.0) / SUBSTEPS
        gain = log(rng, 1e-4, 1.0) * float(rng.choice([-1, 1]))
        kind = "integrating" if number % 2 == 0 else "self_regulating"
        plant = SHAPES[kind](rng, round(dead / step) * step, gain)
        law = settings(rng, plant, 0.0, KINDS["base"])
        if peak(plant, law, SUBSTEPS * step) < MOST_PEAK:
            return Rig(plant, law, step, SUBSTEPS), plant.theta + plant.lag


def _upset(rng: Rng, shape: str, seconds: Floats, natural: float) -> tuple[Floats, Floats, tuple[float, ...]]:
    """Return the load at the process input [OP] and what is added to PV, of any size; when it steps [s]."""
    past, zero = np.maximum(seconds, 0.0), np.zeros(len(seconds))
    load, changes = np.where(seconds >= 0, 1.0, 0.0), [0.0]
    if shape == OUTPUT:
        return zero, 1 - np.exp(-past / (natural * log(rng, 0.02, 3.0))), ()
    if shape == LAG:
        load = 1 - np.exp(-past / (natural * log(rng, 0.3, 5.0)))
    elif shape == RAMP:
        load = np.minimum(past / (natural * log(rng, 1.0, 10.0)), 1.0)
    elif shape == PULSE:
        changes.append(natural * log(rng, 0.5, 5.0))
        load = load * (seconds < changes[1])
    elif shape == HALF_SINE:
        turn = past / (natural * log(rng, 1.0, 20.0))
        load = np.where(turn < 1.0, np.sin(math.pi * turn), 0.0)
    elif shape == SEVERAL:
        for _ in range(int(rng.integers(1, 4))):
            changes.append(changes[-1] + natural * log(rng, 1.0, 8.0))
            load += np.where(seconds >= changes[-1], rng.uniform(0.3, 1.2) * rng.choice([-1, 1]), 0.0)
    return load, zero, tuple(changes) if shape in {STEP, PULSE, SEVERAL} else ()


def _table(rng: Rng, rig: Rig, name: str) -> Loop:
    law, process = rig.law, rig.plant.process
    said = process if rng.random() < 0.5 else "auto"
    known = {"kp": law.kp, "ti": law.ti, "td": law.td, "tf": law.tf if law.td else None}
    structure = "pid" if law.td > 0 or (process == INTEGRATING and rng.random() < 0.3) else "pi"
    return Loop(name=name, process=said, form=law.form, controller=structure, **known)


def _samples(rng: Rng, rig: Rig, pv: Floats, op: Floats) -> Samples:
    n = len(pv)
    time = START_S + np.arange(n) * rig.step * SUBSTEPS
    pv0, op0 = float(rng.uniform(-100, 100)), float(rng.uniform(30, 70))
    stamp = np.round(time * 1e9).astype(np.int64)
    return Samples.of(np.zeros(n, np.int32), stamp, np.full(n, pv0), pv0 + pv, op0 + op, np.ones(n, bool))
