"""An event's phases: opened, followed, settled, or cut short."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.constants import RING_SAMPLES
from monitor.detect.detector import Detector
from monitor.detect.event import BY_END, BY_GAP, BY_MODE, BY_STEP, CAUSES
from sim_plants.specs import Steps
from tests.monitor.detect.tools import TUNED, simulated
from tests.support.detection import detected, events_of, loads_of, openings_of, slots_are_whole, steps_of
from tests.support.plants import SECOND, START, pi_loop, stepped, times


def test_a_step_opens_and_closes_one_event():
    """One opening, one closing, of the step's size, at the sample that shows it, with what came before."""
    _, found = detected(stepped(700))
    (opened,), (closed,) = openings_of(found), events_of(found)
    for event in (opened, closed):
        assert event.amplitude == pytest.approx(4.0)
        assert event.onset == START + 200 * SECOND
        assert event.number == 1
    assert closed.state == "settled"
    assert closed.quiet
    assert closed.window.time[RING_SAMPLES] == 0.0
    assert closed.window.before == RING_SAMPLES


def test_a_slow_process_is_waited_for():
    """A dead time of 150 samples, or a tail of many minutes, is no end of an event."""
    slow = stepped(3000, 200, kp=0.04, ti=2000.0, dead=150, noise=0.04)
    _, found = detected(slow)
    (closed,) = events_of(found)
    after = (closed.end - closed.onset) / SECOND
    assert after > 600
    assert abs(closed.offset) < 0.15 * closed.amplitude


def test_an_event_of_a_loop_that_never_follows_ends():
    """Where PV does not move at all the event ends after some hundred samples, away from the set point."""
    n = 2000
    sp = np.full(n, 10.0)
    sp[100:] = 11.0
    _, found = detected(Samples.of(0, times(n), sp, 10.0, 5.0))
    (closed,) = events_of(found)
    assert closed.state == "settled"
    assert closed.offset == pytest.approx(1.0)
    assert closed.end < START + 1000 * SECOND


def test_a_loop_that_does_not_settle_is_given_up():
    """An undamped oscillation after the step: `timeout` after twenty waves."""
    n = 12_000
    k = np.arange(n)
    sp = np.full(n, 50.0)
    sp[500:] = 54.0
    pv = np.where(k < 503, 50.0, 54.0 + 3 * np.sin(k / 20.0))
    _, found = detected(Samples.of(0, times(n), sp, pv, 50.0 + 0.2 * (sp - pv)))
    (closed,) = events_of(found)
    assert closed.state == "timeout"
    assert 19 < (closed.end - closed.onset) / SECOND / (40 * np.pi) < 22


def test_a_step_during_an_event_interrupts_it_and_opens_the_next():
    """The first ends where the second begins; the second is not from rest."""
    samples = stepped(700)
    sp = samples.sp.copy()
    sp[230:] += 3.0
    pv, op = pi_loop(sp)
    _, found = detected(replace(samples, sp=sp, pv=pv, op=op))
    first, second = events_of(found)
    assert (first.state, first.cause) == ("interrupted", CAUSES[BY_STEP])
    assert first.end == second.onset == START + 230 * SECOND
    assert second.amplitude == pytest.approx(3.0)


def test_a_gap_interrupts_an_event_and_nothing_is_integrated_across():
    """An hour without data in the middle of an event: closed at the last sample before it."""
    samples = stepped(700)
    shifted = samples.time.copy()
    shifted[260:] += 3600 * SECOND
    detector, found = detected(replace(samples, time=shifted))
    (closed,) = events_of(found)
    assert (closed.state, closed.cause) == ("interrupted", CAUSES[BY_GAP])
    assert closed.end == START + 259 * SECOND
    assert closed.iae < 4.0 * 60
    health = detector.health[0]
    assert health["coverage"]["wall_time"] == pytest.approx(699 + 3600)
    assert health["coverage"]["good_time"] < 700


def test_manual_interrupts_an_event_and_counts():
    """A change to manual closes the event; nothing opens in manual; the share of time is kept."""
    samples = stepped(700)
    sp = samples.sp.copy()
    sp[400:] += 5.0
    auto = np.ones(700, bool)
    auto[260:500] = False
    detector, found = detected(replace(samples, sp=sp, auto=auto))
    (closed,) = events_of(found)
    assert (closed.state, closed.cause) == ("interrupted", CAUSES[BY_MODE])
    assert detector.health[0]["coverage"]["manual_time"] == pytest.approx(240.0, abs=1.5)


def test_the_end_of_the_data_interrupts_an_event():
    """`flush` closes what is open, once."""
    detector = Detector([Loop(name="L")])
    detector.run(stepped(700).take(slice(0, 240)))
    (closed,) = events_of(detector.flush())
    assert (closed.state, closed.cause) == ("interrupted", CAUSES[BY_END])
    assert detector.flush() == []
    slots_are_whole(detector)


@pytest.mark.parametrize("size", [2.0, -8.0])
@pytest.mark.parametrize("wander", [0.0, 0.02])
def test_a_load_step_is_handed_out_once(size, wander):
    """Against noise and a drifting load: one event, noticed soon after the step, from a quiet baseline."""
    samples = simulated(3000.0, noise=0.05, wander=wander, seed=3, load=Steps((1500.3,), (size,)))
    _, found = detected(samples)
    (event,) = loads_of(found)
    assert event.state == "settled"
    assert 0 < (event.onset - START) / SECOND - 1500.3 < 20
    assert event.quiet
    assert steps_of(found) == []


def test_a_slow_response_is_waited_for_until_it_has_returned():
    """A sluggish loop's PV rises for ten minutes: that it hardly moves meanwhile is no end of the event."""
    slow = replace(TUNED, kp=TUNED.kp / 8, ti=TUNED.ti * 12)
    samples = simulated(9000.0, controller=slow, noise=0.05, seed=1, load=Steps((1500.0,), (2.0,)))
    _, found = detected(samples)
    (event,) = loads_of(found)
    away = np.abs(samples.pv - 50.0)
    assert event.state == "settled"
    assert event.amplitude == pytest.approx(away.max(), rel=0.1)
    assert event.end > samples.time[away.argmax()]
    assert abs(event.offset) < 0.1 * event.amplitude


def test_a_set_point_step_interrupts_a_load():
    """The load's event ends where the step begins, and the step has its own."""
    samples = simulated(3000.0, noise=0.05, load=Steps((1500.3,), (8.0,)), setpoint=Steps((1530.0,), (4.0,)))
    _, found = detected(samples)
    (load,), (step,) = loads_of(found), events_of(found)
    assert (load.state, load.cause) == ("interrupted", CAUSES[BY_STEP])
    assert load.end == step.onset == START + 1530 * SECOND
    assert not step.quiet


def test_a_load_during_a_set_point_step_belongs_to_it():
    """One event at a time: the step's goes on, and says what else happened by its fit."""
    samples = simulated(3000.0, noise=0.05, load=Steps((1520.3,), (8.0,)), setpoint=Steps((1500.0,), (4.0,)))
    _, found = detected(samples)
    assert len(events_of(found)) == 1
    assert loads_of(found) == []
