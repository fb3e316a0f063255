"""Set-point steps: what opens an event, what closes it, and what moves a set point but is no step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from monitor.contract.samples import Samples
from monitor.detect.constants import STEP_REST_PERIODS
from monitor.detect.event import BY_END, BY_MOVING, BY_STEP, CAUSES
from monitor.detect.state import FATES
from tests.support.detection import detected, events_of, loads_of, ramps_of, slots_are_whole, steps_of
from tests.support.plants import SECOND, START, pi_loop, stepped, times


def closed_by(sp: NDArray[np.float64], **facts: Any) -> list[Any]:
    """Events that close in a loop that follows this set point."""
    pv, op = pi_loop(sp, **facts)
    return events_of(detected(Samples.of(0, times(len(sp)), sp, pv, op))[1])


def climbing(n: int, first: int, every: int, treads: int, height: float) -> NDArray[np.float64]:
    """Return a set point that goes up a staircase from 50, a tread each so many samples."""
    return 50.0 + height * np.clip((np.arange(n) - first) // every + 1, 0, treads)


def test_a_set_point_smeared_over_three_samples_is_one_step():
    """A historian's interpolation makes several small moves of one step."""
    sp = np.full(700, 50.0)
    sp[200:] = 54.0
    sp[200], sp[201] = 51.1, 52.9
    (closed,) = closed_by(sp)
    assert closed.amplitude == pytest.approx(4.0)
    assert closed.onset == START + 200 * SECOND


@pytest.mark.parametrize("moves", [8, 100, 500])
def test_a_ramp_is_one_event_and_no_step(moves):
    """A set point that keeps moving opens no step; its way is handed out when the loop has settled."""
    sp = np.full(900, 50.0)
    sp[200 : 200 + moves] += np.linspace(0, 4, moves)
    sp[200 + moves :] += 4.0
    pv, op = pi_loop(sp, noise=0.02)
    detector, found = detected(Samples.of(0, times(900), sp, pv, op))
    assert events_of(found) == loads_of(found) == []
    (ramp,) = ramps_of(found)
    assert ramp.amplitude == pytest.approx(4.0)
    assert 0 < (ramp.onset - START) / SECOND - 199 < 10 + moves / 20
    assert ramp.window.rested
    slots_are_whole(detector)


def test_a_set_point_that_never_rests_is_handed_out_in_parts():
    """A cascade slave's set point, moving at every sample: no steps, but windows of it, ever fewer."""
    rng = np.random.default_rng(0)
    sp = 50 + np.cumsum(rng.normal(0, 0.1, 30_000))
    pv, op = pi_loop(sp, noise=0.02)
    detector, found = detected(Samples.of(0, times(30_000), sp, pv, op))
    assert loads_of(found) == []
    assert [e.onset < START + 60 * SECOND for e in events_of(found)] in (
        [],
        [True],
    )  # until its pace is known
    ways = ramps_of(found)
    assert sum(way.cause == CAUSES[BY_MOVING] for way in ways) >= 3
    assert len(ways) <= 12
    assert detector.state["moves"]["unrecorded"][0] > 1000
    slots_are_whole(detector)


