"""How the view learns what it shows: a bounded inbox, subscriptions, questions to the monitor.

The view never subscribes to the plant's data. It hears the monitor's records of all loops, and the windows
and trends of the few loops that it shows. A callback only enqueues, and a full inbox drops its oldest entry.
"""

from __future__ import annotations

import logging
from collections import Counter, OrderedDict
from collections.abc import Mapping
from typing import Any, Protocol

import msgspec

from monitor.adapters.inbox import Inbox
from monitor.contract.entries import Message
from monitor.contract.evidence import Pane, Trend, Window, merge
from monitor.contract.times import nanoseconds
from monitor.wire.arrow import decode_trend, decode_window
from monitor.wire.encode import decode_record

from . import pages
from .selection import SHOWN, Board, as_row

logger = logging.getLogger(__name__)

PREFIX = "loopsight"
FACTS = ("event", "assessment", "suggestion")
INBOX = 4096
"""Entries; the largest is a window of some 30 kB."""
REPLIES = 200_000
"""Rows that the first question may bring: one a loop."""
LOG_LINES = 40
"""Lines of the log a tick: in a storm of events the rest is counted, not shown."""
QUESTIONS = 5
"""Questions to the monitor a tick."""
QUESTIONS_WAITING = 20_000
SILENCE = 100
"""Ticks without a health record (due every 40) after which the next one is of a monitor that came back."""
EVENTS = 2000
"""Assessments kept for the pages of the loops shown."""
QUIET = 1200
"""Ticks (five minutes) for which the reader keeps his tab and his zoom, while only the evidence changes."""
PAYLOAD_MAX = 4 << 20
"""A larger payload [bytes] is none of the monitor's."""


class Drawing(Protocol):
    """What the feed draws on: ``monitor.adapters.rerun_view.Picture``."""

    now: int

    def window(self, window: Window) -> None: ...  # noqa: D102
    def trend(self, trend: Trend) -> None: ...  # noqa: D102
    def log(self, text: str, level: str, time: int | None) -> None: ...  # noqa: D102
    def page(self, text: str, loop: str | None = None) -> None: ...  # noqa: D102
    def layout(self, panes: list[Pane], active: str | None = None) -> None: ...  # noqa: D102


