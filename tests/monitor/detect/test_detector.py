"""The streaming kernel: its integrals and windows, and that nothing depends on how samples come in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector, Found
from monitor.detect.event import SETPOINT_STEP, ClosedEvent, Opened
from monitor.detect.state import RING, WINDOW
from monitor.identify.direct import fit_window
from monitor.identify.integrals import load_integrals, setpoint_integrals
from sim_plants.fleet import random_fleet
from sim_plants.loops import Simulation
from sim_plants.scenarios import reference_loops
from sim_plants.specs import NEVER, Steps
from tests.support.detection import (
    as_bytes,
    columns_of,
    detected,
    events_of,
    openings_of,
    slots_are_whole,
    stepped,
)
from tests.support.plants import SECOND, START, pi_loop, samples_of, times
from tests.support.twins import integrals

# Unit steps; mu, T0, half rule's theta, IAE of the set-point step, IAE of the load step.
REFERENCE = {
    "REF-1": (1.0, 1.0, 1.0, 3.922, 16.0),
    "REF-2": (1.0, 2.0, 0.5, 2.272, 4.0),
    "REF-3": (0.2, 8.0, 3.5, 33.98, 320.0),
    "REF-4": (0.2, 8.0, 3.5, 17.64, 50.0),
}
FINE = 0.01
"""[s] Backward differences err by about a period over the filter time."""


# ---------------------------------------------------------------------------------------------------
# the reference loops of the literature


@pytest.fixture(scope="module")
def reference() -> dict[str, ClosedEvent]:
    """The set-point event of each reference loop, noise-free, in fine time."""
    found = {}
    for loop in reference_loops(0, FINE):
        spec = replace(loop, setpoint=Steps((20.0,), (1.0,)), load=NEVER)
        block = Simulation([spec]).advance(1500.0 if spec.name == "REF-3" else 700.0)
        detector = Detector([Loop(name=spec.name, period=0.2)])
        (found[spec.name],) = events_of(detector.run(samples_of(block)))
    return found


@pytest.mark.parametrize("name", REFERENCE)
def test_integrals_give_gain_and_t0_of_the_reference_loops(reference, name):
    """mu within 0.1 %, T0 within 1 %, from the running integrals of a set-point step alone."""
    event = reference[name]
    gain, t0 = setpoint_integrals(event.amplitude, event.s1, event.s2, event.y1)
    assert event.state == "settled"
    assert gain == pytest.approx(REFERENCE[name][0], rel=1e-3)
    assert t0 == pytest.approx(REFERENCE[name][1], rel=0.01)


@pytest.mark.parametrize("name", REFERENCE)
def test_iae_of_the_reference_loops(reference, name):
    """IAE within 1 % of the published figure, and none of it taken for noise but the settled tail."""
    event = reference[name]
    assert event.iae == pytest.approx(REFERENCE[name][3], rel=0.01)
    assert event.iae_noise == pytest.approx(0.0, abs=1e-6 * event.iae)


@pytest.mark.parametrize("name", REFERENCE)
def test_fit_gives_the_half_rules_dead_time_of_the_reference_loops(name):
    """The fit's effective dead time lies within 15 % of the half rule's, gain within 1 %, T0 within 10 %."""
    gain, t0, dead_time, *_ = REFERENCE[name]
    (spec,) = (s for s in reference_loops(0, 0.05) if s.name == name)
    spec = replace(spec, setpoint=Steps((20.0,), (1.0,)), load=NEVER)
    _, found = detected(samples_of(Simulation([spec]).advance(520.0)))
    (event,) = events_of(found)
    fit = fit_window(event.window, "integrating")
    assert fit is not None
    assert fit.dead_time == pytest.approx(dead_time, rel=0.15)
    assert fit.gain == pytest.approx(gain, rel=0.01)
    assert fit.t0 == pytest.approx(t0, rel=0.1)  # the long tail has cost the window its resolution


@pytest.mark.parametrize("name", ["REF-1", "REF-2", "REF-4"])
def test_load_integrals_give_size_onset_and_gain(name):
    """A load step's size, its onset (which is not measured) and the gain follow from the integrals."""
    (spec,) = (s for s in reference_loops(0, FINE) if s.name == name)
    onset, end = 30.0, 530.0
    spec = replace(spec, setpoint=NEVER, load=Steps((onset,), (1.0,)))
    block = Simulation([spec]).advance(end + FINE)
    window = np.column_stack([(block.time_ns - block.time_ns[0]) * 1e-9, block.sp, block.pv, block.op])
    found = integrals(window, 0.0, 0.0)
    u_end = float(block.op[-1])
    size, age, gain, _ = load_integrals(*(found[n] for n in ("s1", "s2", "s3", "y1", "y2")), u_end)
    assert size == pytest.approx(1.0, rel=1e-3)
    assert window[-1, 0] - age == pytest.approx(onset, abs=0.02)
    assert gain == pytest.approx(REFERENCE[name][0], rel=1e-3)
    assert found["iae"] == pytest.approx(REFERENCE[name][4], rel=0.01)


