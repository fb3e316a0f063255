"""Rows that come by exception become samples of held values, and nothing else does, however rows are batched."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.reporting.stage import Reporting
from monitor.reporting.state import RING_ROWS
from tests.bench.health_archive import swinging_door
from tests.monitor.reporting.tools import by_exception
from tests.support.plants import START, stepped, times

LOOP = Loop(name="L")


def joined(pieces: list[Samples]) -> Samples:
    names = ("loop", "time", "sp", "pv", "op", "auto", "quality")
    return Samples.of(*(np.concatenate([getattr(p, n) for p in pieces] or [np.zeros(0)]) for n in names))


def copied(samples: Samples) -> Samples:
    return samples.take(np.arange(len(samples)))


def through(stage: Reporting, samples: Samples, cuts: list[int] | None = None) -> Samples:
    """All that comes out, rows taken in in pieces."""
    edges = [0, *(cuts or []), len(samples)]
    pieces = []
    for a, b in pairwise(edges):
        pieces += [copied(p) for p in stage.run(samples.take(slice(a, b)))]
    return joined(pieces + [copied(p) for p in stage.flush()])


def same(a: Samples, b: Samples) -> bool:
    return all(
        np.array_equal(getattr(a, n), getattr(b, n), equal_nan=n in {"sp", "pv", "op"})
        for n in ("loop", "time", "sp", "pv", "op", "auto", "quality")
    )


def stepping(seed: int = 1, noise: float = 0.03, n: int = 12_000) -> Samples:
    return stepped(n, at=4000, size=4.0, noise=noise, seed=seed, gain=0.01)


@pytest.mark.parametrize("band", [0.15, 0.25, 0.4])
@pytest.mark.parametrize("every", [True, False])
@pytest.mark.parametrize("longest", [300.0, 1800.0])
def test_rows_on_change_are_held(band, every, longest):
    """At each instant of the grid stands what was last reported; all rows are there, and no other time is a gap."""
    rows = by_exception(stepping(noise=band / 6), band, longest, every)
    stage = Reporting([LOOP])
    out = through(stage, rows)
    assert stage.dead_band(0) == pytest.approx(band, rel=0.5)
    assert len(out) == len(rows) + stage.added[0]
    assert set(rows.time.tolist()) <= set(out.time.tolist())
    last = np.searchsorted(rows.time, out.time, side="right") - 1
    assert np.abs(out.pv - rows.pv[last]).max() < 0.75 * band
    assert np.array_equal(out.sp, rows.sp[last])
    assert np.diff(out.time).max() < 40e9
    assert np.diff(out.time).min() > 0


@pytest.mark.parametrize("seed", range(4))
def test_it_does_not_matter_how_rows_are_batched(seed):
    rows = by_exception(stepping(seed), 0.3, 600.0)
    cuts = sorted(np.random.default_rng(seed).integers(0, len(rows), 12).tolist())
    assert same(through(Reporting([LOOP]), rows), through(Reporting([LOOP]), rows, cuts))


@pytest.mark.parametrize("kind", ["regular", "minutes", "lost", "jitter", "gaps", "slower", "swinging-door"])
@pytest.mark.parametrize("seed", range(3))
def test_rows_at_a_rate_are_untouched(kind, seed):
    """So are lost rows, jitter, gaps, and what a swinging door has kept."""
    rng = np.random.default_rng(seed)
    rows = stepped(4000, at=1000, noise=0.1, seed=seed)
    if kind == "swinging-door":
        rows = stepping(seed, n=40_000)
        rows = rows.take(swinging_door(rows.pv, 0.1))
    n = len(rows)
    step = {
        "regular": np.ones(n),
        "minutes": np.full(n, 60.0),
        "lost": rng.geometric(0.8, n),
        "jitter": 1.0 + rng.uniform(-0.4, 0.4, n),
        "gaps": np.where(rng.random(n) < 0.01, 500.0, 1.0),
        "slower": np.where(np.arange(n) < n // 2, 1.0, 7.0),
    }.get(kind)
    if step is not None:
        rows = Samples.of(
            0, START + np.round(np.cumsum(step) * 1e9).astype(np.int64), rows.sp, rows.pv, rows.op
        )
    stage = Reporting([LOOP])
    assert same(through(stage, rows), rows)
    assert stage.dead_band(0) is None


def test_rows_at_random_times_are_hardly_ever_held():
    """Their noise has no dead band; it looks like one once in a hundred looks."""
    held = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        stage = Reporting([LOOP])
        t = np.cumsum(rng.exponential(5.0, 1000) + 0.01)
        pv = 50.0 + rng.standard_normal(1000)
        list(stage.run(Samples.of(0, START + np.round(t * 1e9).astype(np.int64), 50.0, pv, 100.0 - pv)))
        held += stage.dead_band(0) is not None
    assert held <= 4


def test_a_silence_longer_than_the_heartbeat_stays_a_gap():
    rows = by_exception(stepping(), 0.3, 300.0)
    late = rows.time > rows.time[-1] - 2000 * 10**9
    rows = Samples.of(0, rows.time + np.where(late, 7200 * 10**9, 0), rows.sp, rows.pv, rows.op)
    out = through(Reporting([LOOP]), rows)
    assert np.diff(out.time).max() > 7000e9
    known = out.time[out.time > rows.time[100]]
    assert np.sum(np.diff(known) > 60e9) == 1


def test_nothing_is_held_after_a_bad_row():
    rows = by_exception(stepping(), 0.3, 300.0)
    pv = rows.pv.copy()
    pv[60] = np.nan
    out = through(Reporting([LOOP]), Samples.of(0, rows.time, rows.sp, pv, rows.op))
    after = out.time[(out.time > rows.time[60]) & (out.time < rows.time[61])]
    assert len(after) == 0


def test_a_given_period_is_the_grid():
    rows = by_exception(stepping(), 0.3, 300.0)
    out = through(Reporting([Loop(name="L", period=5.0)]), rows)
    assert np.median(np.diff(out.time)) == pytest.approx(5e9)


def test_a_loop_that_goes_over_to_a_rate_is_handed_on():
    by = by_exception(stepping(), 0.3, 600.0)
    plain = stepped(2000, at=500, noise=0.1)
    t = np.concatenate([by.time, by.time[-1] + plain.time - START + 10**9])
    columns = [np.concatenate([getattr(by, n), getattr(plain, n)]) for n in ("sp", "pv", "op")]
    stage = Reporting([LOOP])
    out = through(stage, Samples.of(0, t, *columns))
    assert stage.dead_band(0) is None
    assert np.array_equal(out.time[-1500:], t[-1500:])


def test_a_clock_that_was_set_back_does_not_lock_a_loop():
    rows = by_exception(stepping(), 0.3, 600.0)
    earlier = Samples.of(0, times(3000, start=START - 10**13), 50.0, np.zeros(3000), 50.0)
    stage = Reporting([LOOP])
    list(stage.run(rows))
    out = through(stage, earlier)
    assert np.array_equal(out.time[-2900:], earlier.time[-2900:])


def test_what_waits_is_bounded_and_counted():
    """Slow rows wait until it is known how they come, and not longer."""
    stage = Reporting([LOOP])
    rows = Samples.of(0, times(100, 600.0), 50.0, 50.0 + 0.1 * np.arange(100), 40.0)
    seen = 0
    for k in range(100):
        seen += sum(len(p) for p in stage.run(rows.take(slice(k, k + 1))))
        assert seen + stage.waiting[0] == k + 1
        assert stage.waiting[0] < RING_ROWS
    assert seen == 100


def test_state_goes_over_to_another_stage():
    rows = by_exception(stepping(), 0.3, 600.0)
    whole = through(Reporting([LOOP]), rows)
    first, second = Reporting([LOOP]), Reporting([LOOP])
    a = joined([copied(p) for p in first.run(rows.take(slice(0, 70)))])
    known = first.known(np.array([0]))
    second.adopt(0, {name: array[0] for name, array in known.items()})
    assert same(joined([a, through(second, rows.take(slice(70, len(rows))))]), whole)
