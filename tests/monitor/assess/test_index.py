"""The index is of the signal, in any units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.assess.index import beats_dead_time, index, least_error
from monitor.contract.loops import Loop
from monitor.identify.direct import fit_window
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import NEVER, LoopSpec, Steps
from tests.monitor.assess.tools import assessed
from tests.support.detection import detected, events_of, loads_of
from tests.support.fits import make_fit
from tests.support.plants import samples_of, stepped
from tuners.models import INTEGRATING, SELF_REGULATING


def test_the_index_is_of_the_signal_not_of_the_noise():
    """Three percent of noise over a long window changes CI by less than a tenth."""
    clean, _, _ = assessed(stepped(1500, seed=1))
    noisy, _, _ = assessed(stepped(1500, noise=0.12, seed=1))
    assert clean.ci is not None
    assert noisy.ci == pytest.approx(clean.ci, rel=0.1)


def test_units_do_not_change_a_verdict():
    """Other units of PV and OP, another operating point: CI and Ms the same, gain scaled."""
    samples = stepped(noise=0.03, seed=4)
    other = replace(samples, sp=2.5 * samples.sp - 40, pv=2.5 * samples.pv - 40, op=0.1 * samples.op + 7)
    first, _, _ = assessed(samples)
    second, _, _ = assessed(other, kp=2.0 * 0.1 / 2.5)
    assert second.ci == pytest.approx(first.ci, rel=1e-4)
    assert second.ms == pytest.approx(first.ms, rel=1e-3)
    assert first.gain is not None
    assert second.gain == pytest.approx(first.gain * 25.0, rel=1e-4)
    assert (second.verdict, second.reason) == (first.verdict, first.reason)


def test_the_least_error_after_a_load_is_what_it_does_in_a_dead_time():
    """The area under the open response until it can be answered: half the square of the dead time, without a lag."""
    pure = replace(make_fit(gain=-0.2, lag=0.0, dead_time=4.0), size=3.0, onset=0.0)
    assert least_error(pure, 3.0, 4.0) == pytest.approx(0.2 * 3.0 * 4.0**2 / 2, rel=1e-3)
    quick = replace(pure, process=SELF_REGULATING)
    assert least_error(quick, 3.0, 4.0) == pytest.approx(0.2 * 3.0 * 4.0, rel=0.05)
    assert least_error(replace(pure, size=None), -3.0, 4.0) == pytest.approx(12.0)


@pytest.mark.parametrize("process", [INTEGRATING, SELF_REGULATING])
@pytest.mark.parametrize("kind", ["setpoint", "load"])
@pytest.mark.parametrize("gain", [0.2, 0.5, 0.9])
def test_no_controller_beats_the_dead_time(process, kind, gain):
    """However tight it is (gain: share of what makes the loop unstable): a true model is never called wrong."""
    plant = Plant(process, 0.1, 8.0, (3.0,) if process == INTEGRATING else (60.0,))  # type: ignore[arg-type]
    slope = plant.gain if process == INTEGRATING else plant.gain / 60.0
    controller = Controller(gain * np.pi / 2 / (slope * 11.0), 300.0)
    spec = LoopSpec(
        name="L",
        plant=plant,
        controller=controller,
        setpoint=Steps((150.0,), (4.0,)) if kind == "setpoint" else NEVER,
        load=Steps((150.3,), (4.0,)) if kind == "load" else NEVER,
        noise=0.005,
    )
    _, found = detected(samples_of(Simulation([spec]).advance(3000.0)))
    (event, *_) = events_of(found) if kind == "setpoint" else loads_of(found)
    fit = fit_window(event.window, process, kind == "load", 1.0)
    assert fit is not None
    assert not beats_dead_time(event, fit)
    assert index(Loop(name="L", kp=float(controller.kp), ti=300.0), event, fit) is not None


def test_an_index_of_a_model_that_cannot_be_is_not_given():
    """A dead time three times as long as the whole error lasted: no index, and the reason is said."""
    samples = stepped(1500, noise=0.02, seed=1)
    _, found = detected(samples)
    (event,) = events_of(found)
    fit = fit_window(event.window, INTEGRATING)
    assert fit is not None
    absurd = replace(fit, dead_time=3.0 * event.iae / abs(event.amplitude))
    loop = Loop(name="L", kp=2.0, ti=40.0)
    assert index(loop, event, fit) is not None
    assert index(loop, event, absurd) is None
