"""How the view learns what it shows: a bounded inbox, subscriptions, questions to the monitor.

The view never subscribes to the plant's data. It hears the monitor's records of all loops, and the windows
and trends of the few loops that it shows. A callback only enqueues, and a full inbox drops its oldest entry.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import msgspec

from monitor.adapters.inbox import Inbox
from monitor.contract import keys
from monitor.contract.entries import Message
from monitor.contract.evidence import Scale, Trend, merge
from monitor.contract.text import plain
from monitor.contract.times import nanoseconds
from monitor.wire.arrow import decode_trend, decode_window
from monitor.wire.encode import decode_record

from . import pages
from .drawing import Drawing
from .evidence import Evidence
from .layout import Layout
from .pages import Row
from .selection import SHOWN_LOOPS, Selection, as_row

logger = logging.getLogger(__name__)

TICK_S = 0.25
"""Between two looks into the inbox: fast for an eye, nothing for a processor [s]."""
INBOX_MESSAGES = 4096
"""The largest is a window of some 30 kB."""
REPLY_MESSAGES = 200_000
"""Rows that the first question may bring: one a loop."""
LOG_LINES = 40
"""Lines of the log a tick: in a storm of events the rest is counted, not shown."""
QUESTIONS = 5
"""Questions to the monitor a tick."""
QUESTIONS_WAITING = 20_000
ANSWER_WITHIN_S = 10.0
"""For the monitor to answer a question [s]."""
SILENT_TICKS = 100
"""Ticks without a health record (due every 40) after which the next one is of a monitor that came back."""
REMEMBERED_EVENTS = 10
"""Events of the past that are asked for when a loop is shown."""
FLEET_TICKS, FLEET_LOOPS = 8, 2500
"""Ticks between two pictures of the fleet, and loops for which one more passes: what the viewer keeps of old ones is
bounded, and 100,000 loops are a megabyte."""
PAYLOAD_BYTES = 4 << 20
"""A larger payload is none of the monitor's."""


class Subscriber(Protocol):
    """What ends a subscription."""

    def undeclare(self) -> object:
        """Hear nothing any more."""


UNREADABLE = (ValueError, LookupError, TypeError, ArithmeticError, OSError, MemoryError, RuntimeError)
"""What bytes of anybody raise where they are no record: text too deep (RuntimeError), a body cut off (OSError), ..."""


class Session(Protocol):
    """A session of Zenoh's, as far as a view needs it; what its handlers are given is the library's own."""

    def declare_subscriber(self, key: str, handler: Callable[[Any], None], /) -> Subscriber:
        """Hear what is said under a key."""

    def get(self, selector: str, handler: Callable[[Any], None], /, *, timeout: float) -> object:
        """Ask; each answer is handed over as it comes."""


