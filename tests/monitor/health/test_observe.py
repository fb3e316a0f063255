"""Health figures of signals whose truth is known: PV, OP, tags, archives; streaming, scale, bad data, memory."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import lfilter

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.health.loop_health import Health, figures
from monitor.health.observe import HEALTH
from tests.support.plants import SECOND, START

Array = NDArray[np.float64]
N = 3000
WEEK = 7 * 86400


def noise(n: int = N, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=n)


def samples_of(sp: Any, pv: Any, op: Any, auto: Any = None, period: float = 1.0, time: Any = None) -> Samples:
    """Samples of loop 0, regular unless times [s] are given."""
    n = max(np.size(v) for v in (sp, pv, op))
    seconds = np.arange(n) * period if time is None else np.asarray(time)
    at = START + np.round(seconds * SECOND).astype(np.int64)
    return Samples.of(0, at, *(np.broadcast_to(v, (n,)) for v in (sp, pv, op)), auto)


def run(samples: Samples, chunk: int | None = None, **facts: Any) -> Detector:
    detector = Detector([Loop(name="L", **facts)])
    size = len(samples) if chunk is None else chunk
    for k in range(0, len(samples), max(size, 1)):
        detector.run(samples.take(slice(k, k + size)))
    return detector


def look(detector: Detector, dead_time: float | None = None) -> Health:
    return figures(detector.health[0], float(detector.state["period"][0]), dead_time)


def health(
    sp: Any, pv: Any, op: Any, auto: Any = None, dead_time: float | None = None, **more: Any
) -> Health:
    """Figures of one loop; ``more``: period, time, and facts of the loop table."""
    shape = {k: more.pop(k) for k in ("period", "time") if k in more}
    return look(run(samples_of(sp, pv, op, auto, **shape), **more), dead_time)


# -- shares of time ------------------------------------------------------------------------------------


def test_nothing_is_known_of_a_loop_without_samples():
    """And of one with a single sample."""
    assert look(Detector([Loop(name="L")])) == Health()
    assert health(50.0, 50.0, np.full(1, 30.0)) == Health()


def test_manual_and_coverage_are_shares_of_time():
    """A quarter in manual; a tenth of the time missing in gaps."""
    auto = np.arange(N) % 400 >= 100
    assert health(50.0, 50 + noise(), 30.0, auto).manual == pytest.approx(0.25, abs=0.02)
    time = np.arange(N) + 100.0 * (np.arange(N) // 1000)
    assert health(50.0, 50 + noise(), 30.0, time=time).coverage == pytest.approx(N / (N + 200), abs=2e-3)


def test_saturation_with_known_limits_is_time_at_them():
    """At or beyond either."""
    op = np.clip(30 + 20 * np.sin(np.arange(N) / 40), 15, 45)
    share = float(np.mean((op <= 15) | (op >= 45)))
    assert health(50.0, 50 + noise(), op, op_low=15.0, op_high=45.0).saturation == pytest.approx(
        share, abs=0.01
    )
    assert health(50.0, 50 + noise(), op, op_low=0.0, op_high=100.0).saturation == 0


def test_saturation_without_limits_is_rest_at_own_extremes():
    """Where OP rests exactly; a coarse OP that dwells at two values, or one that never rests, is not saturated."""
    op = np.clip(30 + 20 * np.sin(np.arange(N) / 40), 15, 45)
    share = float(np.mean((op <= 15) | (op >= 45)))
    assert health(50.0, 50 + noise(), op).saturation == pytest.approx(share, abs=0.02)
    assert health(50.0, 50 + noise(), 30 + noise()).saturation == 0
    coarse = np.round(30 + np.sin(np.arange(N) / 40))
    assert health(50.0, 50 + noise(), coarse).saturation == 0


# -- PV ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [1e-6, 0.1, 1e6])
def test_white_noise_is_measured_and_other_noise_is_not(sigma):
    """Within 5 %; a random walk and a fast lag have no white noise to speak of."""
    assert health(0.0, sigma * noise(), 30 + noise(seed=1)).noise == pytest.approx(sigma, rel=0.05)
    assert health(0.0, sigma * np.cumsum(noise()), 30.0).noise is None
    assert health(0.0, sigma * lfilter([1], [1, -0.8], noise()), 30.0).noise is None


def test_noise_is_that_of_the_quiet_time():
    """A few large steps of PV do not raise it."""
    pv = 50 + 0.1 * noise() + 20 * (np.arange(N) % 1000 > 500)
    assert health(50.0, pv, 30.0).noise == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("step", [0.25, 0.1, 1 / 3, 100 / 4096])
def test_the_transmitters_step_is_found(step):
    """Whatever its size, from doubles and from single precision."""
    pv = np.round((50 + 3 * step * noise()) / step) * step
    assert health(50.0, pv, 30.0).quantum == pytest.approx(step, rel=1e-3)
    assert health(50.0, pv.astype(np.float32), 30.0).quantum == pytest.approx(step, rel=1e-3)


def test_one_odd_value_does_not_hide_the_transmitters_step():
    """Nor does it make of a coarse PV that dwells a compressed one."""
    pv = np.round((50 + 0.5 * noise()) / 0.5) * 0.5
    pv[300] += 0.11
    found = health(50.0, pv, 30 - noise())
    assert found.quantum == pytest.approx(0.5, rel=1e-3)
    assert found.compression == 0


@pytest.mark.parametrize("first", [0.01, 0.1])
def test_a_short_first_interval_is_no_compression(first):
    """An export begins with its boundary's value."""
    time = np.r_[0.0, first + np.arange(799)]
    assert health(50.0, 50 + noise(800), 30 - noise(800), time=time).compression == pytest.approx(0, abs=0.02)


