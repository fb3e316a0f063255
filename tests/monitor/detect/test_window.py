"""Windows and slots: thinned, bounded, none lost or shared."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.constants import RING_SAMPLES, WINDOW_POINTS
from monitor.detect.detector import Detector, Found
from monitor.detect.event import BY_MOVING, CAUSES, LOAD_STEP, Opened
from tests.support.detection import columns_of, detected, events_of, openings_of, slots_are_whole
from tests.support.plants import SECOND, START, pi_loop, stepped, times


@settings(max_examples=20)
@given(n=st.integers(WINDOW_POINTS + 200, 9000), seed=st.integers(0, 1000))
def test_thinning_keeps_the_integral_of_op(n, seed):
    """However often the window is halved, OP's integral over it is that of the samples, on uneven times."""
    rng = np.random.default_rng(seed)
    time = START + np.cumsum(rng.integers(500_000_000, 1_500_000_000, n))
    sp = np.full(n, 50.0)
    sp[100:] = 54.0
    op = rng.normal(50, 5, n)
    k = np.arange(n)
    pv = 50 + 0.3 * np.sin(k) + np.where(k > 100, 3 * np.sin(k / 20.0), 0.0)
    detector, found = detected(Samples.of(0, time, sp, pv, op), period=1.0)
    (event,) = events_of(found)
    window = event.window
    t = (time - event.onset) * 1e-9
    first, last = np.searchsorted(t, window.time[[0, -1]] - 1e-6)
    exact = float(np.sum(op[first:last] * np.diff(t)[first:last]))
    assert float(np.sum(window.op[:-1] * np.diff(window.time))) == pytest.approx(exact, rel=1e-9)
    assert len(window) <= WINDOW_POINTS
    assert np.median(np.diff(window.time)) > 1.5  # halved at least once
    assert np.all(np.diff(window.time) > 0)
    assert window.time[window.before] >= 0 > window.time[window.before - 2]
    # PV is picked, not averaged
    rows = np.searchsorted(t, window.time - 1e-6)
    np.testing.assert_array_equal(window.pv, pv[rows])
    slots_are_whole(detector)


def test_a_short_window_holds_every_sample():
    """The ring's samples from before the onset, then all until the end, as they came."""
    samples = stepped(700)
    _, found = detected(samples)
    (event,) = events_of(found)
    window = event.window
    rows = slice(200 - RING_SAMPLES, 200 - RING_SAMPLES + len(window))
    for name in ("sp", "pv", "op"):
        np.testing.assert_array_equal(getattr(window, name), getattr(samples, name)[rows])
    assert window.time[-1] == pytest.approx((event.end - event.onset) / SECOND)


def test_an_upset_of_the_whole_plant():
    """Two thousand loops step at once, again and again: every event comes, slots return, the slab stops growing."""
    loops, n, rounds = 2000, 130, 3
    detector = Detector([Loop(name=str(k)) for k in range(loops)])
    sp = np.full(n, 50.0)
    sp[50:] = 54.0
    pv, op = pi_loop(sp)
    one = Samples.of(0, times(n), sp, pv, op)
    sizes = []
    for turn in range(rounds):
        start = turn * 100_000 * SECOND
        for a in range(0, n, 26):
            part = one.take(slice(a, a + 26))
            m = len(part)
            batch = Samples.of(
                np.tile(np.arange(loops), m),
                np.repeat(part.time + start, loops),
                *(np.repeat(getattr(part, name), loops) for name in ("sp", "pv", "op")),
            )
            found = detector.run(batch)
            slots_are_whole(detector)
            assert len({e.row for e in openings_of(found)}) == len(openings_of(found))
        closed = events_of(detector.flush())
        assert len(closed) == loops
        assert len({columns_of(event.window).tobytes() for event in closed}) == 1
        assert detector.state["event"]["number"].tolist() == [turn + 1] * loops
        sizes.append(len(detector.stores.slab))
    assert sizes == [sizes[0]] * rounds
    assert sizes[0] <= 2 * loops
    slots_are_whole(detector)


ACTS = ("step", "ramp", "gap", "manual", "spike", "rest", "blip", "bad")


@settings(max_examples=40)
@given(
    plan=st.lists(st.tuples(st.sampled_from(ACTS), st.integers(1, 60)), min_size=5, max_size=40),
    seed=st.integers(0, 99),
)
def test_no_slot_is_lost_or_shared_whatever_happens(plan, seed):
    """Steps, ramps, gaps, manual, spikes at random on forty loops: slots stay whole, events are well formed."""
    loops = 40
    detector = Detector([Loop(name=str(k), period=1.0) for k in range(loops)])
    reported: dict[int, int] = {}
    for batch in eventful(plan, loops, seed):
        take_note(detector.run(batch), reported)
        slots_are_whole(detector)
    take_note(detector.flush(), reported)
    assert reported == {}
    assert np.all(detector.state["window"]["slot"] == -1)
    slots_are_whole(detector)


def eventful(plan: list[tuple[str, int]], loops: int, seed: int) -> Iterator[Samples]:
    """Loops to which things happen; one sample of each a batch."""
    rng = np.random.default_rng(seed)
    sp, now = np.full(loops, 50.0), START
    for act, count in [("rest", 60), *plan]:
        struck = rng.random(loops) < 0.6
        moves = {"step": rng.normal(0, 5, loops), "blip": np.full(loops, 7.0)}.get(act, np.zeros(loops))
        for k in range(count):
            now += (101 if act == "gap" and k == 0 else 1) * SECOND
            sp = sp + struck * (moves if k == 0 else 0.0)
            sp = sp - struck * (moves if act == "blip" and k == 2 else 0.0)
            sp = sp + struck * (0.1 if act == "ramp" else 0.0)
            pv = sp + rng.normal(0, 0.05, loops) + struck * (50.0 if act == "spike" and k == 0 else 0.0)
            pv = np.where(struck & (act == "bad"), np.nan, pv)
            auto = ~struck if act == "manual" else True
            yield Samples.of(np.arange(loops), np.full(loops, now), sp, pv, 100 - sp, auto)


def take_note(found: Found, reported: dict[int, int]) -> None:
    """Each opening is followed by its own closing; windows are finite and run forward in time."""
    for event in found:
        if isinstance(event, Opened):
            assert event.row not in reported
            reported[event.row] = event.onset
            continue
        assert np.isfinite(columns_of(event.window)).all()
        assert np.all(np.diff(event.window.time) > 0)
        assert event.onset <= event.end
        if event.kind != LOAD_STEP and event.cause != CAUSES[BY_MOVING]:
            assert reported.pop(event.row) == event.onset
