"""What is true of a simulated loop under any settings: stability, peak sensitivity, indices."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from monitor.assess.reference import (
    closed_loop_time,
    reduced,
    reference_iae,
    reference_structure,
)
from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.margins import settling_time
from sim_plants.plants import discretise
from sim_plants.specs import NEVER, LoopSpec, Steps
from tuners.models import IntegratingModel, Model, SelfRegulatingModel

MOST_SAMPLES = 40_000
"""Samples over which an IAE is taken."""


def sensitivity(spec: LoopSpec, controller: Controller) -> float:
    """Peak sensitivity of the true loop as it runs, plant and controller in discrete time; inf where unstable."""
    if spec.plant.gain * controller.kp <= 0:
        return math.inf
    dt, plant = spec.true_period, discretise(spec.plant, spec.true_period)
    slowest = 0.01 * min(1 / controller.ti, 1 / spec.plant.t0, 1.0 / dt)
    omega = np.geomspace(slowest, math.pi / dt, 4000)
    z = np.exp(1j * omega * dt)
    # the plant's states are a chain (lower triangular): solved from the first to the last
    drive = plant.older[None, :] * (z ** -(plant.delay + 1))[:, None]
    drive = drive + plant.newer[None, :] * (z**-plant.delay)[:, None]
    states = np.zeros((len(z), spec.plant.order), dtype=complex)
    for k in range(spec.plant.order):
        states[:, k] = (drive[:, k] + states[:, :k] @ plant.phi[k, :k]) / (z - plant.phi[k, k])
    back = 1 - 1 / z
    lead = 1 + controller.lead * back / (controller.filter_time * back + dt)
    reset = dt / controller.ti / back
    law = lead * (1 + reset) if controller.form == "series" else lead + reset
    distance = 1 + states[:, -1] * controller.kp * law
    angle = np.unwrap(np.angle(distance))
    integrators = int(spec.plant.integrating) + int(math.isfinite(controller.ti))
    stable = abs(angle[-1] - angle[0] - integrators * math.pi / 2) < math.pi
    return float(1 / np.abs(distance).min()) if stable else math.inf


def stable(spec: LoopSpec, controller: Controller) -> bool:
    """Whether the true loop is stable."""
    return math.isfinite(sensitivity(spec, controller))


def model_of(spec: LoopSpec) -> Model:
    """Return the true plant's half-rule model."""
    theta, lag = spec.plant.half_rule()
    if spec.plant.integrating:
        return IntegratingModel(spec.plant.gain, theta, lag)
    return SelfRegulatingModel(spec.plant.gain, theta, lag, 0.0)


def index(spec: LoopSpec, loop: Loop, controller: Controller, kind: str) -> float:
    """CI of the true loop under these settings: the loop's own reference over the IAE without noise and limits."""
    model, structure = model_of(spec), reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), spec.true_period)
    quiet = replace(
        spec,
        pv0=0.0,
        op0=0.0,
        noise=0.0,
        quantum=0.0,
        controller=controller,
        setpoint=Steps((0.0,), (1.0,)) if kind == SETPOINT else NEVER,
        load=Steps((0.0,), (1.0,)) if kind == LOAD else NEVER,
    )
    seconds = 3 * settling_time(spec.plant, controller, spec.true_period)
    block = Simulation([quiet]).advance(min(seconds, MOST_SAMPLES * spec.true_period))
    before, after = np.abs(block.sp - block.pv)[:-1], np.abs(block.sp[:-1] - block.pv[1:])
    iae = float((before + after).sum()) / 2 * spec.true_period
    return reference_iae(kind, 1.0, model, structure, tc, loop.b, loop.c) / iae
