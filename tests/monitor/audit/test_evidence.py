"""What an audit keeps for the eye: the newest events, thinned, in bounded memory; and back as it was."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import numpy as np

from monitor.audit.evidence import (
    MOST_POINTS,
    MOST_WITH_MODEL,
    MOST_WITHOUT,
    TREND_SAMPLES,
    Keeper,
    Trends,
    answers_of,
    curves_of,
    flagged,
    thinned,
    windows_of,
)
from monitor.audit.tasks import Part
from monitor.contract.evidence import Window
from monitor.contract.records import LoopRow
from monitor.contract.samples import Samples
from tests.monitor.report.tools import START, answers, window


def without_model(k: int) -> Window:
    w = window("A", k)
    return Window(w.id, w.loop, w.onset, w.time, w.sp, w.pv, w.op, np.full(len(w.time), np.nan))


def test_the_newest_events_of_each_loop_are_kept() -> None:
    keeper = Keeper()
    for k in range(10):
        keeper.take(window("A", k), "setpoint")
        keeper.take(window("B", k), "load")
        keeper.take(without_model(20 + k), "disturbance")
    assert [k.id for k in keeper.of(["A"])] == ["A/7", "A/8", "A/9", "A/29"]
    assert len(keeper.of(["A", "B", "none"])) == 2 * MOST_WITH_MODEL + MOST_WITHOUT


def test_a_long_window_is_thinned_without_losing_its_extremes_and_its_step() -> None:
    w = window("A", n=20_000)
    w.pv[12_345], w.pv[777] = 90.0, 10.0
    (found,) = windows_of([thinned(w)])
    assert len(found.time) <= MOST_POINTS + 4
    assert (found.pv.max(), found.pv.min()) == (90.0, 10.0)
    assert (found.time[0], found.time[-1]) == (w.time[0], w.time[-1])
    assert (np.diff(found.time) > 0).all()
    before = found.time[np.flatnonzero(np.diff(found.sp))[0]]
    assert before == w.onset - 10**9


def test_a_short_window_stays_as_it_is_and_gaps_stay_gaps() -> None:
    w = window("A")
    w.pv[5] = np.nan
    (found,) = windows_of([thinned(w)])
    assert np.array_equal(found.time, w.time)
    assert np.isnan(found.pv[5])
    assert np.allclose(found.op, w.op, atol=1e-5)


def test_a_part_stores_it_and_hands_it_back() -> None:
    part = Part(windows=[thinned(window("A"))], answers=curves_of(answers("A")))
    back = msgspec.msgpack.decode(msgspec.msgpack.encode(part), type=Part)
    assert back.windows == part.windows
    found = answers_of(back.answers)
    assert [a.kind for a in found] == ["load", "setpoint"]
    assert np.allclose(found[1].new, answers("A")[1].new, atol=1e-6)
    assert np.isnan(found[0].today).all()


def test_what_is_flagged() -> None:
    assert flagged(LoopRow(loop="x", verdict="retune"))
    assert flagged(LoopRow(loop="x", verdict="good", flags=("noisy_op",)))
    assert flagged(LoopRow(loop="x", flags=("manual",)))
    assert not flagged(LoopRow(loop="x", verdict="good"))
    assert not flagged(LoopRow(loop="x", flags=("idle",)))


def test_trends_are_the_newest_samples_however_they_are_batched() -> None:
    """Of several loops, interleaved; cut anywhere, the same comes out; memory is bounded."""
    n = 3 * TREND_SAMPLES
    rng = np.random.default_rng(3)
    loop, time = np.arange(n) % 2, START + 10**9 * np.arange(n)
    samples = Samples.of(loop, time, sp=50.0, pv=rng.normal(50.0, 1.0, n), op=rng.normal(30.0, 1.0, n))
    whole, parts = Trends(["A", "B"]), Trends(["A", "B"])
    whole.take(samples)
    whole.take(samples.take(slice(0, 0)))
    for a, b in pairwise([0, 1, 700, 701, 2500, n]):
        parts.take(samples.take(slice(a, b)))
    assert whole.of(["A", "B"]) == parts.of(["A", "B"])
    (kept,) = windows_of(whole.of(["B"]))
    assert kept.id == ""
    assert kept.time[-1] == time[-1]
    assert kept.time[-1] - kept.time[0] == 2 * 10**9 * (TREND_SAMPLES - 1)
    assert len(kept.time) <= MOST_POINTS + 4
