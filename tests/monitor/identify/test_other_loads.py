"""Loads that are no step at the event's begin: through a lag, ramps, beside a set-point step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.detect.event import ClosedEvent
from monitor.identify.direct import fit_kinds, fit_window, model_response
from monitor.identify.fit import Fit
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.settings import simc
from sim_plants.specs import NEVER, LoopSpec, Steps
from tests.support.detection import detected, events_of, loads_of
from tests.support.plants import samples_of
from tuners.models import INTEGRATING, SELF_REGULATING

PLANT = Plant("integrating", 0.05, 6.0, (8.0,))
BEGIN = 200.3
MANY = 400


def through_lag(size: float, lag: float) -> Steps:
    """Return a load through a lag, in many steps of one size."""
    times = BEGIN - lag * np.log1p(-(np.arange(MANY) + 0.5) / MANY)
    return Steps(tuple(times), (size / MANY,) * MANY)


def ramp(size: float, seconds: float, begin: float = BEGIN) -> Steps:
    """Return a load that rises evenly."""
    return Steps(tuple(begin + seconds * (np.arange(MANY) + 0.5) / MANY), (size / MANY,) * MANY)


def closed(load: Steps, setpoint: Steps = NEVER, noise: float = 0.0, plant: Plant = PLANT) -> ClosedEvent:
    """Return the event of a loop with a tenth of PV's movement as noise at most, under a PI half as fast as SIMC's."""
    base = simc(plant, 1.0)
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=Controller(0.5 * base.kp, base.ti),
        setpoint=setpoint,
        load=load,
        noise=noise,
        seed=3,
    )
    _, found = detected(samples_of(Simulation([spec]).advance(1500.0)))
    return (events_of(found) if setpoint.times else loads_of(found))[0]


def fitted(event: ClosedEvent, kinds: tuple[str, ...] = (INTEGRATING,)) -> Fit:
    fits = fit_kinds(event.window, list(kinds), event.kind == 1, event.period)
    return max(fits, key=lambda fit: fit.log_likelihood)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("load", [through_lag(3.0, 15.0), through_lag(-3.0, 60.0), ramp(3.0, 60.0)])
def test_a_load_that_is_no_step_shows_gain_and_size(load, noise):
    """Both within what is said of them, and near; a step would have shown another gain, and more is left over."""
    event = closed(load, noise=noise)
    fit = fitted(event)
    assert fit.other is not None
    assert fit.gain == pytest.approx(PLANT.gain, rel=0.05)
    low, high = fit.interval("gain")
    assert low < PLANT.gain < high
    assert fit.size == pytest.approx(sum(load.sizes), rel=0.02)
    assert fit.t0 == pytest.approx(PLANT.t0, rel=0.3)
    rest = event.window.pv - model_response(event.window, fit)
    assert np.std(rest) < 1.1 * noise + 0.01 * np.ptp(event.window.pv)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize(
    "load",
    [Steps((240.4,), (2.0,)), Steps((330.0,), (-3.0,)), ramp(3.0, 400.0, 150.0)],
    ids=["soon", "later", "drift"],
)
def test_a_load_beside_a_set_point_step_is_told_apart(load, noise):
    """The gain is right and inside its interval; the load is none of the event's own."""
    event = closed(load, Steps((200.0,), (4.0,)), noise)
    fit = fitted(event)
    assert fit.other is not None
    assert fit.size is None
    assert fit.gain == pytest.approx(PLANT.gain, rel=0.1)
    low, high = fit.interval("gain")
    assert low < PLANT.gain < high
    assert fit.quality > 0.98


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.06])
@pytest.mark.parametrize(
    ("setpoint", "load"), [(Steps((200.0,), (4.0,)), NEVER), (NEVER, Steps((BEGIN,), (3.0,)))]
)
def test_plain_steps_have_no_other_load(setpoint, load, noise):
    fit = fitted(closed(load, setpoint, noise))
    assert fit.other is None
    assert not fit.leaves_more


def test_a_wrong_kind_of_process_is_not_excused_by_a_load():
    """After a set-point step on a vessel that leaks, called an integrator: the other kind explains it, and no load."""
    leaking = Plant("self-regulating", 3.0, 6.0, (60.0,))
    event = closed(NEVER, Steps((200.0,), (4.0,)), 0.02, leaking)
    fit = fitted(event)
    assert fit.leaves_more
    assert fit.other is None
    both = fitted(event, (INTEGRATING, SELF_REGULATING))
    assert (both.process, both.other) == (SELF_REGULATING, None)


def test_what_cannot_be_told_apart_is_less_certain():
    """The same step, with and without another shape allowed for: the interval of gain and of dead time is wider."""
    plain = fitted(closed(Steps((BEGIN,), (3.0,)), noise=0.02))
    shaped = fitted(closed(through_lag(3.0, 15.0), noise=0.02))
    for name in ("gain", "dead_time"):
        narrow, wide = (np.ptp(fit.interval(name)) for fit in (plain, shaped))
        assert wide > 1.5 * narrow
    assert replace(shaped, other=None).size == shaped.size


@pytest.mark.parametrize("process", [SELF_REGULATING, INTEGRATING])
def test_a_load_of_another_shape_leaves_the_gain_of_a_self_regulating_process_open(process):
    """A slow load passes for a slow tail of the process: its gain is known to a factor, an integrator's well."""
    plant = Plant(process, 0.05 if process == INTEGRATING else 2.0, 6.0, (20.0,))
    event = closed(ramp(10.0, 60.0), noise=0.01, plant=plant)
    fit = fit_window(event.window, process, load=True, period=event.period, other_loads=True)
    assert fit is not None
    assert fit.other is not None
    low, high = fit.interval("gain")
    assert low < plant.gain < high
    assert (high / low > 4.0) == (process == SELF_REGULATING)