@pytest.mark.parametrize("scan", [1, 2, 5, 10, 30])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.5])
def test_a_cascade_slave_has_no_step(scan, noise):
    """A set point that a master writes at every scan, long rests between them included, is nobody's step."""
    rng = np.random.default_rng(scan)
    n = 6000
    master = np.cumsum(rng.normal(0, 0.5, n // scan + 1))
    sp = 50 + np.repeat(master, scan)[:n]
    pv, op = pi_loop(sp, noise=noise)
    detector, found = detected(Samples.of(0, times(n), sp, pv, op))
    assert events_of(found) == loads_of(found) == []
    assert ramps_of(found)
    slots_are_whole(detector)


@pytest.mark.parametrize("before", ["upset", "manual", "gap", "nothing"])
def test_a_step_is_found_whatever_went_before(before):
    """A far larger upset, manual, a gap or the data's beginning some samples earlier: a move is a move."""
    n, at = 1500, 60
    sp = np.where(np.arange(n) < at, 50.0, 52.0)
    auto = np.ones(n, bool)
    shaken = {"disturb": lambda k, pv: pv + 40.0 * np.exp(-k / 30.0)} if before == "upset" else {}
    pv, op = pi_loop(sp, noise=0.02, **shaken)
    time = times(n)
    if before == "manual":
        auto[:50] = False
    elif before == "gap":
        time = np.where(np.arange(n) < 50, time - 3600 * SECOND, time)
    detector, found = detected(Samples.of(0, time, sp, pv, op, auto))
    assert [e.amplitude for e in events_of(found)] == pytest.approx([2.0])
    assert detector.state["moves"]["recorded"][0] == 1


def test_a_step_at_the_end_of_the_data_is_confirmed():
    """Three samples are too few to tell a step from a ramp, but the set point has moved."""
    _, found = detected(stepped(903, 900, noise=0.02))
    (closed,) = events_of(found)
    assert closed.cause == CAUSES[BY_END]
    assert closed.amplitude == pytest.approx(4.0)


def test_every_move_has_its_fate():
    """Recorded, in the noise, in manual, across a gap, beside a larger one: they add up to the moves made."""
    n = 6000
    sp = np.full(n, 50.0)
    auto = np.ones(n, bool)
    auto[2000:2300] = False
    for at, size in ((500, 4.0), (1500, 0.02), (2100, 1.0), (3000, 4.0), (3020, -0.07), (4500, -2.0)):
        sp[at:] += size
    pv, op = pi_loop(sp, noise=0.02)
    time = times(n)
    time[4500:] += 500 * SECOND
    detector, _ = detected(Samples.of(0, time, sp, pv, op, auto))
    fates = dict(zip(FATES, detector.state["moves"][0], strict=True))
    assert fates == {"recorded": 2, "in_noise": 1, "cut_off": 1, "in_manual": 1, "beside": 1, "unrecorded": 0}


def test_a_controller_that_writes_once_a_minute_is_found_out():
    """Model-predictive control: after two moves of the set point they are nobody's steps any more."""
    rng = np.random.default_rng(4)
    sp = 50 + np.repeat(np.cumsum(rng.normal(0, 1.0, 200)), 60)
    assert len(closed_by(sp, noise=0.02)) <= 2


def test_a_staircase_of_held_steps_is_one_event_a_step():
    """Each tread that is held long enough cuts the event before it short and opens its own."""
    closed = closed_by(climbing(1200, 200, 30, 3, 2.0))
    assert [e.state for e in closed] == ["interrupted", "interrupted", "settled"]
    assert [e.cause for e in closed[:2]] == [CAUSES[BY_STEP]] * 2
    assert [e.amplitude for e in closed] == pytest.approx([2.0, 2.0, 2.0])
    assert [e.quiet for e in closed] == [True, False, False]


@pytest.mark.parametrize("every", [1, 3, 5])
def test_some_clicks_in_a_row_are_one_step(every):
    """An operator who clicks four times within a quarter of a minute makes one step of their sum."""
    (closed,) = closed_by(climbing(900, 300, every, 4, 1.0), noise=0.02)
    assert closed.amplitude == pytest.approx(4.0)
    assert closed.onset == START + 300 * SECOND
    assert closed.state == "settled"


@pytest.mark.parametrize("every", [4, 15, 40])
def test_a_staircase_of_last_bits_is_a_ramp(every):
    """A ramp that shows as a hundred moves of one bit is not a hundred steps."""
    assert len(closed_by(climbing(6000, 300, every, 100, 0.1), noise=0.01)) <= (
        0 if every < STEP_REST_PERIODS else 3
    )


def test_there_and_back_before_the_loop_settles_is_two_steps():
    """A bump test: the first event ends where the second begins."""
    sp = np.full(1500, 50.0)
    sp[300:350] += 4.0
    closed = closed_by(sp, noise=0.02)
    assert [e.state for e in closed] == ["interrupted", "settled"]
    assert [e.amplitude for e in closed] == pytest.approx([4.0, -4.0])


@pytest.mark.parametrize("jitter", ["of single precision", "of an analog signal"])
def test_a_set_point_that_jitters_is_at_rest(jitter):
    """Rounding, or a tenth of the noise: no event but the one step that there is."""
    rng = np.random.default_rng(6)
    sp = np.full(1500, 50.0)
    sp[700:] += 4.0
    pv, op = pi_loop(sp, noise=0.0 if "single" in jitter else 0.1)
    shaken = (
        sp * (1 + 6e-8 * rng.integers(-1, 2, 1500)) if "single" in jitter else sp + rng.normal(0, 0.01, 1500)
    )
    _, found = detected(Samples.of(0, times(1500), shaken, pv, op))
    (closed,) = events_of(found)
    assert closed.onset == START + 700 * SECOND
    assert closed.amplitude == pytest.approx(4.0, abs=0.05)
    assert closed.state == "settled"


def test_a_step_soon_after_a_ramp_is_found():
    """A loop that was ramped for ten minutes and has settled is looked at again."""
    n = np.arange(2500)
    sp = 50.0 + np.clip(n - 300, 0, 600) * 0.01 + 4.0 * (n >= 1500)
    assert [e.onset for e in closed_by(sp, noise=0.02)] == [START + 1500 * SECOND]


@pytest.mark.parametrize("rate", [0.0001, 0.001, 0.01, 0.1])
def test_a_ramp_slow_or_fast_is_neither_step_nor_load(rate):
    """However slowly the set point creeps, nothing happened."""
    n = np.arange(6000)
    sp = 50.0 + np.clip(n - 500, 0, min(6.0 / rate, 4000)) * rate
    pv, op = pi_loop(sp, noise=0.05)
    _, found = detected(Samples.of(0, times(6000), sp, pv, op))
    assert events_of(found) == loads_of(found) == []


def test_a_set_point_that_tracks_pv_in_manual_is_no_step():
    """Bumpless: SP follows PV until the loop is back in automatic, and rests from there on."""
    n = 3000
    rng = np.random.default_rng(2)
    walk = 50 + np.cumsum(rng.normal(0, 0.05, n))
    auto = (np.arange(n) < 500) | (np.arange(n) >= 2000)
    pv = np.where(np.arange(n) < 500, 50.0, np.where(auto, walk[1999], walk)) + rng.normal(0, 0.02, n)
    sp = np.where(np.arange(n) < 500, 50.0, np.where(auto, pv[1999], pv))
    _, found = detected(Samples.of(0, times(n), sp, pv, 30.0, auto))
    assert found == []


@pytest.mark.parametrize("late", [0, 1, 8])
def test_back_to_automatic_with_a_step_is_not_at_rest(late):
    """The set point jumps as the loop goes to automatic: that is no step. Soon after it is, of a loop not at rest."""
    n = 2000
    auto = (np.arange(n) < 500) | (np.arange(n) >= 900)
    sp = np.where(np.arange(n) < 900 + late, 50.0, 56.0)
    pv, op = pi_loop(sp, noise=0.02)
    _, found = detected(Samples.of(0, times(n), sp, pv, op, auto))
    assert loads_of(found) == []
    assert [e.window.rested for e in events_of(found)] == ([False] if late else [])


def test_a_step_below_the_noise_is_none():
    """Half a standard deviation of the error cannot be told from noise."""
    detector, found = detected(stepped(1500, 500, 0.25, noise=0.5))
    assert steps_of(found) == []
    slots_are_whole(detector)


def test_a_step_that_is_taken_back_at_once_is_none():
    """Two samples of another set point are a typing mistake."""
    sp = np.full(700, 50.0)
    sp[200:202] = 60.0
    pv, op = pi_loop(sp)
    detector, found = detected(Samples.of(0, times(700), sp, pv, op))
    assert steps_of(found) == []
    slots_are_whole(detector)


def test_constant_signals_are_no_trouble():
    """No variance at the start: no division, no event; a step out of perfect rest is found."""
    n = 300
    sp = np.full(n, 10.0)
    sp[100:] = 11.0
    with np.errstate(all="raise"):
        detector, found = detected(Samples.of(0, times(n), sp, 10.0, 5.0))
    assert [e.amplitude for e in events_of(found)] == [1.0]
    assert np.isfinite(structured_to_unstructured(detector.state)).all()


def test_back_to_automatic_with_a_bump_is_no_step():
    """A set point that was moved in manual is where the next baseline begins."""
    n = 900
    sp = np.full(n, 50.0)
    sp[300:] = 55.0
    auto = np.ones(n, bool)
    auto[250:400] = False
    _, found = detected(Samples.of(0, times(n), sp, sp, 30.0, auto))
    assert steps_of(found) == []
