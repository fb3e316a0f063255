"""What other threads are told: live, ready with every reason why not, all that is counted; of the last tick."""

from __future__ import annotations

import pytest

from monitor.service.vitals import LIVE_WITHIN_S, LOOK_EVERY_S, Vitals
from tests.monitor.service.tools import Bench, a_step, feed, one_loop


class Watched:
    """A service with its vitals."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.vitals = Vitals(lambda: bench.now)

    def tick(self, seconds: float = LOOK_EVERY_S) -> None:
        self.bench.tick(seconds)
        self.vitals.beat(self.bench.service, 0.01)

    def said(self, path: str) -> tuple[int, list[str]]:
        code, _, body = self.vitals.answers[path]()
        return code, body.decode().splitlines()


@pytest.fixture
def watched(bench):
    return Watched(bench(one_loop()))


def test_starting(watched):
    """Before the first tick: live, however long the kernels take; not ready, and why not."""
    watched.bench.now += 1000.0
    assert watched.said("/livez") == (200, ["live"])
    assert watched.said("/readyz") == (503, ["starting"])


def test_ready_and_every_reason_why_not(watched):
    """A line each, and 200 again when none is left."""
    watched.tick()
    assert watched.said("/readyz") == (503, ["no_data: nothing has come in yet"])
    feed(watched.bench, a_step(50))
    watched.tick()
    assert watched.said("/readyz") == (200, ["ready"])
    watched.bench.store.failing = True
    feed(watched.bench, a_step())
    watched.tick(60.0)
    watched.tick()
    assert watched.said("/readyz") == (503, ["store: the store fails", "silent: no loop sends"])
    assert watched.said("/livez") == (200, ["live"])


def test_no_tick_for_long(watched):
    """Neither live nor ready, with how long; a completed tick makes it live again."""
    feed(watched.bench, a_step(50))
    watched.tick()
    watched.bench.now += LIVE_WITHIN_S + 15.0
    for path in ("/livez", "/readyz"):
        assert watched.said(path) == (503, ["stalled: no tick for 75 s, expected one within 60 s"])
    watched.tick()
    assert watched.said("/livez") == (200, ["live"])


def test_nothing_is_asked_of_the_service_in_between(watched, monkeypatch):
    """What is told is what the last look left: a scraper does not touch the engine."""
    watched.tick()
    monkeypatch.setattr(watched.bench.service, "status", lambda: pytest.fail("asked"))
    watched.tick(0.1 * LOOK_EVERY_S)
    assert all(code in {200, 503} for code, _ in map(watched.said, watched.vitals.answers))
    assert "loopsight_store_bytes" in "".join(watched.said("/metrics")[1])
