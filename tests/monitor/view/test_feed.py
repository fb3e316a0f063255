"""What the view knows and hears: bounded, never the plant, and no payload is fatal."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from monitor.contract.entries import Message
from monitor.contract.evidence import Pane
from monitor.view.feed import FLEET_TICKS, LOG_LINES, QUESTIONS, Feed
from monitor.view.layout import QUIET_TICKS
from tests.monitor.view.tools import Sketch
from tests.support.fake_monitor import Loop, arrow, assessment, demo_loops, row, trend_payload, window_payload


class Listener:
    """Stands for a Zenoh session: keeps what is asked of it."""

    def __init__(self) -> None:
        self.heard: list[str] = []
        self.asked: list[str] = []

    def declare_subscriber(self, key: str, _: Any) -> Any:
        self.heard.append(key)
        return type("Subscriber", (), {"undeclare": lambda _: self.heard.remove(key)})()

    def get(self, selector: str, _: Any, timeout: float) -> None:
        assert timeout <= 10.0
        self.asked.append(selector)


@pytest.fixture
def feed() -> Feed:
    made = Feed(Listener(), Sketch(), most=2)
    made.listen()
    return made


def say(feed: Feed, key: str, payload: bytes | dict[str, Any]) -> None:
    content = json.dumps(payload).encode() if isinstance(payload, dict) else payload
    feed.inbox.put(Message(key, content, 0))


def test_hears_the_monitor_and_never_the_plant(feed: Feed) -> None:
    """Windows and trends are heard of shown loops alone; nothing that matches the plant's keys is."""
    session = feed._session
    for loop in demo_loops():
        if loop.verdict == "retune":
            say(feed, f"loopsight/{loop.key}/suggestion", {**row(loop), "evidence": [loop.id]})
    feed.tick()
    assert all(key.startswith("loopsight/") for key in session.heard)
    assert [k for k in session.heard if k.endswith(("trend", "window"))] == [
        f"loopsight/plant/{name}/{leaf}" for name in feed.selection.shown for leaf in ("window", "trend")
    ]
    assert len(feed.selection.shown) == 2
    feed.close()
    assert session.heard == []


def test_bad_payloads_are_counted_not_fatal(feed: Feed, loop: Loop, caplog: pytest.LogCaptureFixture) -> None:
    bad = [b"", b"{", b"[]", b"\xff", b"null", b'{"loop": 7}', b"x" * 99]
    arrows = [
        arrow({"time": np.array([1])}, {"loop": "L"}),
        arrow({"sp": np.array([1.0])}, {}),
        trend_payload(loop, slice(0, 0)),
    ]
    for leaf in ("assessment", "event", "suggestion", "window", "trend"):
        for payload in [*bad, *arrows]:
            say(feed, f"loopsight/plant/x/{leaf}", payload)
            feed.tick()
    say(feed, "loopsight/@/m/status", b"[1]")
    say(feed, "loopsight", b"{}")
    feed.tick()
    assert feed.refused.total() > 40
    assert len(caplog.records) <= len(feed.refused)
    assert "not readable" in feed._picture.pages[None]


def test_a_storm_of_events_is_bounded(feed: Feed) -> None:
    """Ten thousand events at once: a few lines, a few questions a tick."""
    for i in range(10_000):
        fact = {"loop": f"L{i}", "id": str(i), "kind": "load", "verdict": "good", "reason": "", "start": None}
        say(feed, f"loopsight/plant/L{i}/assessment", fact)
    feed.tick()
    assert len(feed._picture.lines) == LOG_LINES + 1
    assert len(feed._session.asked) <= QUESTIONS + 1
    assert feed.inbox.dropped == 10_000 - 4096
    assert "5,904 messages dropped" in feed._picture.pages[None].replace("\\", "")


def test_verdicts_are_asked_for_after_an_assessment(feed: Feed, loop: Loop) -> None:
    """A loop that has become good is flagged no more, and its tab goes."""
    say(feed, f"loopsight/{loop.key}/suggestion", {**row(loop), "evidence": [loop.id]})
    say(feed, f"loopsight/{loop.key}/window", window_payload(loop))
    feed.tick()
    assert feed._picture.layouts[-1][0] == [Pane(loop.name, *(int(loop.columns["time"][i]) for i in (0, -1)))]
    say(feed, f"loopsight/{loop.key}/assessment", {**assessment(loop), "verdict": "good"})
    feed.tick()
    assert f"loopsight/{loop.key}/status" in feed._session.asked
    say(feed, f"loopsight/{loop.key}/status", {**row(loop), "verdict": "good"})
    for _ in range(10):
        feed.tick()
    assert feed.selection.shown == []
    assert feed._picture.layouts[-1][0] == []
    assert "No loop is flagged" in feed._picture.pages[None]


def test_the_fleet_is_drawn_anew_where_a_loop_has_moved(feed: Feed, loop: Loop) -> None:
    """At once, and then after some ticks; the charts have the units of the loop's row."""
    for ms in (2.9, 2.9, 1.4):
        say(
            feed,
            f"loopsight/{loop.key}/suggestion",
            {**row(loop), "ms": ms, "unit": "bar", "evidence": [loop.id]},
        )
        say(feed, f"loopsight/{loop.key}/window", window_payload(loop))
        for _ in range(FLEET_TICKS):
            feed.tick()
    assert [fleet.ms.tolist() for fleet in feed._picture.fleets] == [[2.9], [1.4]]
    assert feed._picture.scales[0].unit == "bar"


def test_layouts_are_rare(feed: Feed, loop: Loop) -> None:
    """New windows of a shown loop do not lay out anew: the reader keeps his tab and his zoom."""
    say(feed, f"loopsight/{loop.key}/suggestion", {**row(loop), "evidence": [loop.id]})
    say(feed, f"loopsight/{loop.key}/window", window_payload(loop))
    for i in range(50):
        later = {**loop.columns, "time": loop.columns["time"] + (i + 1) * 10**13}
        facts = {"id": f"later{i}", "loop": loop.name, "onset": str(later["time"][120])}
        say(feed, f"loopsight/{loop.key}/window", arrow(later, facts))
        feed.tick()
    assert len(feed._picture.windows) == 50
    assert len(feed._picture.layouts) <= 2


def test_new_evidence_is_laid_out_in_quiet_times(feed: Feed, loop: Loop) -> None:
    """A suggestion that rests on a newer event moves the charts to it, once five minutes have gone by."""
    say(feed, f"loopsight/{loop.key}/suggestion", {**row(loop), "evidence": [loop.id]})
    say(feed, f"loopsight/{loop.key}/window", window_payload(loop))
    feed.tick()
    later = {**loop.columns, "time": loop.columns["time"] + 10**13}
    facts = {"id": "later", "loop": loop.name, "onset": str(later["time"][120])}
    say(feed, f"loopsight/{loop.key}/suggestion", {**row(loop), "evidence": [loop.id, "later"]})
    say(feed, f"loopsight/{loop.key}/window", arrow(later, facts))
    for _ in range(QUIET_TICKS - 2):
        feed.tick()
    before = len(feed._picture.layouts)
    for _ in range(4):
        feed.tick()
    assert len(feed._picture.layouts) == before + 1
    assert feed._picture.layouts[-1][0][0].start == int(later["time"][0])