def test_a_dead_time_is_no_frozen_pv():
    """At the start of a short record without noise; a PV that stays frozen is one."""
    t = np.arange(700)
    op = 30 + 0.01 * np.maximum(t - 100, 0)
    assert not health(50.0, 50 + 0.01 * np.maximum(t - 180, 0), op).stuck
    assert health(50.0, 50.0, op).stuck


def test_a_pv_without_steps_has_none():
    """Nor one whose steps are those of single precision, far below its noise."""
    assert health(50.0, 50 + noise(), 30.0).quantum is None
    assert health(50.0, (50 + noise()).astype(np.float32), 30.0).quantum is None


def test_frozen_idle_and_coarse_are_told_apart():
    """PV rests while OP moves: stuck. All rest: idle. A coarse PV dwells: neither."""
    frozen = np.r_[50 + noise(1500), np.full(1500, 50.3)]
    assert health(50.0, frozen, 30 + np.cumsum(0.1 * noise())).stuck
    assert not health(50.0, frozen, 30 + np.cumsum(0.1 * noise())).idle
    assert health(50.0, np.full(N, 49.0), 30.0).idle
    assert not health(50.0, np.full(N, 49.0), 30.0).stuck
    slow = np.round(50 + 2 * np.sin(np.arange(N) / 300))
    coarse = health(50.0, slow, 30 + np.cumsum(0.01 * (50 - slow)))
    assert not coarse.stuck
    assert not coarse.idle


def test_a_permanent_offset_is_one_that_never_goes_away():
    """On one side for good, and more than noise; a wandering error and a small bias are none."""
    assert health(50.0, 47 + noise(), 30.0).settled_offset
    assert health(50.0, 47 + noise(), 30.0).offset == pytest.approx(3.0, abs=0.1)
    assert not health(50.0, 50.2 + noise(), 30.0).settled_offset
    wander = 50 + lfilter([1], [1, -0.98], noise())
    assert not health(50.0, wander, 30.0).settled_offset


# -- OP ------------------------------------------------------------------------------------------------


def test_travel_counts_the_way_not_the_noise():
    """A sine of amplitude 5 goes 20 a cycle and turns twice, with or without noise; noise alone goes nowhere."""
    t = np.arange(20 * N)
    swing = 30 + 5 * np.sin(2 * np.pi * t / 500)
    for sigma in (0.0, 0.2):
        found = health(50.0, 50 + noise(len(t), 1), swing + sigma * noise(len(t)))
        assert found.travel_per_hour == pytest.approx(20 * 3600 / 500, rel=0.02)
        assert found.reversals_per_hour == pytest.approx(2 * 3600 / 500, rel=0.02)
    still = health(50.0, 50 + noise(len(t), 1), 30 + 0.2 * noise(len(t)))
    assert still.travel_per_hour == pytest.approx(0, abs=2)
    assert still.op_noise == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("every", [2, 5, 10])
def test_travel_does_not_depend_on_the_sampling(every):
    """Nor do mean error and offset."""
    t = np.arange(40_000)
    swing = np.sin(2 * np.pi * t / 700)
    fine = samples_of(50.0, 50.3 + swing + 0.1 * noise(len(t)), 30 + 5 * swing + 0.3 * noise(len(t), 1))
    a, b = look(run(fine)), look(run(fine.take(slice(None, None, every))))
    for name in ("travel_per_hour", "mean_abs_e", "offset", "oscillation_period"):
        assert getattr(b, name) == pytest.approx(getattr(a, name), rel=0.05)


