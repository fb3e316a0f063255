"""Who is silent: by the clock, by nothing but bad values, all at once; who is given up after a month."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from monitor.contract.loops import Loop, LoopTable
from monitor.service.staleness import NAMED_LOOPS, NEVER_HEARD_S, RETIRE_AFTER_S, Staleness, named
from monitor.verdict.stale import LastSamples
from tests.monitor.service.tools import a_step, feed, one_loop

SECOND = 10**9


def last(n: int, **columns: Any) -> LastSamples:
    """How ``n`` loops' samples ended: a hundred good ones, one a second, until 100 s."""
    facts = {"time": 100 * SECOND, "period": 1.0, "good": 100, "bad_value": 0, "bad_quality": 0, "bad_run": 0}
    return LastSamples(
        **{name: np.zeros(n, np.asarray(v).dtype) + v for name, v in (facts | columns).items()}
    )


@pytest.fixture
def three():
    return Staleness(LoopTable([Loop(name=name) for name in "ABC"]))


def look(staleness: Staleness, now: float, arrival: list[float], newest: Any = 100, **columns: Any) -> bool:
    times = np.zeros(3, np.int64) + np.asarray(newest) * SECOND
    return staleness.look(last(3, **columns), np.array(arrival), times, now)


def test_three_periods_and_ten_seconds_at_least(three):
    """A loop of one sample a second is stale after ten seconds, one of 20 s after a minute."""
    assert not look(three, 109.0, [100, 100, 100], period=[1, 20, 0])
    assert three.stale == set()
    look(three, 111.0, [100, 100, 100], period=[1, 20, 0])
    assert three.stale == {0}
    look(three, 161.0, [100, 100, 155], period=[1, 20, 1])
    assert three.stale == {0, 1}


def test_nothing_but_bad_values(three):
    """They come, and their times go on; a loop without a single good one is stale after some of them."""
    look(three, 112.0, [112, 112, 112], newest=[112, 112, 112], bad_run=[12, 0, 30], good=[100, 100, 0])
    assert three.stale == {0, 2}


def test_all_at_once_is_one_line(three, caplog):
    """Said once, not for each loop: the line to them is down; and when it is back."""
    with caplog.at_level(logging.WARNING, "loopsight"):
        assert look(three, 200.0, [100, 100, 100])
        assert three.silent
        assert not look(three, 201.0, [100, 100, 100])
        assert look(three, 202.0, [201, 201, 201])
        assert not three.silent
    assert len(caplog.records) == 2


def test_changes_are_lines(three, caplog):
    """Who falls silent, who sends only bad ones, who is back."""
    with caplog.at_level(logging.WARNING, "loopsight"):
        look(three, 112.0, [100, 112, 112], newest=[100, 112, 112], bad_run=[0, 12, 0])
        look(three, 113.0, [113, 113, 113])
    assert [r.getMessage() for r in caplog.records] == [
        "stale: A",
        "only bad samples: B",
        "heard again: A, B",
    ]


def test_a_long_list_is_cut(caplog):
    """And no name writes to a terminal."""
    n = NAMED_LOOPS + 6
    staleness = Staleness(LoopTable([Loop(name=f"\x1b{k}") for k in range(n)]))
    arrival, newest = np.full(n, 100.0), np.full(n, 100 * SECOND)
    arrival[-1] = 200.0
    with caplog.at_level(logging.WARNING, "loopsight"):
        staleness.look(last(n), arrival, newest, 200.0)
    (line,) = [r.getMessage() for r in caplog.records]
    assert line.endswith("and 5 more")
    assert line.isprintable()


def test_overdue_are_registered_ones_only(three):
    """From when it was first heard, if nothing came."""
    three.register(1, 50.0)
    arrival = np.array([0.0, 0.0, 0.0])
    assert three.overdue(arrival, 50.0 + RETIRE_AFTER_S) == []
    assert three.overdue(arrival, 51.0 + RETIRE_AFTER_S) == [1]
    arrival[1] = 100.0
    assert three.overdue(arrival, 51.0 + RETIRE_AFTER_S) == []
    three.forget(1)
    assert three.overdue(arrival, 1e9) == []


def test_stale_loops_are_counted(bench):
    """A loop that sent once and is silent for ten seconds is stale; one that never sent is not."""
    b = bench(one_loop())
    feed(b, a_step(50))
    b.tick(3.0)
    assert b.status()["loops"]["stale"] == 0
    b.tick(20.0)
    assert b.status()["loops"]["stale"] == 1


def test_loops_of_which_nothing_comes_are_named_once(three, caplog):
    """Ten minutes after the start, where others are heard; `status` has them at any time."""
    with caplog.at_level(logging.WARNING, "loopsight"):
        for now in (100.0, 100.0 + NEVER_HEARD_S - 1, 100.0 + NEVER_HEARD_S, 101.0 + NEVER_HEARD_S):
            look(three, now, [now, 0, 0], newest=[int(now), 0, 0], good=[100, 0, 0], time=int(now) * SECOND)
            assert three.never_heard == {1, 2}
    assert [m for m in caplog.messages if "nothing has come" in m] == [
        "nothing has come of 2 loops of the table: B, C"
    ]


def test_many_are_named_by_the_first():
    assert named(["A", "B"]) == "A, B"
    assert named([f"L{k}" for k in range(NAMED_LOOPS + 3)]).endswith(", L19 and 3 more")
