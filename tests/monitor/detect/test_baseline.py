"""Suspected load steps: what stands out of noise and weather, and what does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.detect.event import ClosedEvent
from sim_plants.specs import Steps
from tests.monitor.detect.tools import TUNED, simulated
from tests.support.detection import detected, events_of, loads_of, ramps_of, steps_of
from tests.support.plants import SECOND, START, times


@pytest.mark.parametrize("colour", [0.0, 0.9, 0.99])
def test_noise_alone_opens_nothing(colour):
    """Fifty loops of white or coloured noise, a million samples: no event, and the noise is measured."""
    loops, n = 50, 20_000
    rng = np.random.default_rng(7)
    white = rng.normal(size=(n, loops))
    e = np.zeros((n, loops))
    for k in range(1, n):
        e[k] = colour * e[k - 1] + np.sqrt(1 - colour**2) * white[k]
    detector = Detector([Loop(name=str(k)) for k in range(loops)])
    loop = np.tile(np.arange(loops, dtype=np.int32), n)
    time = np.repeat(times(n), loops)
    found = detector.run(Samples.of(loop, time, 50.0, 50.0 + e.ravel(), 30.0 - e.ravel()))
    assert steps_of(found) == []
    if colour == 0.0:
        assert np.sqrt(detector.state["noise"]["var_d"] / 6) == pytest.approx(np.ones(loops), rel=0.2)


@pytest.mark.parametrize("before", [90, 300, 1100, 1500, 4000, 4003])
def test_windows_of_suspected_load_steps_run_forward_in_time(before):
    """However far back the window reaches into the rings, its points are the samples', in order, none twice."""
    n = before + 400
    rng = np.random.default_rng(before)
    pv = 50 + rng.normal(0, 0.02, n)
    late = np.arange(n) - before
    pv = pv + np.where(late > 0, 3.0 * late / 20 * np.exp(-late / 40.0), 0.0)
    samples = Samples.of(0, times(n), 50.0, pv, 100 - pv)
    detector = Detector([Loop(name="L")])
    found = [e for e in detector.run(samples) + detector.flush() if isinstance(e, ClosedEvent)]
    assert found
    for event in found:
        at = np.round(event.window.time + (event.onset - START) / SECOND).astype(int)
        assert np.all(np.diff(at) > 0)
        np.testing.assert_array_equal(event.window.pv, pv[at])


def test_an_oscillation_that_was_always_there_is_no_event():
    """The trigger knows the spread of the error, whatever makes it."""
    k = np.arange(20_000)
    pv = 50 + 2.0 * np.sin(k / 15.0) + np.random.default_rng(0).normal(0, 0.05, len(k))
    _, found = detected(Samples.of(0, times(len(k)), 50.0, pv, 100 - pv))
    assert found == []


@pytest.mark.parametrize("period", [20.0, 90.0, 400.0])
def test_an_oscillation_that_begins_soon_belongs_to_the_loop(period):
    """Its first waves may be a load; it ends as `timeout`, and ten thousand samples later nothing is open any more."""
    k = np.arange(40_000)
    wave = np.where(k > 2000, 2.0 * np.sin(2 * np.pi * k / period), 0.0)
    pv = 50 + wave + np.random.default_rng(0).normal(0, 0.05, len(k))
    detector = Detector([Loop(name="L")])
    found = detector.run(Samples.of(0, times(len(k)), 50.0, pv, 100 - pv))
    assert all(e.state == "timeout" for e in loads_of(found))
    assert len(loads_of(found)) <= 2
    assert all(e.end < START + 20_000 * SECOND for e in loads_of(found))
    assert detector.state[0]["window"]["slot"] == -1


@pytest.mark.parametrize("bits", [8, 10, 12])
@pytest.mark.parametrize("noise", [0.05, 0.3, 1.0])
def test_the_last_bits_of_a_transmitter_are_no_load(bits, noise):
    """Noise below and above the resolution, a level that creeps from bit to bit: nothing is handed out."""
    rng = np.random.default_rng(bits)
    n, lsb = 60_000, 100.0 / 2**bits
    level = 50 + 0.7 * lsb * np.sin(2 * np.pi * np.arange(n) / 9000)
    pv = lsb * np.round((level + rng.normal(0, noise * lsb, n)) / lsb)
    _, found = detected(Samples.of(0, times(n), 50.0, pv, 100 - pv))
    assert found == []


def test_a_load_on_a_coarse_transmitter_is_found():
    """Three bits and more stand out."""
    samples = simulated(3000.0, noise=0.1, quantum=0.4, seed=3, load=Steps((1500.3,), (6.0,)))
    assert np.ptp(samples.pv) >= 3 * 0.4
    assert len(loads_of(detected(samples)[1])) == 1


def test_months_of_drift_are_no_load():
    """A loop without integral action, whose offset moves by a hundred sigma in a week, or whose noise triples."""
    rng = np.random.default_rng(0)
    n = 604_800
    drift = np.linspace(0.0, 10.0, n)
    pv = 50 + drift + rng.normal(0, 0.1, n) * np.linspace(1.0, 3.0, n)
    _, found = detected(Samples.of(0, times(n), 50.0, pv, 100 - pv))
    assert found == []


def test_the_end_of_a_ramp_is_no_load():
    """What a ramp leaves behind swings through zero before it is over: it is the ramp's event."""
    slow = replace(TUNED, kp=TUNED.kp / 4, ti=TUNED.ti * 2)
    ramps = Steps((1000.0, 3000.0), (6.0, -6.0), 4000.0)
    samples = simulated(60_000.0, controller=slow, noise=0.05, setpoint=ramps, setpoint_rate=0.03)
    _, found = detected(samples)
    assert events_of(found) == loads_of(found) == []
    assert [abs(ramp.amplitude) for ramp in ramps_of(found)] == pytest.approx([6.0] * 30)


def test_noise_that_was_learnt_from_a_transient_is_learnt_anew():
    """The data begin far from rest; after the first step has settled, a load far below that transient is found."""
    start = Steps((5.0, 1500.0), (20.0, 4.0))
    quiet = replace(TUNED, ti=TUNED.ti * 2)
    samples = simulated(5000.0, controller=quiet, noise=0.05, setpoint=start, load=Steps((4000.3,), (3.0,)))
    _, found = detected(samples.take(slice(6, None)))
    assert [e.amplitude for e in events_of(found)] == pytest.approx([4.0])
    (load,) = loads_of(found)
    assert 0 < (load.onset - START) / SECOND - 4000.3 < 30


@pytest.mark.parametrize("round_off", [0.0, 1e-12])
def test_a_load_step_on_a_loop_without_noise(round_off):
    """A simulator's PV rests exactly, or to round-off: what leaves that is a load step, however slowly it begins."""
    late = np.maximum(np.arange(900) - 150, 0.0)
    pv = 50 + 0.5 * (late / 40) ** 3 * np.exp(-late / 40)
    pv += round_off * np.random.default_rng(1).normal(size=900)
    (event,) = loads_of(detected(Samples.of(0, times(900), 50.0, pv, 100 - pv))[1])
    assert event.amplitude > 0.6