@pytest.mark.parametrize("every", [2, 5, 10])
def test_travel_of_irregular_swings_near_the_noise_does_not_depend_on_the_sampling(every):
    """A resonance that noise excites: its swings are of all sizes, 8 standard deviations of the noise on average."""
    n, r = 80_000, 0.99
    swing = lfilter([1], [1, -2 * r * np.cos(2 * np.pi / 300), r * r], noise(n, 2))
    op = 30 + 3 * swing / swing.std() + noise(n, 1)
    fine = samples_of(50.0, 50 + noise(n), op)
    a, b = look(run(fine)), look(run(fine.take(slice(None, None, every))))
    assert 5 < a.travel_per_hour / a.reversals_per_hour < 12
    assert b.travel_per_hour == pytest.approx(a.travel_per_hour, rel=0.05)
    assert b.reversals_per_hour == pytest.approx(a.reversals_per_hour, rel=0.1)


def test_an_output_whose_noise_grows_has_the_new_one():
    """A hundredfold, halfway."""
    t = np.arange(40_000)
    grown = np.where(t < 20_000, 0.02, 2.0)
    found = health(50.0, 50 + noise(len(t)), 30 + 30 * np.sin(t / 100) + grown * noise(len(t), 1))
    assert found.op_noise == pytest.approx(2.0, rel=0.1)
    assert found.travel_per_hour == pytest.approx(120 * 3600 / (200 * np.pi), rel=0.05)


def test_travel_is_withheld_where_chance_decides():
    """Swings as large as the noise: none. A single clear move counts, and an output in its noise rests."""
    t = np.arange(40_000)
    assert (
        health(50.0, 50 + noise(len(t)), 30 + 1.3 * np.sin(t / 60) + noise(len(t), 1)).travel_per_hour is None
    )
    moved = health(50.0, 50 + noise(len(t)), 30 + 20 * (t > 20_000) + noise(len(t), 1))
    assert moved.travel_per_hour == pytest.approx(20 * 3600 / len(t), rel=0.1)
    assert health(50.0, 50 + noise(len(t)), 30 + noise(len(t), 1)).travel_per_hour == 0.0


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_a_sample_period_that_wanders_hides_no_oscillation(share):
    """One second and two, mixed at random: the period that is learnt flips, the cycle stays."""
    rng = np.random.default_rng(3)
    t = np.cumsum(np.where(rng.random(40_000) < share, 2, 1))
    pv = 50 + np.sin(2 * np.pi * t / 60) + 0.05 * rng.normal(size=len(t))
    found = look(run(samples_of(50.0, pv, 30 - pv, time=t)))
    assert found.oscillating
    assert found.oscillation_period == pytest.approx(60, rel=0.02)


# -- tags ----------------------------------------------------------------------------------------------


