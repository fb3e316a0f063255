"""Spans of oscillation: found with their times, put together over blocks, and none where nothing swings on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from monitor.health.episodes import MOST_SPANS, NS, Episode, Episodes, episodes_of, too_fast
from tests.bench.swings_fleet import SHAPES, bursts, healthy, swing, wave
from tests.monitor.health import plant_records
from tests.monitor.health.cycles import Array, noise

START = 1_700_000_000 * NS


def burst(n: int, start: int, end: int, cycle: float, seed: int = 0) -> Array:
    x = 0.2 * noise(n, seed)
    x[start:end] += np.sin(2 * np.pi * np.arange(end - start) / cycle)
    return x


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cycle", [8.0, 14.2, 33.0, 70.0])
def test_eight_cycles_are_found_with_their_times(shape: str, cycle: float) -> None:
    n, length = 1000, int(8 * cycle)
    e = 0.1 * noise(n)
    e[200 : 200 + length] += wave(shape, np.arange(length) / cycle)
    strong = [f for f in episodes_of(e, 2.0) or [] if f.strong]
    assert len(strong) == 1
    assert strong[0].period == pytest.approx(2.0 * cycle, rel=0.05)
    assert strong[0].start == pytest.approx(200, abs=1.5 * cycle)
    assert strong[0].end == pytest.approx(200 + length, abs=1.5 * cycle)
    assert strong[0].score > 0.6


def test_too_few_samples_are_not_judged_and_a_constant_is_quiet() -> None:
    assert episodes_of(noise(12), 1.0) is None
    assert episodes_of(np.full(200, np.nan), 1.0) is None
    assert episodes_of(np.append(noise(200), np.nan), 1.0) is None
    assert episodes_of(np.full(200, 3.7), 1.0) == []
    assert episodes_of(0.1 * np.arange(200.0) + 1e6, 1.0) == []


@pytest.mark.parametrize("seed", range(20))
def test_noise_of_any_colour_is_not_called_oscillating(seed: int) -> None:
    w = noise(1024, seed)
    for x in (w, np.cumsum(w), lfilter([1], [1, -0.9], w), lfilter([1], [1, -0.99], w)):
        own = Episodes()
        own.add(episodes_of(np.asarray(x), 1.0), START, 1024, 1.0)
        assert not own.oscillating


def test_a_loop_stepped_to_and_fro_has_no_episode() -> None:
    for seed in range(12):
        r = healthy(np.random.default_rng([7, seed]), "to and fro")
        assert not any(f.strong for f in episodes_of(r.sp - r.pv, 1.0, r.sp) or [])


@given(
    seed=st.integers(0, 10_000),
    scale=st.floats(1e-6, 1e6),
    sign=st.sampled_from([-1.0, 1.0]),
    offset=st.floats(-10, 10),
)
def test_scale_sign_and_offset_of_the_error_do_not_matter(
    seed: int, scale: float, sign: float, offset: float
) -> None:
    rng = np.random.default_rng(seed)
    e = swing(rng, "sine", 7, within=True).error
    e /= np.std(e)
    one, other = episodes_of(e, 1.0) or [], episodes_of(sign * scale * (e + offset), 1.0) or []
    assert [(f.start, f.end, f.strong) for f in one] == [(f.start, f.end, f.strong) for f in other]
    assert [f.amplitude * scale for f in one] == pytest.approx([f.amplitude for f in other])


def test_slower_sampling_is_a_longer_period() -> None:
    one, other = episodes_of(burst(500, 100, 400, 20), 1.0), episodes_of(burst(500, 100, 400, 20), 5.0)
    assert one is not None
    assert other is not None
    assert other[0].period == pytest.approx(5.0 * one[0].period)


def test_a_multiple_of_the_period_is_not_reported_beside_it() -> None:
    for cycle in (5, 7, 9):
        found = episodes_of(burst(1000, 0, 1000, cycle), 1.0) or []
        assert [round(f.period) for f in found] == [cycle]


def test_a_slow_swing_beneath_a_fast_one_is_an_episode_of_its_own() -> None:
    t = np.arange(1000)
    found = episodes_of(
        np.sin(2 * np.pi * t / 8) + 3.0 * np.sin(2 * np.pi * t / 120) + 0.1 * noise(1000), 1.0
    )
    assert sorted(round(f.period / 8) for f in found or []) == [1, 15]


def test_most_short_and_intermittent_swings_are_found() -> None:
    """The bench has the shares; here those that must not fall."""
    rng = np.random.default_rng(99)
    drawn = [
        swing(rng, s, 8, w) for s in ("sine", "square", "triangle") for w in (True, False) for _ in range(10)
    ]
    drawn += [bursts(rng, "sine", share) for share in (0.15, 0.25, 0.5) for _ in range(10)]
    hit = [
        any(f.strong and abs(f.period / d.period - 1) < 0.15 for f in episodes_of(d.error, 1.0) or [])
        for d in drawn
    ]
    assert np.mean(hit) >= 0.95


def test_fifteen_per_cent_of_a_record_is_reported_and_not_called_oscillating() -> None:
    own = Episodes()
    own.add(episodes_of(burst(1000, 300, 450, 15), 1.0), START, 1000, 1.0)
    assert own.oscillating is False
    assert own.oscillating_share == pytest.approx(0.15, abs=0.03)
    assert own.longest is not None
    assert (own.longest.start - START) / NS == pytest.approx(300, abs=20)
    assert own.period == pytest.approx(15, rel=0.05)


def test_nothing_judged_is_null_and_not_zero() -> None:
    own = Episodes()
    own.add(None, START, 10, 1.0)
    assert own.oscillating is None
    assert own.oscillating_share is None
    assert own.period is None
    own.add([], START, 500, 1.0)
    assert own.oscillating is False
    assert own.oscillating_share == 0.0


def test_an_episode_goes_on_over_the_border_of_two_blocks() -> None:
    e = burst(1600, 300, 1300, 25)
    own = Episodes()
    for k in range(2):
        part = slice(800 * k, 800 * (k + 1))
        own.add(episodes_of(e[part], 2.0), START + 1600 * k * NS, 800, 2.0)
    strong = [s for s in own.spans if s.strong]
    assert len(strong) == 1
    assert strong[0].duration == pytest.approx(2000, rel=0.08)
    assert own.oscillating


def test_another_period_or_a_gap_is_another_span() -> None:
    def at(start: int, period: float) -> list[Episode]:
        return [Episode(start, start + 100, period, 1.0, 0.9, strong=True)]

    own = Episodes()
    own.add(at(0, 10.0), START, 1000, 1.0)
    own.add(at(105, 14.0), START, 1000, 1.0)
    own.add(at(115, 10.0), START, 1000, 1.0)
    assert len(own.spans) == 3
    own.add(at(205, 11.0), START, 1000, 1.0)
    assert len(own.spans) == 3


def test_what_is_kept_is_bounded_the_longest_and_the_newest() -> None:
    own = Episodes()
    for k in range(100):
        end = 900 if k == 3 else 100
        own.add([Episode(0, end, 10.0, 1.0, 0.9, strong=True)], START + 1000 * k * NS, 1000, 1.0)
        assert len(own.spans) <= MOST_SPANS
    assert own.longest is not None
    assert own.longest.duration == pytest.approx(900)
    assert (own.spans[-1].start - START) // (1000 * NS) == 99
    assert own.oscillating_share == pytest.approx(0.108)
    own.decay()
    assert own.oscillating_share == pytest.approx(0.108)


def test_parts_are_merged_to_what_the_whole_is() -> None:
    blocks = [burst(800, 100 * k % 500, 100 * k % 500 + 250, 20, k) for k in range(6)]
    whole, parts = Episodes(), [Episodes(), Episodes()]
    for k, e in enumerate(blocks):
        for own in (whole, parts[k // 3]):
            own.add(episodes_of(e, 1.0), START + 800 * k * NS, 800, 1.0)
    parts[0].merge(parts[1])
    assert parts[0].spans == whole.spans
    assert parts[0].oscillating_share == pytest.approx(whole.oscillating_share)


def test_two_or_three_samples_a_cycle_are_too_fast_and_noise_is_not() -> None:
    t = np.arange(400)
    assert too_fast(np.sin(2 * np.pi * t / 2.4) + 0.3 * noise(400))
    assert not too_fast((np.sin(2 * np.pi * t / 2.4))[:150])
    assert not too_fast(np.zeros(400))
    assert not any(too_fast(np.diff(noise(401, seed))) for seed in range(30))
    assert not too_fast(np.sin(2 * np.pi * t / 6))


@plant_records.needed
def test_a_refinerys_records_are_read_as_the_engineer_reads_them() -> None:
    """Whoever is no cycle is not called one; a valve's may be."""
    for label, sp, pv, _, period in plant_records.records():
        own = Episodes()
        own.add(episodes_of(sp - pv, period, sp), START, len(pv), period)
        if label == "oscillating":
            assert own.oscillating
            assert own.period == pytest.approx(152.0, rel=0.05)
        elif label not in {"fast_cycle", "valve", "integral"}:
            assert not own.oscillating, label