def test_running_integrals_equal_their_naive_twin():
    """All integrals, on uneven times, equal the textbook sums over the event's samples."""
    samples = stepped(noise=0.05, seed=3)
    jitter = np.random.default_rng(1).integers(-200_000_000, 200_000_000, len(samples))
    samples = replace(samples, time=samples.time + jitter)
    _, found = detected(samples, period=1.0)
    (event,) = events_of(found)
    window, before = columns_of(event.window), event.window.before
    after = window[before - 1 :]
    naive = integrals(after, event.pv0, event.op0)
    # the integrals begin at the onset; OP still held its old value on the way to it
    between = naive | {"s1": naive["s1"] - (after[0, 3] - event.op0) * -after[0, 0]}
    whole = integrals(window[before:], event.pv0, event.op0)
    assert len(between) == len(whole)
    for name, value in whole.items():
        assert getattr(event, name) == pytest.approx(value, rel=1e-9), name


# ---------------------------------------------------------------------------------------------------
# stream and batch, scale and shift


@pytest.fixture(scope="module")
def fleet() -> tuple[list[Loop], Samples]:
    """Twelve loops of several periods over 2,000 s, interleaved in time, some samples bad."""
    specs = random_fleet(12, 3, noise=(0.0, 0.02))
    samples = samples_of(Simulation(specs).advance(2000.0))
    rng = np.random.default_rng(0)
    pv = samples.pv.copy()
    pv[rng.random(len(pv)) < 0.01] = np.nan
    auto = samples.auto.copy()
    auto[(samples.loop == 3) & (np.arange(len(pv)) % 5000 < 40)] = False
    return [Loop(name=s.name) for s in specs], replace(samples, pv=pv, auto=auto)


@settings(max_examples=30, deadline=None)
@given(cuts=st.lists(st.integers(0, 20_000), max_size=30))
def test_any_batching_gives_the_same_events(fleet, cuts):
    """Bit-equal events and windows, and at every cut exactly those that a single batch had found by then."""
    loops, samples = fleet
    once = Detector(loops)
    whole = as_bytes(once.run(samples))
    assert len(whole) > 20
    detector, found = Detector(loops), []
    bounds = [0, *sorted(min(c, len(samples)) for c in cuts), len(samples)]
    for a, b in pairwise(bounds):
        found += as_bytes(detector.run(samples.take(slice(a, b))))
        assert found == whole[: len(found)]
        slots_are_whole(detector)
    assert found == whole
    ends = [one.state.copy() for one in (once, detector)]
    for state in ends:
        state["slot"] = np.where(state["slot"] >= 0, 0, -1)  # where a window lies depends on the batches
    assert ends[0].tobytes() == ends[1].tobytes()


def test_sample_by_sample_equals_one_batch(fleet):
    """The same, one sample a call."""
    loops, samples = fleet
    samples = samples.take(slice(0, 6000))
    whole = as_bytes(Detector(loops).run(samples))
    detector, found = Detector(loops), []
    for k in range(len(samples)):
        found += as_bytes(detector.run(samples.take(slice(k, k + 1))))
    assert found == whole
    assert whole


def test_loops_do_not_see_each_other(fleet):
    """Each loop alone, and all loops in another order of rows, give that loop's events bit by bit."""
    loops, samples = fleet
    whole = Detector(loops).run(samples)
    order = np.random.default_rng(4).permutation(len(loops))
    place = np.argsort(order).astype(np.int32)
    other = Detector([loops[k] for k in order]).run(replace(samples, loop=place[samples.loop]))
    for k, loop in enumerate(loops):
        rows = samples.take(samples.loop == k)
        alone = Detector([loop]).run(replace(rows, loop=np.zeros(len(rows), np.int32)))
        for found, row in ((whole, k), (other, place[k])):
            mine = [replace(event, row=0) for event in found if event.row == row]
            assert as_bytes(mine) == as_bytes(alone)