class Feed:
    """Carries what the monitor says into the picture. ``tick`` a few times a second from one thread.

    Parameters
    ----------
    session
        Zenoh session, a client of the monitor's.
    picture
        What to draw on.
    most
        Loops with charts of their own.
    """

    def __init__(self, session: Any, picture: Drawing, most: int = SHOWN) -> None:
        self.board = Board(most)
        self.inbox: Inbox[Message] = Inbox(most=INBOX)
        self.replies: Inbox[Message] = Inbox(most=REPLIES)
        self.refused: Counter[str] = Counter()
        """Payloads that could not be read, by cause."""
        self._session, self._picture = session, picture
        self._facts: list[Any] = []
        self._streams: dict[str, list[Any]] = {}
        """Subscribers of each shown loop's windows and trend."""
        self._questions: dict[str, None] = {}
        self._events: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._windows: OrderedDict[str, Window] = OrderedDict()
        """The newest window of each loop that was asked for."""
        self._drawn: OrderedDict[str, None] = OrderedDict()
        self._evidence: dict[str, str] = {}
        """The event that stands for each loop: what its suggestion rests on, else the best remembered."""
        self._cited: set[str] = set()
        """Loops whose suggestion has named its evidence."""
        self._health: dict[str, Any] | None = None
        self._silent = SILENCE
        self._layout = _Layout(picture)
        self._pages: dict[str | None, str] = {}

    def listen(self) -> None:
        """Hear the monitor's records from now on, and ask for all loops' state, for a late view."""
        keys = [f"{PREFIX}/**/{leaf}" for leaf in FACTS]
        keys.append(f"{PREFIX}/@/*/status")  # what begins with @ no wildcard matches
        self._facts = [self._session.declare_subscriber(key, self._hear) for key in keys]
        self._ask(f"{PREFIX}/**/status")

    def pin(self, event: str) -> None:
        """Show one event of the monitor's history, whatever its loop's verdict."""
        for leaf in ("history", "window"):
            self._ask(f"{PREFIX}/**/{leaf}/{event}")

    def tick(self) -> None:
        """Draw what has come since the last call, ask what is missing."""
        self._silent += 1
        trends: dict[str, list[Trend]] = {}
        lines: list[dict[str, Any]] = []
        for message in (*self.replies.take(), *self.inbox.take()):
            try:
                self._one(message, trends, lines)
            except (ValueError, KeyError, TypeError, IndexError, msgspec.MsgspecError) as error:
                self._refuse(message, error)
        if self.board.choose():
            self._follow()
        self._write(lines)
        for parts in trends.values():
            self._picture.trend(merge(parts))
        for _ in range(min(QUESTIONS, len(self._questions))):
            question = next(iter(self._questions))
            del self._questions[question]
            self._ask(question)
        self._draw()

    def close(self) -> None:
        """Hear nothing any more."""
        for subscriber in (*self._facts, *(s for pair in self._streams.values() for s in pair)):
            subscriber.undeclare()
        self._facts.clear()
        self._streams.clear()

    def _hear(self, sample: Any) -> None:
        if len(sample.payload) <= PAYLOAD_MAX:
            self.inbox.put(Message(str(sample.key_expr), sample.payload.to_bytes(), 0))

    def _answered(self, reply: Any) -> None:
        if reply.ok is not None and len(reply.ok.payload) <= PAYLOAD_MAX:
            self.replies.put(Message(str(reply.ok.key_expr), reply.ok.payload.to_bytes(), 0))

    def _ask(self, selector: str) -> None:
        self._session.get(selector, self._answered, timeout=10.0)

    def _question(self, selector: str) -> None:
        """Ask when it is this one's turn: the monitor answers a few questions a tick."""
        if len(self._questions) < QUESTIONS_WAITING:
            self._questions[selector] = None

    def _one(self, message: Message, trends: dict[str, list[Trend]], lines: list[dict[str, Any]]) -> None:
        chunks = message.key.split("/")
        if chunks[1] == "@":
            self._heard_health(decode_record(message.payload), chunks[2])
            return
        by_id = chunks[-2] in ("history", "window")
        leaf, key = (chunks[-2], chunks[1:-2]) if by_id else (chunks[-1], chunks[1:-1])
        if leaf == "window":
            window = decode_window(message.payload)
            held = self._windows.get(window.loop)
            if held is None or window.onset >= held.onset or window.id == self._evidence.get(window.loop):
                _keep(self._windows, window.loop, window, 4 * SHOWN)
        elif leaf == "trend":
            trend = decode_trend(message.payload)
            trends.setdefault(trend.loop, []).append(trend)
        else:
            self._fact(leaf, "/".join(key), decode_record(message.payload), lines)

    def _fact(self, leaf: str, key: str, fact: dict[str, Any], lines: list[dict[str, Any]]) -> None:
        name = fact.setdefault("loop", key)
        if not isinstance(name, str):
            raise TypeError("loop is no text")
        if leaf in ("status", "suggestion"):
            self.board.put(fact, key)
            if leaf == "suggestion" and fact.get("evidence"):
                self._evidence[name] = event = str(fact["evidence"][-1])
                self._cited.add(name)
                self._question(f"{PREFIX}/{key}/window/{event}")
        elif leaf == "assessment":
            _keep(self._events, str(fact["id"]), fact, EVENTS)
            self._question(f"{PREFIX}/{key}/status")  # the loop's verdict may have changed with it
        elif leaf == "history":
            _keep(self._events, str(fact["id"]), fact, EVENTS)
            self._remembered(name, key, fact)
        if leaf == "assessment" or (leaf == "event" and fact.get("state") == "open"):
            lines.append(fact)

    def _remembered(self, name: str, key: str, fact: dict[str, Any]) -> None:
        """Take over an event of the past; its window is wanted where it is the loop's best evidence."""
        if not self._facts:  # a single event is shown
            self.board.pinned = name
            self.board.put(as_row(fact), key)
            self._question(f"{PREFIX}/{key}/status")
        if name in self._cited:
            return
        best = self._events.get(self._evidence.get(name, ""))
        if best is None or _worth(fact) > _worth(best):
            self._questions.pop(f"{PREFIX}/{key}/window/{self._evidence.get(name)}", None)
            self._evidence[name] = str(fact["id"])
            self._question(f"{PREFIX}/{key}/window/{fact['id']}")

    def _heard_health(self, health: dict[str, Any], monitor: str) -> None:
        unheard = self._health is None and not self.board.counts()
        if unheard or (self._health is not None and self._silent >= SILENCE):
            self._ask(f"{PREFIX}/**/status")
        self._silent, self._health = 0, {**health, "id": monitor}

    def _refuse(self, message: Message, error: Exception) -> None:
        cause = type(error).__name__
        self.refused[cause] += 1
        if self.refused[cause] == 1:
            logger.warning("%s: payload not shown: %s", pages.plain(message.key), pages.plain(error))

    def _write(self, lines: list[dict[str, Any]]) -> None:
        """Log events at their own time; of a storm only the first ones, and how many more there were."""
        for fact in lines[:LOG_LINES]:
            text, level = pages.log_line(fact)
            self._picture.log(text, level, nanoseconds(fact.get("end")) or nanoseconds(fact.get("start")))
        if len(lines) > LOG_LINES:
            self._picture.log(f"and {len(lines) - LOG_LINES} more events and assessments", "INFO", None)

    def _follow(self) -> None:
        """Hear windows and trends of the loops shown, and of no others; ask for what came before."""
        for name in [n for n in self._streams if n not in self.board.shown]:
            for subscriber in self._streams.pop(name):
                subscriber.undeclare()
            self._evidence.pop(name, None)
            self._cited.discard(name)
        if not self._facts:
            return
        for name in [n for n in self.board.shown if n not in self._streams]:
            base = f"{PREFIX}/{self.board.keys[name]}"
            self._streams[name] = [
                self._session.declare_subscriber(f"{base}/{leaf}", self._hear) for leaf in ("window", "trend")
            ]
            self._question(f"{base}/history/*?limit=10")

    def _draw(self) -> None:
        for name in self.board.shown:
            window = self._windows.get(name)
            if window is not None and window.id not in self._drawn:
                _keep(self._drawn, window.id, None, EVENTS)
                self._picture.window(window)
        windows = {name: self._windows[name] for name in self.board.shown if name in self._windows}
        self._layout.update(self.board.shown, windows, self._evidence)
        for name in self.board.shown:
            event = self._events.get(self._layout.fitted(name))
            self._page(pages.loop_page(self.board.rows[name], event), name)
        notes = [f"view: {n:,} messages dropped" for n in [self.inbox.dropped + self.replies.dropped] if n]
        notes += [f"view: {n:,} payloads not readable" for n in [self.refused.total()] if n]
        health = self._health if self._picture.now else None
        flagged = self.board.flagged()
        self._page(pages.overview(flagged, self.board.counts(), health, notes), None)

    def _page(self, text: str, loop: str | None) -> None:
        if self._pages.get(loop) != text:
            self._pages[loop] = text
            self._picture.page(text, loop)


