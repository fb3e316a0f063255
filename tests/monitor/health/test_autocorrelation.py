"""The error's autocorrelation, level by level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.health.loop_health import figures
from sim_plants.controllers import Controller
from sim_plants.loops import Simulation
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps
from tests.monitor.health.cycles import health, noise
from tests.monitor.health.tools import look, run, samples_of
from tests.support.plants import SECOND, START


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_a_sample_period_that_wanders_hides_no_oscillation(share):
    """One second and two, mixed at random: the period that is learnt flips, the cycle stays."""
    rng = np.random.default_rng(3)
    t = np.cumsum(np.where(rng.random(40_000) < share, 2, 1))
    pv = 50 + np.sin(2 * np.pi * t / 60) + 0.05 * rng.normal(size=len(t))
    found = look(run(samples_of(50.0, pv, 30 - pv, time=t)))
    assert found.oscillating
    assert found.oscillation_period == pytest.approx(60, rel=0.02)


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
    found = figures(detector.health[0], float(detector.state["clock"]["period"][0]))
    assert found.oscillation_period == pytest.approx(200, rel=0.03)
