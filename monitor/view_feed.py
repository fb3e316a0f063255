"""What the view knows and how it learns it: a bounded inbox, the loops' rows, the questions to the monitor.

The view never subscribes to the plant's data. It hears the monitor's records of all loops, and the windows and
trends of the few loops that it shows; a callback only enqueues, and a full inbox forgets its oldest entry.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from monitor import view_text

if TYPE_CHECKING:
    from monitor.adapters.rerun_view import Pane, Picture, Trend, Window

logger = logging.getLogger(__name__)

PREFIX = "loopsight"
FACTS = ("event", "assessment", "suggestion")
SHOWN = 12
"""Loops with charts of their own: more tabs than this nobody looks at."""
INBOX = 4096
"""Entries; the largest is a window of some 30 kB."""
REPLIES = 200_000
"""Rows that the first question may bring: one a loop."""
LOG_LINES = 40
"""Lines of the log a tick: in a storm of events the rest is counted, not shown."""
QUESTIONS = 5
"""Questions to the monitor a tick."""
SWAP = 0.8
"""A loop takes another's place only when it is this much worse: tabs must not flicker."""
SILENCE = 6
"""Ticks without a health record after which the next one means a monitor that has come back."""
PAYLOAD_MAX = 4 << 20


class Message(NamedTuple):
    """One payload and the key it came under."""

    key: str
    payload: bytes


class Inbox:
    """Bounded queue between Zenoh's threads and the view's: never blocks, forgets the oldest and counts it."""

    def __init__(self, size: int = INBOX) -> None:
        self._entries: deque[Message] = deque()
        self._size = size
        self._lock = threading.Lock()
        self.dropped = 0

    def put(self, key: str, payload: bytes) -> None:
        """Append a message; called from any thread."""
        with self._lock:
            if len(self._entries) >= self._size:
                self._entries.popleft()
                self.dropped += 1
            self._entries.append(Message(key, payload))

    def take(self) -> list[Message]:
        """Take all that came since the last call, in order."""
        with self._lock:
            entries, self._entries = self._entries, deque()
        return list(entries)


class Board:
    """The loops as the monitor sees them, and which of them are shown. Knows neither Zenoh nor Rerun."""

    def __init__(self, most: int = SHOWN) -> None:
        self.rows: dict[str, dict[str, Any]] = {}
        self.keys: dict[str, str] = {}
        """Loop key of each name."""
        self.assessments: dict[str, dict[str, Any]] = {}
        """The newest assessment of each flagged or shown loop."""
        self.windows: dict[str, Window] = {}
        """The newest window of each shown loop."""
        self.pinned: str | None = None
        """A loop that is shown whatever its verdict."""
        self.shown: list[str] = []
        self._counts: Counter[str] = Counter()
        self._most = most

    def put(self, row: Mapping[str, Any], key: str) -> None:
        """Take over a loop's current row."""
        name = str(row["loop"])
        old = self.rows.get(name)
        if old is not None:
            self._counts[str(old.get("verdict"))] -= 1
        self._counts[str(row.get("verdict"))] += 1
        flagged = row.get("verdict") == "retune"
        kept = dict(row) if flagged or name == self.pinned else {"loop": name, "verdict": row.get("verdict")}
        self.rows[name], self.keys[name] = kept, key

    def counts(self) -> dict[str, int]:
        """Loops by verdict."""
        return {verdict: n for verdict, n in self._counts.items() if n > 0}

    def flagged(self) -> list[dict[str, Any]]:
        """Rows of the flagged loops, worst first."""
        return sorted((row for row in self.rows.values() if row.get("verdict") == "retune"), key=severity)

    def choose(self) -> bool:
        """Choose the loops to show; True where the choice has changed.

        A loop that is shown stays until it is no longer flagged, or another one is clearly worse.
        """
        ranked = self.flagged()
        by_name = {str(row["loop"]): severity(row) for row in ranked}
        stay = [name for name in self.shown if name in by_name or name == self.pinned]
        if self.pinned in self.rows and self.pinned not in stay:
            stay.insert(0, str(self.pinned))
        for name in (str(row["loop"]) for row in ranked if row["loop"] not in stay):
            if len(stay) < self._most:
                stay.append(name)
                continue
            mildest = max((n for n in stay if n != self.pinned), key=lambda n: by_name[n])
            if by_name[name] >= SWAP * by_name[mildest]:
                break
            stay[stay.index(mildest)] = name
        stay.sort(key=lambda n: by_name.get(n, -1.0))
        changed = set(stay) != set(self.shown)
        self.shown = stay
        for forgotten in [n for n in self.windows if n not in stay]:
            del self.windows[forgotten]
        return changed


