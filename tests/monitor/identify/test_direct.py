"""An event's window to a model: its kind, its fit, thinned or short."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.detect.detector import Detector
from monitor.detect.event import ClosedEvent, EventWindow
from monitor.identify.direct import fit_kinds, fit_window, model_response
from monitor.identify.fit import decide
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.settings import simc
from sim_plants.specs import LoopSpec, Steps
from tests.monitor.identify.tools import BEFORE, load_event, random_plant, window_of
from tests.support.plants import pi_loop, samples_of
from tuners.models import INTEGRATING, SELF_REGULATING


@pytest.mark.parametrize("process", [INTEGRATING, SELF_REGULATING])
def test_kind_of_process_is_right_or_left_open(process):
    """Never decided wrongly at 0.5 % noise; decided at all in most loops that had time to settle."""
    decided_right = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        plant = random_plant(rng, process)
        seconds = 40 * plant.t0
        window = window_of(plant, simc(plant, 1.0), seconds, 0.005, seed)
        fits = [fit_window(window, kind) for kind in (INTEGRATING, SELF_REGULATING)]
        best, sure = decide([f for f in fits if f is not None], seconds)
        assert best is not None
        if sure:
            assert best.process == process
            decided_right += 1
    assert decided_right >= 15


def test_a_short_window_is_left_undecided_or_integrating():
    """A lag of 600 s seen for 60 s is an integrator to the eye, or nothing can be said."""
    plant = Plant("self-regulating", 3.0, 4.0, (600.0,))
    window = window_of(plant, Controller(10.0, 60.0), 60.0, 0.005)
    fits = [fit_window(window, kind) for kind in (INTEGRATING, SELF_REGULATING)]
    best, sure = decide([f for f in fits if f is not None], 60.0)
    assert best is not None
    assert not (sure and best.process == SELF_REGULATING)


def test_a_load_step_shows_the_gain_of_a_self_regulating_process(after_loads):
    """To some percent in the median, where dead time, lags, gain and onset are told apart at all."""
    errors = [abs(fits[1].gain / plant.gain - 1) for plant, fits in after_loads]
    assert np.median(errors) < 0.08
    assert np.mean([abs(fits[1].t0 / plant.t0 - 1) < 0.15 for plant, fits in after_loads]) > 0.85


def test_the_kind_is_seen_after_a_load_step(after_loads):
    """Self-regulating, or one with so long a lag that it is tuned as an integrating one."""
    decided = [decide(fits, 1e9) for _, fits in after_loads]
    assert (
        np.mean([best is not None and best.process == SELF_REGULATING and sure for best, sure in decided])
        > 0.9
    )
    for seed in range(8):
        plant = random_plant(np.random.default_rng(seed))
        event = load_event(plant, simc(plant, 1.0), 0.1 * abs(plant.gain), seed)
        if event is not None:
            best, sure = decide(fit_kinds(event, [INTEGRATING, SELF_REGULATING], True, 1.0), 1e9)
            assert best is not None
            assert not (sure and best.process == SELF_REGULATING)


def test_model_response_follows_pv():
    """Offset and slope fitted, the model's PV lies within the noise of the measured one."""
    plant = Plant("integrating", 0.05, 4.0, (3.0,))
    window = window_of(plant, simc(plant, 1.0), 300.0, 0.01)
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    rest = window.pv - model_response(window, fit)
    assert np.std(rest) == pytest.approx(0.01, rel=0.2)
    assert abs(np.mean(rest)) < 1e-9


def test_a_loop_that_is_thinned_is_still_identified():
    """A slow event that was halved in resolution twice gives the same model."""
    plant = Plant("integrating", 0.002, 60.0, (40.0,))
    controller = simc(plant, 1.0)
    spec = LoopSpec(
        name="L", plant=plant, controller=controller, setpoint=Steps((400.0,), (1.0,)), noise=0.005, seed=3
    )
    detector = Detector([Loop(name="L")])
    found = detector.run(samples_of(Simulation([spec]).advance(6000.0))) + detector.flush()
    window = next(e.window for e in found if isinstance(e, ClosedEvent))
    assert np.median(np.diff(window.time)) >= 2.0
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    assert fit.gain == pytest.approx(plant.gain, rel=0.03)
    assert fit.t0 == pytest.approx(plant.t0, rel=0.1)


def test_noise_free_pi_of_the_twin():
    """The tests' own little loop is what it says: gain 0.05, four samples of dead time."""
    sp = np.full(500, 50.0)
    sp[BEFORE:] += 4.0
    pv, op = pi_loop(sp)
    window = EventWindow(np.arange(500.0) - BEFORE, sp, pv, op, BEFORE)
    fit = fit_window(window, INTEGRATING)
    assert fit is not None
    assert fit.gain == pytest.approx(0.05, rel=1e-3)
    assert fit.t0 == pytest.approx(4.0, abs=0.1)