class Feed:
    """Carries what the monitor says into the picture. ``tick`` a few times a second from one thread.

    Parameters
    ----------
    session
        A client of the monitor's.
    picture
        What to draw on.
    most
        Loops with charts of their own.
    """

    def __init__(self, session: Session, picture: Drawing, most: int = SHOWN_LOOPS) -> None:
        self.selection = Selection(most)
        self.inbox: Inbox[Message] = Inbox(most=INBOX_MESSAGES)
        self.replies: Inbox[Message] = Inbox(most=REPLY_MESSAGES)
        self.refused: Counter[str] = Counter()
        """Payloads that could not be read, by cause."""
        self._session, self._picture = session, picture
        self._facts: list[Subscriber] = []
        self._streams: dict[str, list[Subscriber]] = {}
        """Subscribers of each shown loop's windows and trend."""
        self._questions: dict[str, None] = {}
        self._evidence = Evidence()
        self._health: Row | None = None
        self._silent = SILENT_TICKS
        self._layout = Layout(picture)
        self._pages: dict[str | None, str] = {}
        self._fleet_ticks = FLEET_TICKS

    def listen(self) -> None:
        """Hear the monitor's records from now on, and ask for all loops' state, for a late view."""
        facts = (keys.event("**"), keys.assessment("**"), keys.suggestion("**"), keys.monitor_status("*"))
        self._facts = [self._session.declare_subscriber(key, self._hear) for key in facts]
        self._ask(keys.status("**"))

    def pin(self, event: str) -> None:
        """Show one event of the monitor's history, whatever its loop's verdict."""
        self._ask(keys.history("**", event))
        self._ask(keys.window("**", event))

    def tick(self) -> None:
        """Draw what has come since the last call, ask what is missing."""
        self._silent += 1
        trends: dict[str, list[Trend]] = {}
        lines: list[Row] = []
        for message in (*self.replies.take(), *self.inbox.take()):
            try:
                self._one(message, trends, lines)
            except (*UNREADABLE, msgspec.MsgspecError) as error:
                self._refuse(message, error)
        if self.selection.choose():
            self._follow()
        self._write(lines)
        for parts in trends.values():
            self._picture.trend(merge(parts), self._scale(parts[0].loop))
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
        if len(sample.payload) <= PAYLOAD_BYTES:
            self.inbox.put(Message(str(sample.key_expr), sample.payload.to_bytes(), 0))

    def _answered(self, reply: Any) -> None:
        if reply.ok is not None and len(reply.ok.payload) <= PAYLOAD_BYTES:
            self.replies.put(Message(str(reply.ok.key_expr), reply.ok.payload.to_bytes(), 0))

    def _ask(self, selector: str) -> None:
        self._session.get(selector, self._answered, timeout=ANSWER_WITHIN_S)

    def _question(self, selector: str) -> None:
        """Ask when it is this one's turn: the monitor answers a few questions a tick."""
        if len(self._questions) < QUESTIONS_WAITING:
            self._questions[selector] = None

    def _one(self, message: Message, trends: dict[str, list[Trend]], lines: list[Row]) -> None:
        chunks = message.key.split("/")
        if chunks[1] == "@":
            self._heard_health(decode_record(message.payload), chunks[2])
            return
        by_id = chunks[-2] in ("history", "window")
        leaf, key = (chunks[-2], chunks[1:-2]) if by_id else (chunks[-1], chunks[1:-1])
        if leaf == "window":
            self._evidence.hold(decode_window(message.payload))
        elif leaf == "trend":
            trend = decode_trend(message.payload)
            trends.setdefault(trend.loop, []).append(trend)
        else:
            self._fact(leaf, "/".join(key), decode_record(message.payload), lines)

    def _fact(self, leaf: str, key: str, record: Row, lines: list[Row]) -> None:
        name = record.get("loop", key)
        if not isinstance(name, str):
            raise TypeError("loop is no text")
        fact = {**record, "loop": name}
        if leaf in ("status", "suggestion"):
            self.selection.put(fact, key)
            events = fact.get("evidence")
            if leaf == "suggestion" and isinstance(events, list) and events:
                self._evidence.cite(name, str(events[-1]))
                self._question(keys.window(key, str(events[-1])))
        elif leaf == "assessment":
            self._evidence.keep(fact)
            self._question(keys.status(key))  # the loop's verdict may have changed with it
        elif leaf == "history":
            self._evidence.keep(fact)
            self._remembered(name, key, fact)
        if leaf == "assessment" or (leaf == "event" and fact.get("state") == "open"):
            lines.append(fact)

    def _remembered(self, name: str, key: str, fact: Row) -> None:
        """Take over an event of the past; its window is wanted where it is the loop's best evidence."""
        if not self._facts:  # a single event is shown
            self.selection.pinned = name
            self.selection.put(as_row(fact), key)
            self._question(keys.status(key))
        before = self._evidence.stands.get(name, "")
        if self._evidence.prefer(name, fact):
            self._questions.pop(keys.window(key, before), None)
            self._question(keys.window(key, str(fact["id"])))

    def _heard_health(self, health: Row, monitor: str) -> None:
        unheard = self._health is None and not self.selection.counts()
        if unheard or (self._health is not None and self._silent >= SILENT_TICKS):
            self._ask(keys.status("**"))
        self._silent, self._health = 0, {**health, "id": monitor}

    def _refuse(self, message: Message, error: Exception) -> None:
        cause = type(error).__name__
        self.refused[cause] += 1
        if self.refused[cause] == 1:
            logger.warning("%s: payload not shown: %s", plain(message.key), plain(error))

    def _write(self, lines: Sequence[Row]) -> None:
        """Log events at their own time; of a storm only the first ones, and how many more there were."""
        for fact in lines[:LOG_LINES]:
            text, level = pages.log_line(fact)
            self._picture.log(text, level, nanoseconds(fact.get("end")) or nanoseconds(fact.get("start")))
        if len(lines) > LOG_LINES:
            self._picture.log(f"and {len(lines) - LOG_LINES} more events and assessments", "INFO", None)

    def _follow(self) -> None:
        """Hear windows and trends of the loops shown, and of no others; ask for what came before."""
        for name in [n for n in self._streams if n not in self.selection.shown]:
            for subscriber in self._streams.pop(name):
                subscriber.undeclare()
            self._evidence.forget(name)
        if not self._facts:
            return
        for name in [n for n in self.selection.shown if n not in self._streams]:
            key = self.selection.keys[name]
            streams = (keys.window(key), keys.trend(key))
            self._streams[name] = [self._session.declare_subscriber(one, self._hear) for one in streams]
            self._question(f"{keys.history(key, '*')}?limit={REMEMBERED_EVENTS}")

    def _draw(self) -> None:
        shown = self.selection.shown
        for window in self._evidence.undrawn(shown):
            self._picture.window(window, self._scale(window.loop))
        self._layout.update(shown, self._evidence.windows(shown), self._evidence.stands)
        for name in shown:
            event = self._evidence.assessment(self._layout.fitted(name))
            self._page(pages.loop_page(self.selection.rows[name], event), name)
        self._draw_fleet()
        notes = [f"view: {n:,} messages dropped" for n in [self.inbox.dropped + self.replies.dropped] if n]
        notes += [f"view: {n:,} payloads not readable" for n in [self.refused.total()] if n]
        health = self._health if self._picture.now else None
        flagged = self.selection.flagged()
        closing = [pages.health_line(health), *notes]
        self._page(pages.overview(flagged, self.selection.counts(), closing), None)

    def _draw_fleet(self) -> None:
        """Draw the fleet anew where a loop has moved in it, and it is time."""
        self._fleet_ticks += 1
        if self.selection.moved and self._fleet_ticks >= FLEET_TICKS + self.selection.placed // FLEET_LOOPS:
            self._picture.fleet(self.selection.fleet())
            self._fleet_ticks, self.selection.moved = 0, False

    def _scale(self, loop: str) -> Scale:
        return pages.scale_of(self.selection.rows.get(loop, {}))

    def _page(self, text: str, loop: str | None) -> None:
        if self._pages.get(loop) != text:
            self._pages[loop] = text
            self._picture.page(text, loop)