def test_wrong_tags_are_suspected():
    """SP and PV swapped; an OP that does not hear the error; an SP that tracks PV. Not a P controller in noise."""
    rests = 50 + np.repeat(noise(N // 500, 3), 500)
    assert health(50 + noise(), rests, 30 + noise(seed=1)).mapping
    assert health(50.0, 50 + noise(), 30 + noise(seed=1)).mapping
    tracks = health(50 + noise(), 50 + noise(), 30.0)
    assert tracks.mapping
    assert tracks.held == 1
    assert not health(50.0, 50 + noise(), 30 - noise()).mapping
    assert not health(50.0, 50 + noise(), 30 - np.cumsum(0.1 * noise())).mapping


def test_an_output_that_rests_while_the_error_moves_is_held():
    """From 200 samples on; not if it is at its limit."""
    e = np.cumsum(0.1 * noise())
    assert health(50.0, 50 - e, 30.0).held == pytest.approx(1, abs=0.1)
    assert health(50.0, 50 - e, 100.0, op_high=100.0).held == 0
    assert health(50.0, 50 - e, 30 + e).held == 0


def test_a_change_of_unit_is_not_a_step():
    """degC to degF on SP and PV at once; a set-point step that PV follows at once by OP is a step."""
    later = np.arange(N) >= 1500
    pv = 50 + 0.3 * noise()
    sp = np.where(later, 122.0, 50.0)
    assert health(sp, np.where(later, 1.8 * pv + 32, pv), 30 - 0.1 * noise()).config_change
    assert not health(sp, pv + 72 * later, 30 - 0.1 * noise() + 20 * later).config_change
    assert not health(50.0, pv, 30 - 0.1 * noise()).config_change


def test_a_moving_set_point_is_seen():
    """A cascade's slave, a ramp; two steps are two samples."""
    assert health(50 + noise(), 50 + noise(seed=1), 30.0).sp_moving == pytest.approx(1)
    assert health(np.where(np.arange(N) > 1000, 51.0, 50.0), 50 + noise(), 30.0).sp_moving == pytest.approx(
        1 / N, rel=0.1
    )


@pytest.mark.parametrize("at", [10, 600, 2000])
@pytest.mark.parametrize("value", [-999.25, 0.0, 1e5])
def test_one_odd_value_does_not_condemn_the_tags(at, value):
    """Of PV or of SP, OP takes no notice: the loop is as well wired as before, and as well sampled."""
    e = 0.1 * noise()
    sp = 50.0 + 5 * (np.arange(N) % 1000 >= 500)
    op = 30 + 0.3 * e + 0.01 * np.cumsum(e)
    odd = np.arange(N) == at
    for found in (health(sp, np.where(odd, value, sp - e), op), health(np.where(odd, value, sp), sp - e, op)):
        assert not found.mapping
    slow = 50 + lfilter([0, 0.05], [1, -0.95], sp - 50) + e
    assert not health(np.where(odd, value, sp), slow, op).undersampled


@pytest.mark.parametrize(("lag", "coarse"), [(0.5, True), (20.0, False)])
def test_a_response_over_before_it_is_seen_is_undersampled(lag, coarse):
    """PV follows SP with a lag of half a sample, or of twenty."""
    sp = 50.0 + 5 * (np.arange(N) % 600 >= 300)
    a = math.exp(-1 / lag)
    pv = 50 + lfilter([0, 1 - a], [1, -a], sp - 50) + 0.1 * noise()
    assert health(sp, pv, 30 - 0.1 * noise() + sp).undersampled is coarse


def test_an_error_that_alternates_is_undersampled():
    """Two samples a cycle; white noise is not."""
    assert health(50.0, 50 + np.cos(np.pi * 0.97 * np.arange(N)) + 0.1 * noise(), 30 + noise()).undersampled
    assert not health(50.0, 50 + noise(), 30 - noise()).undersampled


# -- Harris index --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("delay", "index"), [(1, 0.19), (2, 0.344), (3, 0.469), (5, 0.651)])
def test_minimum_variance_of_a_first_order_error(delay, index):
    """AR(1) with 0.9: 1 - 0.9^(2 b)."""
    e = lfilter([1], [1, -0.9], noise(40_000))
    assert health(50.0, 50 - e, 30 + e, dead_time=float(delay)).harris == pytest.approx(index, abs=0.02)
    assert health(50.0, 50 - e, 30 + e, dead_time=delay * 5.0, period=5.0).harris == pytest.approx(
        index, abs=0.02
    )


def test_the_index_is_withheld_without_its_conditions():
    """Unknown, unresolved or too long a dead time; too little data; a PV of a few steps."""
    e = lfilter([1], [1, -0.9], noise(5000))
    assert health(50.0, 50 - e, 30 + e).harris is None
    for dead_time in (0.2, 35.0):
        assert health(50.0, 50 - e, 30 + e, dead_time=dead_time).harris is None
    assert health(50.0, 50 - e[:500], 30 + e[:500], dead_time=2.0).harris is None
    assert health(50.0, np.round((50 - e) / 10) * 10, 30 + e, dead_time=2.0).harris is None


# -- streaming -----------------------------------------------------------------------------------------


def mixed(n: int = 2500, seed: int = 4) -> Samples:
    """A loop with everything: oscillation, steps of SP, manual, a gap, missed samples, repeated values."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([1.0, 1.0, 1.0, 1.0, 2.0], n)) + 500.0 * (np.arange(n) > n // 2)
    sp = 50 + 2.0 * (np.arange(n) % 700 > 350)
    e = np.sin(2 * np.pi * t / 33) + 0.2 * rng.normal(size=n)
    pv = np.round((sp - e) / 0.05) * 0.05
    auto = np.arange(n) % 900 < 800
    return samples_of(sp, pv, 30 + 3 * e, auto, time=t)


@settings(max_examples=10, deadline=None)
@given(st.integers(1, 400))
def test_chunks_do_not_matter(chunk):
    """The sums are the same to the bit however the samples were cut."""
    whole, parts = run(mixed()), run(mixed(), chunk)
    assert whole.health.tobytes() == parts.health.tobytes()


def test_shares_and_means_equal_their_naive_twins_at_every_prefix():
    """In ten lines of plain Python."""
    samples = mixed(700)
    detector = Detector([Loop(name="L", period=1.0)])
    t, sp, pv, auto = (getattr(samples, n).tolist() for n in ("time", "sp", "pv", "auto"))
    good = hand = error = size = known = 0.0
    for k in range(len(samples)):
        detector.run(samples.take(slice(k, k + 1)))
        dt = (t[k] - t[k - 1]) * 1e-9 if k else 0.0
        if 0 < dt < 3.5:
            good += min(dt, 1.5)
            hand += 0.0 if auto[k - 1] else dt
            if auto[k - 1] and auto[k]:
                known += dt
                error += (sp[k - 1] - pv[k - 1]) * dt
                size += abs(sp[k - 1] - pv[k - 1]) * dt
        if known:
            found = look(detector)
            assert found.coverage == pytest.approx(good / ((t[k] - t[0]) * 1e-9))
            assert found.manual == pytest.approx(min(hand / good, 1))
            assert found.offset == pytest.approx(error / known)
            assert found.mean_abs_e == pytest.approx(size / known)


@settings(max_examples=10, deadline=None)
@given(st.floats(-3, 3), st.floats(-1, 1))
def test_the_unit_of_pv_does_not_matter(power, shift):
    """Figures in PV scale, the others stay."""
    a, b = 10.0**power, 100.0 * shift
    samples = mixed()
    scaled = replace(samples, sp=a * samples.sp + b, pv=a * samples.pv + b)
    one, other = asdict(look(run(samples))), asdict(look(run(scaled)))
    for name in ("offset", "noise", "quantum", "mean_abs_e"):
        one[name] = None if one[name] is None else a * one[name]
    for name, value in one.items():
        if value is None or isinstance(value, bool):
            assert other[name] == value, name
        else:
            assert other[name] == pytest.approx(
                value, rel=1e-3, abs=1e-3 * a if name == "offset" else 1e-3
            ), name


def test_bad_samples_leave_no_trace():
    """Not a number, infinite, a gateway's placeholder, of bad quality: the sums stay as they are."""
    clean = mixed(900)
    dirty = clean.take(np.repeat(np.arange(len(clean)), 2))
    bad = np.arange(len(dirty)) % 2 == 1
    kinds = np.array([np.nan, np.inf, -np.inf, 1e38])[np.arange(bad.sum()) % 4]
    dirty.pv[bad] = kinds
    dirty.time[bad] += 1
    assert run(clean).health.tobytes() == run(dirty).health.tobytes()


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 2**31),
    st.sampled_from([0.0, 1e-300, 1e-9, 1.0, 1e9, 9e29]),
    st.sampled_from([0.0, 1.0, 1e29]),
    st.sampled_from(["noise", "constant", "walk", "spike", "wave"]),
)
def test_figures_are_numbers_whatever_comes_in(seed, scale, level, kind):
    """No NaN or infinity in the sums, all figures finite, shares between 0 and 1."""
    rng = np.random.default_rng(seed)
    n = 700
    x = {
        "noise": rng.normal(size=n),
        "constant": np.zeros(n),
        "walk": np.cumsum(rng.normal(size=n)),
        "spike": (np.arange(n) == 300) * 1.0,
        "wave": np.sin(np.arange(n) / 3),
    }[kind]
    pv = np.clip(level + scale * x / max(1.0, float(np.abs(x).max())), -9.9e29, 9.9e29)
    sp = np.where(rng.random(n) < 0.01, level + scale, level)
    auto = rng.random() < 0.5 or rng.random(n) > 0.05
    detector = run(samples_of(sp, pv, np.clip(-pv, -9e29, 9e29), auto, time=np.cumsum(rng.integers(1, 3, n))))
    for name in HEALTH.names or ():
        assert np.isfinite(detector.health[name]).all(), name
    found = asdict(look(detector, dead_time=3.0))
    assert all(v is None or math.isfinite(v) for v in found.values())
    shares = (
        "coverage manual saturation oscillation_regularity stiction harris compression held sp_moving".split()
    )
    assert all(found[n] is None or 0 <= found[n] <= 1 for n in shares)


def test_memory_of_a_loop_is_small_and_constant():
    """A hundred thousand loops fit into half a gigabyte."""
    assert HEALTH.itemsize < 5200


def test_recent_weeks_count():
    """A loop in manual for a week, two months ago, is not called one that is in manual for a third of the time."""
    period = 600.0
    n = round(9 * WEEK / period)
    auto = np.arange(n) > WEEK / period
    assert health(50.0, 50 + noise(n), 30 - noise(n), auto, period=period).manual == pytest.approx(
        0.0, abs=0.05
    )
    late = np.arange(n) < n - WEEK / period
    manual = health(50.0, 50 + noise(n), 30 - noise(n), late, period=period).manual
    assert manual is not None
    assert manual > 0.15