@settings(max_examples=25, deadline=None)
@given(
    a=st.floats(1e-3, 1e3),
    b=st.floats(-1e4, 1e4),
    c=st.floats(1e-3, 1e3),
    d=st.floats(-1e3, 1e3),
    shift=st.integers(-(10**18), 10**18),
)
def test_units_and_clock_do_not_matter(a, b, c, d, shift):
    """PV and SP in other units (a x + b), OP too, at another time: the same events, integrals scaled."""
    samples = stepped(noise=0.02, seed=9)
    other = replace(
        samples,
        sp=a * samples.sp + b,
        pv=a * samples.pv + b,
        op=c * samples.op + d,
        time=samples.time + shift,
    )
    (first,), (second,) = events_of(detected(samples)[1]), events_of(detected(other)[1])
    assert (second.onset, second.end) == (first.onset + shift, first.end + shift)
    assert (second.state, second.cause) == (first.state, first.cause)
    assert (len(second.window), second.window.before) == (len(first.window), first.window.before)
    assert second.amplitude == pytest.approx(a * first.amplitude, rel=1e-6)
    assert second.iae == pytest.approx(a * first.iae, rel=1e-6)
    assert second.noise == pytest.approx(a * first.noise, rel=1e-5)
    assert second.s1 == pytest.approx(c * first.s1, rel=1e-5, abs=1e-7 * c)


# ---------------------------------------------------------------------------------------------------
# windows and slots


@settings(max_examples=20, deadline=None)
@given(n=st.integers(WINDOW + 200, 9000), seed=st.integers(0, 1000))
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
    assert len(window) <= WINDOW
    assert np.median(np.diff(window.time)) > 1.5  # halved at least once
    assert np.all(np.diff(window.time) > 0)
    assert window.time[window.before] >= 0 > window.time[window.before - 2]
    # PV is picked, not averaged
    rows = np.searchsorted(t, window.time - 1e-6)
    np.testing.assert_array_equal(window.pv, pv[rows])
    slots_are_whole(detector)


def test_a_short_window_holds_every_sample():
    """The ring's samples from before the onset, then all until the end, as they came."""
    samples = stepped()
    _, found = detected(samples)
    (event,) = events_of(found)
    window = event.window
    rows = slice(200 - RING, 200 - RING + len(window))
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
        assert detector.state["events"].tolist() == [turn + 1] * loops
        sizes.append(len(detector.slab))
    assert sizes == [sizes[0]] * rounds
    assert sizes[0] <= 2 * loops
    slots_are_whole(detector)


ACTS = ("step", "ramp", "gap", "manual", "spike", "rest", "blip", "bad")


@settings(max_examples=40, deadline=None)
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
    assert np.all(detector.state["slot"] == -1)
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
        if event.kind == SETPOINT_STEP:
            assert reported.pop(event.row) == event.onset


def test_loops_added_later_leave_the_others_alone():
    """A new row in mid-event: the old loop's event comes out as if nothing had been added."""
    samples = stepped(noise=0.01)
    alone = as_bytes(detected(samples)[1])
    detector = Detector([Loop(name="L")])
    found = detector.run(samples.take(slice(0, 230)))
    detector.add([Loop(name="M"), Loop(name="N")])
    found += detector.run(samples.take(slice(230, None)))
    assert as_bytes(found) == alone
    other = detector.run(replace(samples, loop=np.full(700, 2, np.int32)))
    assert len(events_of(other)) == 1


def test_the_period_is_measured_and_followed():
    """Without a nominal period it is the median step; a gateway that changes its rate is followed."""
    detector = Detector([Loop(name="L")])
    detector.run(Samples.of(0, times(200, 2.0), 50.0, 50.0, 20.0))
    assert detector.state[0]["period"] == 2.0
    detector.run(Samples.of(0, times(300, 5.0, START + 1000 * SECOND), 50.0, 50.0, 20.0))
    assert detector.state[0]["period"] == 5.0
