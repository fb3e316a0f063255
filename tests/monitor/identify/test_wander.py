"""A load that wanders: the process beside it is found without bias, and nothing else is taken for one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from monitor.detect.event import ClosedEvent
from monitor.identify.direct import fit_kinds
from monitor.identify.fit import Fit
from monitor.identify.misfit import model_error
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.settings import simc
from sim_plants.specs import NEVER, LoopSpec, Steps
from tests.support.detection import detected, events_of
from tests.support.plants import samples_of
from tuners.models import INTEGRATING, SELF_REGULATING

NOISE, STEP = 0.05, 1.5
PLANTS = {
    INTEGRATING: Plant("integrating", 0.05, 6.0, (8.0,)),
    SELF_REGULATING: Plant("self-regulating", 1.5, 6.0, (20.0,)),
}
SEEDS = range(8)


def wandering(seed: int, size: float) -> Steps:
    """Return a load that forgets itself within some minutes, in steps of a second."""
    rng = np.random.default_rng(seed)
    keep = math.exp(-1.0 / 200.0)
    load = np.zeros(2500)
    for k in range(1, len(load)):
        load[k] = keep * load[k - 1] + math.sqrt(1.0 - keep**2) * rng.normal()
    return Steps(tuple(np.arange(1, len(load)) + 0.5), tuple(size * np.diff(load)))


def event_of(process: str, load: Steps, seed: int = 0) -> ClosedEvent:
    """Return the set-point step of a healthy loop with noise and this load."""
    plant = PLANTS[process]
    base = simc(plant, 1.0)
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=Controller(0.7 * base.kp, base.ti),
        setpoint=Steps((1500.2,), (STEP,)),
        load=load,
        noise=NOISE,
        seed=seed,
    )
    _, found = detected(samples_of(Simulation([spec]).advance(2400.0)))
    return next(e for e in events_of(found) if abs(e.amplitude - STEP) < 0.1)


def own(fits: list[Fit], process: str) -> Fit:
    return next(fit for fit in fits if fit.process == process)


@pytest.fixture(scope="module", params=[INTEGRATING, SELF_REGULATING])
def fleet(request) -> list[tuple[ClosedEvent, Fit]]:
    """Events beside a load that moves PV by about its noise, with the fit of the true kind of process."""
    size = 0.15 if request.param == INTEGRATING else 0.1
    events = [event_of(request.param, wandering(seed, size), seed) for seed in SEEDS]
    return [(e, own(fit_kinds(e.window, [request.param], False, e.period), request.param)) for e in events]


def test_the_gain_is_found_beside_it(fleet):
    """In the middle within 10 %, none of another sign, and within three standard deviations in nearly all."""
    true = PLANTS[fleet[0][1].process].gain
    off = [math.log(fit.gain / true) for _, fit in fleet]
    assert np.median(np.abs(off)) < 0.1
    inside = [abs(o) < 3.0 * math.sqrt(fit.cov[0, 0]) for o, (_, fit) in zip(off, fleet, strict=True)]
    assert sum(inside) >= len(inside) - 1


def test_most_are_seen_to_wander(fleet):
    """Where noise does go on, that is said; what it leaves then is as large as the noise."""
    seen = [(event, fit) for event, fit in fleet if fit.wander is not None]
    assert len(seen) >= len(fleet) / 2
    for _, fit in seen:
        assert fit.sigma == pytest.approx(NOISE, rel=0.3)
        assert not fit.leaves_more


def test_no_error_of_the_model_is_seen_in_it(fleet):
    """What wanders is no mode of the process."""
    sizes = [
        model_error(event.window, fit, event.noise).size for event, fit in fleet if fit.wander is not None
    ]
    assert sum(size == 0.0 for size in sizes) >= 0.8 * len(sizes)


@pytest.mark.parametrize("process", PLANTS)
def test_white_noise_does_not_wander(process):
    """One in 400 by chance."""
    fits = [
        own(fit_kinds(e.window, [process], False, e.period), process)
        for e in (event_of(process, NEVER, seed) for seed in SEEDS)
    ]
    assert sum(fit.wander is not None for fit in fits) <= 1


@pytest.mark.parametrize("process", PLANTS)
def test_one_load_beside_the_step_does_not_wander(process):
    """It came after the onset: noise that goes on would have been there before."""
    for seed in SEEDS:
        event = event_of(process, Steps((1530.0,), (2.0 if process == INTEGRATING else 1.0,)), seed)
        fit = own(fit_kinds(event.window, [process], False, event.period), process)
        assert fit.wander is None


def test_scales_with_pv_and_op():
    """In other units of PV and OP the same is found."""
    event = event_of(SELF_REGULATING, wandering(1, 0.1), 1)
    one = own(fit_kinds(event.window, [SELF_REGULATING], False, event.period), SELF_REGULATING)
    w = event.window
    other = type(w)(w.time, 7.0 * w.sp + 3.0, 7.0 * w.pv + 3.0, 100.0 - 0.2 * w.op, w.before, w.rested)
    two = own(fit_kinds(other, [SELF_REGULATING], False, event.period), SELF_REGULATING)
    assert two.gain == pytest.approx(-35.0 * one.gain, rel=1e-3)
    assert two.dead_time == pytest.approx(one.dead_time, abs=0.05)
    assert (two.wander is None) == (one.wander is None)
