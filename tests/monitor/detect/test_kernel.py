"""The kernel against naive twins: any batching, any unit, any clock."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.detect.detector import Detector
from tests.support.detection import as_bytes, columns_of, detected, events_of, slots_are_whole
from tests.support.plants import stepped
from tests.support.twins import integrals


def test_running_integrals_equal_their_naive_twin():
    """All integrals, on uneven times, equal the textbook sums over the event's samples."""
    samples = stepped(700, noise=0.05, seed=3)
    jitter = np.random.default_rng(1).integers(-200_000_000, 200_000_000, len(samples))
    samples = replace(samples, time=samples.time + jitter)
    _, found = detected(samples, period=1.0)
    (event,) = events_of(found)
    window, before = columns_of(event.window), event.window.before
    naive = integrals(window[before:], event.pv0, event.op0)
    for name in ("s1", "s2", "y1", "iae"):
        assert getattr(event, name) == pytest.approx(naive[name], rel=1e-9), name


@settings(max_examples=30)
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
        state["window"]["slot"] = np.minimum(
            state["window"]["slot"], 0
        )  # where a window lies depends on the batches
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


@settings(max_examples=25)
@given(
    a=st.floats(1e-3, 1e3),
    b=st.floats(-1e4, 1e4),
    c=st.floats(1e-3, 1e3),
    d=st.floats(-1e3, 1e3),
    shift=st.integers(-(10**18), 10**18),
)
def test_units_and_clock_do_not_matter(a, b, c, d, shift):
    """PV and SP in other units (a x + b), OP too, at another time: the same events, integrals scaled."""
    samples = stepped(700, noise=0.02, seed=9)
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


def test_stretches_are_the_samples_themselves_however_they_are_batched(fleet):
    """Each is a row of a loop's samples as they came; first all, then one each time their number has doubled."""
    loops, samples = fleet
    whole, parts = Detector(loops), Detector(loops)
    whole.run(samples)
    taken = whole.take_stretches()
    assert len(taken) > len(loops)
    assert not whole.take_stretches()
    pieces = []
    for cut in np.array_split(np.arange(len(samples)), 13):
        parts.run(samples.take(cut))
        pieces += parts.take_stretches()
    for one, other in zip(taken, pieces, strict=True):
        assert (one.row, one.start, one.end, one.period) == (other.row, other.start, other.end, other.period)
        np.testing.assert_array_equal(columns_of(one.window), columns_of(other.window))
    for stretch in taken:
        inside = (
            (samples.loop == stretch.row) & (samples.time >= stretch.start) & (samples.time <= stretch.end)
        )
        own = samples.take(np.flatnonzero(inside))
        kept = np.isin(own.time, stretch.start + np.round(stretch.window.time * 1e9).astype(np.int64))
        np.testing.assert_array_equal(own.op[kept], stretch.window.op)
        np.testing.assert_array_equal(own.pv[kept], stretch.window.pv)