def severity(row: Mapping[str, Any]) -> float:
    """How bad a loop is, 0 the worst: its CI and its Ms against the limits' defaults, whichever is worse."""
    ms = row.get("ms")
    robust = 2.75 / ms if isinstance(ms, (int, float)) and ms > 0 else 1.0
    return min([robust, *(max(ci, 0.0) / 0.6 for ci in view_text.indices(row))])


class Feed:
    """Carries what the monitor says into the picture. ``tick`` a few times a second from one thread."""

    def __init__(self, session: Any, picture: Picture, most: int = SHOWN) -> None:
        self.board = Board(most)
        self.inbox = Inbox()
        self.replies = Inbox(REPLIES)
        self.causes: Counter[str] = Counter()
        """What could not be used, by cause."""
        self._session, self._picture = session, picture
        self._subscribers = [session.declare_subscriber(f"{PREFIX}/**/{leaf}", self._hear) for leaf in FACTS]
        self._subscribers.append(session.declare_subscriber(f"{PREFIX}/@/*/status", self._hear))
        self._streams: dict[str, list[Any]] = {}
        self._questions: deque[str] = deque()
        self._asked: set[str] = set()
        self._health: dict[str, Any] | None = None
        self._silent = SILENCE
        self._pages: dict[str | None, str] = {}
        self._layout: tuple[Pane, ...] | None = None
        self._evidence: dict[str, str] = {}

    def start(self) -> None:
        """Ask for the state of all loops: a view that is opened late shows what is flagged already."""
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
            except (ValueError, KeyError, TypeError, OverflowError, msgspec.MsgspecError) as error:
                self._refuse(message, error)
        self._write_log(lines)
        for parts in trends.values():
            self._picture.trend(merged(parts))
        self._follow()
        for _ in range(min(QUESTIONS, len(self._questions))):
            self._ask(self._questions.popleft())
        self._draw()

    def close(self) -> None:
        """Hear nothing any more."""
        for subscriber in (*self._subscribers, *(s for pair in self._streams.values() for s in pair)):
            subscriber.undeclare()
        self._subscribers.clear()
        self._streams.clear()

    def _hear(self, sample: Any) -> None:
        if len(sample.payload) <= PAYLOAD_MAX:
            self.inbox.put(str(sample.key_expr), sample.payload.to_bytes())

    def _answered(self, reply: Any) -> None:
        if reply.ok is not None and len(reply.ok.payload) <= PAYLOAD_MAX:
            self.replies.put(str(reply.ok.key_expr), reply.ok.payload.to_bytes())

    def _ask(self, selector: str) -> None:
        self._session.get(selector, self._answered, timeout=10.0)

    def _one(self, message: Message, trends: dict[str, list[Trend]], lines: list[dict[str, Any]]) -> None:
        chunks = message.key.split("/")
        if chunks[1] == "@":
            self._heard_health(message, chunks[2])
            return
        by_id = chunks[-2] in ("history", "window")
        leaf, key = (chunks[-2], chunks[1:-2]) if by_id else (chunks[-1], chunks[1:-1])
        if leaf == "window":
            self._window(decode_window(message.payload))
        elif leaf == "trend":
            trend = decode_trend(message.payload)
            trends.setdefault(trend.loop, []).append(trend)
        else:
            self._fact(leaf, "/".join(key), record(message.payload), lines)

    def _fact(self, leaf: str, key: str, fact: dict[str, Any], lines: list[dict[str, Any]]) -> None:
        if not isinstance(fact.setdefault("loop", key), str):
            raise ValueError("loop is no text")
        name = fact["loop"]
        if leaf in ("status", "suggestion"):
            self.board.put(fact, key)
            if leaf == "suggestion":
                self._evidence[name] = str((fact.get("evidence") or [""])[-1])
            return
        if leaf in ("assessment", "history"):
            newest = self.board.assessments.get(name)
            if newest is None or str(fact.get("start")) >= str(newest.get("start")):
                self.board.assessments[name] = fact
            if leaf == "assessment":  # its loop's verdict may have changed
                self._question(f"{PREFIX}/{key}/status")
            else:
                self._question(f"{PREFIX}/{key}/window/{fact['id']}")
        if leaf != "history":
            lines.append(fact)

    def _window(self, window: Window) -> None:
        held = self.board.windows.get(window.loop)
        if window.loop not in self.board.shown or (held is not None and held.id == window.id):
            return
        self._picture.window(window)
        if held is None or window.onset >= held.onset:
            self.board.windows[window.loop] = window
