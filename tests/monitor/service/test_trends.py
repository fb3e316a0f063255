"""Samples for the eye: of flagged loops and open events alone, once a second."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.service.shelf import Shelf
from monitor.service.trends import TREND_LOOPS, Trends
from monitor.wire.arrow import decode_trend
from tests.monitor.service.tools import a_step, feed, one_loop
from tests.support.bus import FakeBus
from tests.support.stores import quick

SECOND = 10**9


@pytest.fixture
def bus():
    return FakeBus()


@pytest.fixture
def trends(bus, tmp_path):
    loops, store = LoopTable([Loop(name=f"L{k}") for k in range(TREND_LOOPS + 5)]), quick(tmp_path)
    yield Trends(Engine(loops), bus, Shelf(loops, store, lambda: 0))
    store.close()


def second(k: int, loops: int = 2) -> list[Samples]:
    """One sample of each loop."""
    rows = np.arange(loops)
    return [Samples.of(rows, np.full(loops, k * SECOND), 1.0, rows * 1.0, 3.0)]


def test_nothing_of_loops_that_are_quiet(trends, bus):
    for k in range(5):
        trends.take(second(k), float(k))
    assert bus.said == []


def test_a_flagged_loop_once_a_second(trends, bus):
    """All of its samples since it was flagged, in few messages; none once the flag is gone."""
    trends.flag(1, True)
    for k in range(20):
        trends.take(second(k), k / 4)
    found = [decode_trend(payload) for _, payload, _ in bus.said]
    assert {key for key, _, _ in bus.said} == {"loopsight/plant/L1/trend"}
    assert len(found) == 5
    assert np.concatenate([t.time for t in found]).tolist() == [k * SECOND for k in range(17)]
    assert {t.loop for t in found} == {"L1"}
    trends.flag(1, False)
    trends.take([], 10.0)  # what was held goes out
    bus.said.clear()
    trends.take(second(30), 11.0)
    trends.take([], 12.0)
    assert bus.said == []


def test_a_bound_on_loops(trends, bus):
    """In an upset of the whole plant the first ones are shown."""
    n = TREND_LOOPS + 5
    for row in range(n):
        trends.flag(row, True)
    trends.take(second(0, n), 0.0)
    assert len(bus.said) == TREND_LOOPS


def test_an_open_event_is_shown(bench):
    """Before there is any verdict."""
    b = bench(one_loop())
    for k, message in enumerate(a_step(230)):
        feed(b, [message], 0.3)
        if k == 150:
            assert not [key for key, _, _ in b.bus.said if key.endswith("/trend")]
    assert {key for key, _, _ in b.bus.said if key.endswith("/trend")} == {"loopsight/plant/L/trend"}