class _Layout:
    """When to lay out anew: each time may cost the reader his tab and his zoom."""

    def __init__(self, picture: Drawing) -> None:
        self._picture = picture
        self._wanted: dict[str, Window] = {}
        """The event that each loop's charts should be fitted to."""
        self._panes: dict[str, Pane] = {}
        """What was sent last."""
        self._ids: dict[str, str] = {}
        self._started: bool | None = None
        self._ticks, self._count = 0, 0

    def fitted(self, name: str) -> str:
        """Id of the event that the loop's charts are fitted to, or empty."""
        return self._ids.get(name, "")

    def update(self, shown: list[str], windows: Mapping[str, Window], evidence: Mapping[str, str]) -> None:
        """Send a layout where the loops have changed, and in quiet times where their evidence has."""
        self._wanted = {name: window for name, window in self._wanted.items() if name in shown}
        for name, window in windows.items():
            if name not in self._wanted or window.id == evidence.get(name):
                self._wanted[name] = window
        self._ticks += 1
        ids = {name: window.id for name, window in self._wanted.items()}
        other = shown if set(shown) != set(self._panes) else list(self._panes)
        changed = other is shown or set(ids) != set(self._ids) or self._started != (self._picture.now > 0)
        if not changed and (ids == self._ids or self._ticks < QUIET):
            return
        if self._ticks < min(QUIET, 2 * self._count):
            return
        fresh = next((name for name in shown if name not in self._panes), None)
        self._panes = {name: _pane(name, self._wanted.get(name)) for name in other}
        self._ids, self._started, self._ticks = ids, self._picture.now > 0, 0
        self._count += 1
        self._picture.layout(list(self._panes.values()), fresh)


def _pane(name: str, window: Window | None) -> Pane:
    return Pane(name, 0, 0) if window is None else Pane(name, int(window.time[0]), int(window.time[-1]))


def _worth(assessment: Mapping[str, Any]) -> tuple[bool, str]:
    return assessment.get("verdict") == "retune", str(assessment.get("start"))


def _keep(kept: OrderedDict[str, Any], key: str, value: object, most: int) -> None:
    kept[key] = value
    kept.move_to_end(key)
    if len(kept) > most:
        kept.popitem(last=False)
