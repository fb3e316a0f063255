"""How PV follows a set point: what tracks, rings or crawls is called so, and a sticking valve is never good."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from monitor.health.tracking import tracking_of, tracking_verdict
from tests.bench.swings_fleet import Array, moves
from tests.monitor.health import plant_records
from tests.monitor.health.cycles import noise

NOISE = 0.05


def stepped(n: int = 600, at: tuple[int, ...] = (100, 350), size: float = 2.0) -> Array:
    sp = np.full(n, 40.0)
    for k, place in enumerate(at):
        sp[place:] += size if k % 2 == 0 else -size
    return sp


def followed(sp: Array, delay: int = 2, lag: float = 4.0, seed: int = 0) -> Array:
    """PV through a delay and a lag [samples]."""
    keep = np.exp(-1.0 / lag)
    late = np.concatenate([np.full(delay + 1, sp[0]), sp[: len(sp) - delay - 1]])
    slow = lfilter([1.0 - keep], [1.0, -keep], late - sp[0]) + sp[0]
    return np.asarray(slow + NOISE * noise(len(sp), seed))


@pytest.mark.parametrize(("delay", "lag"), [(0, 0.5), (2, 4.0), (5, 8.0)])
def test_delay_and_lag_are_found_and_it_tracks(delay: int, lag: float) -> None:
    sp = stepped()
    found = tracking_of(sp, followed(sp, delay, lag), 5.0, NOISE)
    assert [m.start for m in found] == [100, 350]
    assert [m.size for m in found] == pytest.approx([2.0, -2.0])
    assert [m.verdict for m in found] == ["tracks", "tracks"]
    assert found[0].delay + found[0].lag == pytest.approx(5.0 * (delay + lag), abs=8.0)
    assert tracking_verdict(found) == "tracks"


def test_a_swing_beyond_the_set_point_rings() -> None:
    sp = stepped()
    e = np.zeros(600)
    for at, sign in ((100, 1.0), (350, -1.0)):
        t = np.arange(600 - at)
        e[at:] += sign * np.exp(-t / 25.0) * np.cos(2 * np.pi * t / 20)
    found = tracking_of(sp, sp - e * 2.0 + NOISE * noise(600), 1.0, NOISE)
    assert tracking_verdict(found) == "rings"


def test_what_comes_quickly_and_then_creeps_crawls() -> None:
    sp = stepped(1000, (100, 600))
    pv = 40.0 + 0.5 * (followed(sp, 1, 3.0) - 40.0)
    keep = np.exp(-1.0 / 300.0)
    pv += 0.5 * lfilter([1.0 - keep], [1.0, -keep], sp - 40.0)
    assert tracking_verdict(tracking_of(sp, pv, 1.0, NOISE)) == "crawls"


def test_one_small_move_is_not_enough_and_two_or_a_large_one_are() -> None:
    one = stepped(at=(100,), size=15 * NOISE)
    moves_of = tracking_of(one, followed(one), 1.0, NOISE)
    assert moves_of[0].verdict == "tracks"
    assert tracking_verdict(moves_of) is None
    assert tracking_verdict(moves_of * 2) == "tracks"
    large = stepped(at=(100,), size=40 * NOISE)
    assert tracking_verdict(tracking_of(large, followed(large), 1.0, NOISE)) == "tracks"


def test_steps_that_follow_closely_are_one_move() -> None:
    sp = np.full(400, 40.0)
    for k in range(4):
        sp[100 + 6 * k :] += 1.0
    found = tracking_of(sp, followed(sp), 1.0, NOISE)
    assert [m.size for m in found] == [4.0]
    assert found[0].verdict == "tracks"


def test_a_slave_and_a_ramp_have_no_moves() -> None:
    walk = 40.0 + np.cumsum(noise(400))
    ramp = np.clip(np.arange(400) - 100.0, 0.0, 50.0)
    for sp in (walk, ramp, np.full(400, 40.0)):
        assert tracking_of(sp, followed(sp), 1.0, NOISE) == []


def test_a_step_just_before_the_end_or_in_the_noise_says_nothing() -> None:
    late = stepped(at=(590,))
    assert [m.verdict for m in tracking_of(late, followed(late), 1.0, NOISE)] == [None]
    small = stepped(size=6 * NOISE)
    assert tracking_verdict(tracking_of(small, followed(small), 1.0, NOISE)) is None
    missing = followed(stepped())
    missing[5] = np.nan
    assert tracking_of(stepped(), missing, 1.0, NOISE) == []
    assert tracking_verdict([]) is None


def test_moves_that_contradict_each_other_say_nothing() -> None:
    sp = stepped()
    pv = followed(sp)
    pv[350:] = 42.0 + NOISE * noise(250)  # the second one is not answered
    assert tracking_verdict(tracking_of(sp, pv, 1.0, NOISE)) is None


@given(
    seed=st.integers(0, 500),
    scale=st.floats(1e-3, 1e3),
    sign=st.sampled_from([-1.0, 1.0]),
    offset=st.floats(-50, 50),
)
def test_scale_sign_and_offset_do_not_matter(seed: int, scale: float, sign: float, offset: float) -> None:
    sp = stepped()
    pv = followed(sp, seed=seed)
    one = tracking_of(sp, pv, 1.0, NOISE)
    other = tracking_of(sign * scale * (sp + offset), sign * scale * (pv + offset), 1.0, scale * NOISE)
    assert [m.verdict for m in one] == [m.verdict for m in other]
    assert [m.fit for m in one] == pytest.approx([m.fit for m in other], abs=1e-6)


def test_noise_free_moves_are_judged_too() -> None:
    sp = stepped()
    pv = followed(sp) - NOISE * noise(600)
    assert tracking_verdict(tracking_of(sp, pv, 1.0, 0.0)) == "tracks"


@pytest.mark.parametrize(("kind", "least"), [("tuned", 0.9), ("ringing", 0.9)])
def test_simulated_loops_are_called_what_they_are(kind: str, least: float) -> None:
    rng = np.random.default_rng(21)
    records = [moves(rng, kind) for _ in range(20)]
    said = [tracking_verdict(tracking_of(r.sp, r.pv, 1.0, r.noise)) for r in records]
    assert np.mean([s == {"tuned": "tracks", "ringing": "rings"}[kind] for s in said]) >= least


def test_a_loop_behind_a_sticking_valve_or_one_that_crawls_does_not_track() -> None:
    rng = np.random.default_rng(22)
    records = [moves(rng, kind) for kind in ("sticking", "crawling") for _ in range(15)]
    assert "tracks" not in [tracking_verdict(tracking_of(r.sp, r.pv, 1.0, r.noise)) for r in records]


@plant_records.needed
def test_of_a_refinerys_records_those_that_track_are_called_so_and_no_valve() -> None:
    for label, sp, pv, _, period in plant_records.records():
        verdict = tracking_verdict(tracking_of(sp, pv, period, plant_records.noise_of(pv)))
        assert (verdict == "tracks") == (label == "tracking"), label
