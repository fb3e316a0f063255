"""The long-running service: bus to engine to store to bus, one tick after the other.

The bus's own threads only enqueue; everything else happens in the thread that calls `Service.tick`. What is
published has been committed before.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from monitor.adapters.store import Store, StoreError
from monitor.contract import keys
from monitor.contract.entries import Message
from monitor.contract.evidence import Window
from monitor.contract.loops import NAME_BYTES, Loop, LoopTable
from monitor.contract.records import RETUNE, WORST_FIRST, Assessment, Event, LoopRow, Record, Suggestion
from monitor.contract.samples import Samples
from monitor.contract.times import given_time, iso
from monitor.engine import Engine
from monitor.verdict.row import worst_first
from monitor.verdict.stale import LIVE, is_stale, mark_stale
from monitor.wire.arrow import encode_trend, encode_window
from monitor.wire.decode import Decoder
from monitor.wire.encode import FRAME_MIME, JSON_MIME, decode_event, encode_record, to_json

from .config import Config
from .reorder import Order
from .snapshot import OpenEvents

log = logging.getLogger("loopsight")

MOST_MESSAGES, MOST_BYTES = 50_000, 16 * 2**20
"""Messages, and their bytes, taken from the inbox in one tick: a backlog does not hide all else."""
ASSESS_TIME = 0.05
"""Time in a tick for assessing closed events: in an upset the ingest goes on [s]."""
STATUS_EVERY = 10.0
"""[s]"""
RELEASE_EVERY, WATCH_EVERY = 0.1, 0.2
"""Between two looks at all loops: for idle ones, and for those worth a trend [s]."""
TREND_EVERY = 1.0
"""[s]"""
MOST_TRENDS = 50
"""Loops whose new samples are published for the eye."""
MOST_LOOPS = 200_000
"""Loops that may register themselves."""
MOST_ANSWERS = 10_000
"""Records that answer one query."""
ANSWER_TIME = 0.05
"""Time in a tick for answering queries; the rest waits for the next [s]."""
FINISH_TIME = 6.0
"""Time for working off and assessing what is held when told to stop; events left over are kept as closed [s]."""
RETRY = 1.0
"""Pause before a store that failed is tried again [s]."""
MOST_UNKEPT = 10_000
"""Records that wait for a store that fails; beyond, the oldest are given up and counted."""
NEVER_GOOD = 30
"""Bad samples of a loop without a single good one after which it counts as stale, too."""
STALE_EVERY = 1.0
"""Between two looks at who has fallen silent [s]."""
RETIRE_AFTER = 30 * 86_400.0
"""Time without a good sample after which a loop that has registered itself is given up: a shutdown is shorter [s]."""
TIDY_EVERY = 60.0
"""Between two looks at what is too old or too much in the store [s]."""
SNAPSHOT_EVERY = 10.0
"""Between two writings of what must outlive a kill [s]."""
MOST_NAMED = 20
"""Names in a line of the log or a list of the status."""


class Bus(Protocol):
    """What the service needs of the bus."""

    inbox: Any
    questions: deque[Any]
    unsaid: int

    def say(self, key: str, payload: bytes, encoding: str) -> None:
        """Publish."""


@dataclass(frozen=True, slots=True)
class _Said:
    """One record on its way: first to the store, then to the bus."""

    key: str
    payload: bytes
    encoding: str
    keep: Callable[[Store], None]


class Service:
    """Drives the engine with what the bus brings.

    Parameters
    ----------
    config, loops
        What to watch, and how.
    bus
        Its ``inbox`` brings messages, its ``questions`` queries; `say` publishes.
    store
        Keeps what is published.
    heard
        Called with every record, after it was published.
    clock
        Wall time [ns since 1970]: for refusing the future, and for the status.
    monotonic
        [s]: for everything that waits.
    open_file
        Where the state of loops with an open event is kept; None: an open event ends with the process.
    """

    def __init__(
        self,
        config: Config,
        loops: LoopTable,
        bus: Bus,
        store: Store,
        heard: Callable[[Record], None] | None = None,
        clock: Callable[[], int] = time.time_ns,
        monotonic: Callable[[], float] = time.monotonic,
        open_file: Path | None = None,
    ) -> None:
        self.config = config
        self.loops = loops
        self.bus = bus
        self.store = store
        self.engine = Engine(loops)
        self.order = Order(len(loops), config.reorder_window)
        register = self._register if config.auto_register or not config.loops else None
        self.decoder = Decoder(loops, register)
        self.stores = True
        """Whether what is found can be kept."""
        self.silent = False
        """Whether all loops that were heard have fallen silent: not one of them, but the line to them."""
        self.given_up = 0
        """Records lost because the store failed for too long."""
        self._heard = heard
        self._clock, self._monotonic = clock, monotonic
        self._started = monotonic()
        self._closed_by_settings: list[Record] = []
        self._unkept: deque[_Said] = deque()
        self._retry = 0.0
        self._flagged: set[int] = set()
        self._trend: list[Samples] = []
        self._next_status = self._next_trend = self._next_release = self._next_watch = monotonic()
        self._next_stale = monotonic()
        self._next_tidy = monotonic() + TIDY_EVERY
        self._stale: set[int] = set()
        self._registered: dict[int, float] = {}
        """Loops that are in no table, and when they were first heard."""
        self._latency = 0.0
        self._watched = np.zeros(0, np.bool_)
        self._last = (monotonic(), 0, 0)
        self._rates = (0.0, 0.0)
        self._old_rows = store.rows()
        self._open = OpenEvents(open_file)
        self._next_snapshot = monotonic() + SNAPSHOT_EVERY
        self._left_open = [] if open_file is None else self._take_up()

    # -- the tick -----------------------------------------------------------------------------------

    def tick(self) -> int:
        """Work off what has come in; return the number of messages."""
        messages = self.bus.inbox.take(MOST_MESSAGES, MOST_BYTES)
        now = self._monotonic()
        if messages:
            self._latency = max(self._latency, (self._clock() - messages[0].time) * 1e-9)
        samples, records = self._take_in(messages, now)
        if self._left_open:
            records, self._left_open = [*self._left_open, *records], []
        records += self._assess(ASSESS_TIME)
        self._publish(records)
        self._tell(records)
        self._show(samples, now)
        self._answer()
        if now >= self._next_stale:
            self._next_stale = now + STALE_EVERY
            self._look_for_silence(now)
        if now >= self._next_tidy:
            self._retire(now)
            self._tidy(now)
        if now >= self._next_snapshot:
            self._next_snapshot = now + SNAPSHOT_EVERY
            self._open.keep(self.engine, self.order, self._clock())
        if now >= self._next_status:
            self._next_status = now + STATUS_EVERY
            self.bus.say(keys.monitor_status(self.config.id), to_json(self.status()), JSON_MIME)
            self._latency = 0.0
        return len(messages)

    @property
    def ready(self) -> bool:
        """Whether what comes in is heard, and what is found is kept."""
        return self.stores and not self.silent

    def _take_in(self, messages: list[Message], now: float) -> tuple[list[Samples], list[Record]]:
        """Decode, put in order and detect; what nothing newer has followed for the window's length is let go."""
        batches: list[Samples] = []
        records: list[Record] = []
        if messages:
            latest = self._clock() + round(self.config.future * 1e9)
            entries = self.decoder.decode(messages, latest)
            self.engine.follow()
            if len(self.loops) > len(self.order.state):
                self.order.grow(max(2 * len(self.loops), 64))
            for row, loop in self.decoder.settings:
                records += self._retuned(row, loop)
            for cause, key, why in self.decoder.refused:
                log.warning("%s: %s: %s", cause, plain(key), plain(why))
            samples, at = self.order.push(entries, now), 0
            for place, row, first in self.order.stepped:
                batches.append(samples.take(slice(at, place)))
                records += [*self.engine.detect(batches[-1]), *self._set_back(row, first)]
                at = place
            batches.append(samples.take(slice(at, None)))
            records += self.engine.detect(batches[-1])
        if now >= self._next_release:  # looks at every loop: not at every tick
            self._next_release = now + RELEASE_EVERY
            batches.append(self.order.release(now - max(self.config.reorder_window, 0.1)))
            records += self.engine.detect(batches[-1])
        return [b for b in batches if len(b)], records

    def _retuned(self, row: int, loop: Loop) -> list[Record]:
        """Go over to a loop's new settings, ranges and period."""
        records = self.engine.retuned(row, loop)
        self._flagged.discard(row)
        self._old_rows.pop(loop.key, None)
        return records

    def _set_back(self, row: int, first: int) -> list[Record]:
        """Begin anew at an earlier time, ``first`` [ns]: what was late since then is a gap."""
        log.warning(
            "%s: its clock was set back to %s; it begins anew", plain(self.loops[row].name), iso(first)
        )
        return self.engine.set_back(row, first)

    def _register(self, name: str, key: str) -> int | None:
        """Watch a loop that is in no table."""
        if len(self.loops.by_name) >= MOST_LOOPS or not 0 < len(name.encode(errors="replace")) <= NAME_BYTES:
            return None
        if not name.isprintable() or "*" in key or "$" in key:  # for a terminal, or a key of many
            return None
        try:
            row = self.loops.add(Loop(name=name, key=key))
        except ValueError:
            return None
        self._registered[row] = self._monotonic()
        return row

    def _retire(self, now: float) -> None:
        """Give up loops that registered themselves and are silent for long: names change, memory is bounded."""
        arrival = self.order.state["arrival"]
        for row, since in list(self._registered.items()):
            if now - max(since, float(arrival[row])) <= RETIRE_AFTER:
                continue
            loop = self.loops[row]
            records = self.engine.retire(row)
            self._publish(records)
            self._tell(records)
            self.order.forget(row)
            self.decoder.forget(row)
            self.loops.remove(row)
            del self._registered[row]
            for rows in (self._flagged, self._stale):
                rows.discard(row)
            self._old_rows.pop(loop.key, None)
            log.warning("given up after a long silence: %s", plain(loop.name))

    def _assess(self, seconds: float) -> list[Record]:
        """Assess closed events for about this long; the rest waits for the next tick."""
        records: list[Record] = []
        until = self._monotonic() + seconds
        while self.engine.backlog:
            records += self.engine.assess(1)
            if self._monotonic() >= until:
                break
        return records

    # -- what is said -------------------------------------------------------------------------------

    def _publish(self, records: list[Record]) -> None:
        """Commit, then publish; where the store fails, wait with both."""
        self._unkept.extend(self._said(records))
        if not self._unkept:
            return
        while len(self._unkept) > MOST_UNKEPT:
            self._unkept.popleft()
            self.given_up += 1
        if not self.stores and self._monotonic() < self._retry:
            return
        try:
            with self.store.transaction():
                for said in self._unkept:
                    said.keep(self.store)
        except StoreError as error:
            if self.stores:
                log.error("store: %s; nothing is published until it is back", error)  # noqa: TRY400 (one line)
            self.stores = False
            self._retry = self._monotonic() + RETRY
            return
        if not self.stores:
            log.warning("store: back; %d records were waiting", len(self._unkept))
            self.stores = True
        for said in self._unkept:
            self.bus.say(said.key, said.payload, said.encoding)
        self._unkept.clear()

    def _tidy(self, now: float) -> None:
        """Remove what is too old from the store, a little at a time."""
        more = False
        try:
            more = self.stores and self.store.tidy(self._clock())
        except StoreError as error:
            log.debug("store: %s; nothing old is removed", error)  # `_publish` says it where it matters
        self._next_tidy = now + (STALE_EVERY if more else TIDY_EVERY)

    def _tell(self, records: list[Record]) -> None:
        if self._heard is not None:
            for record in records:
                self._heard(record)

    def _said(self, records: Iterable[Record]) -> list[_Said]:
        out: list[_Said] = []
        windows = {r.id: r for r in records if isinstance(r, Window)}
        for record in records:
            if isinstance(record, Event):
                out.append(self._say_event(record))
            elif isinstance(record, Assessment):
                out += self._say_assessment(record, windows[record.id])
            elif isinstance(record, Suggestion):
                out.append(self._say_suggestion(record))
        return out

    def _key(self, loop: str) -> str:
        return self.loops[self.loops.by_name[loop]].key

    def _say_event(self, event: Event) -> _Said:
        key, payload = self._key(event.loop), encode_record(event)
        return _Said(
            keys.event(key), payload, JSON_MIME,
            lambda store: store.keep_event(event.id, key, event.start, payload),
        )  # fmt: skip

    def _say_assessment(self, record: Assessment, window: Window) -> list[_Said]:
        """Return the assessment, and its evidence for the eye; both are kept with the loop's row."""
        number = self.loops.by_name[record.loop]
        key, payload = self.loops[number].key, encode_record(record)
        evidence = encode_window(window, record.verdict, record.reason)
        row = self.row(number)
        row_json = encode_record(row)
        log.log(
            logging.INFO if record.verdict == RETUNE else logging.DEBUG,
            "%s: %s (%s) %s", record.loop, record.verdict, record.kind, record.reason,
        )  # fmt: skip
        if row.verdict == RETUNE:
            self._flagged.add(number)
        else:
            self._flagged.discard(number)

        def keep(store: Store) -> None:
            store.keep_assessment(record.id, key, record.start, payload, evidence)
            store.keep_row(key, row_json)

        return [
            _Said(keys.assessment(key), payload, JSON_MIME, keep),
            _Said(keys.window(key), evidence, FRAME_MIME, lambda _: None),
        ]

    def _say_suggestion(self, suggestion: Suggestion) -> _Said:
        key, payload = self._key(suggestion.row.loop), encode_record(suggestion)
        log.info("%s: suggestion: %s", suggestion.row.loop, suggestion.row.action)
        return _Said(
            keys.suggestion(key),
            payload,
            JSON_MIME,
            lambda store: store.keep_suggestion(key, payload),
        )

    def _show(self, batches: list[Samples], now: float) -> None:
        """Publish the new samples of flagged loops and of open events, about once a second."""
        if now >= self._next_watch or len(self._watched) < len(self.loops):
            self._next_watch = now + WATCH_EVERY
            self._watched = np.zeros(len(self.loops), np.bool_)
            self._watched[sorted(self._flagged)[:MOST_TRENDS]] = True
            self._watched[self.engine.open_rows()[:MOST_TRENDS]] = True
        self._trend += [b.take(self._watched[b.loop]) for b in batches]
        if now < self._next_trend:
            return
        self._next_trend = now + TREND_EVERY
        trend, self._trend = [b for b in self._trend if len(b)], []
        if not trend:
            return
        loops = np.concatenate([b.loop for b in trend])
        columns = {n: np.concatenate([getattr(b, n) for b in trend]) for n in ("time", "sp", "pv", "op")}
        for row in np.unique(loops):
            own = {n: c[loops == row] for n, c in columns.items()}
            time_column: NDArray[np.int64] = own.pop("time")
            payload = encode_trend(self.loops[int(row)].name, time_column, own)
            self.bus.say(keys.trend(self.loops[int(row)].key), payload, FRAME_MIME)

    # -- what is asked ------------------------------------------------------------------------------

    def _answer(self) -> None:
        until = self._monotonic() + ANSWER_TIME
        while self.bus.questions:
            question = self.bus.questions.popleft()
            try:
                question.answer(self._replies(question))
            except (ValueError, StoreError) as error:
                question.refuse(str(error))
            if self._monotonic() >= until:
                return

    def _replies(self, question: Any) -> list[tuple[str, bytes, str]]:
        chunks = question.key.split("/")
        if chunks[-1] == "status":
            return [(k, p, JSON_MIME) for k, p in self._status_rows(question)]
        if len(chunks) > 1 and chunks[-2] == "window":
            found = self.store.window(chunks[-1])
            key = "" if found is None else keys.window(found[0], chunks[-1])
            return [] if found is None or not question.matches(key) else [(key, found[1], FRAME_MIME)]
        return self._history(question)

    def _status_rows(self, question: Any) -> list[tuple[str, bytes]]:
        own = keys.monitor_status(self.config.id)
        if question.matches(own):
            return [(own, to_json(self.status()))]
        out = []
        for loop_key, number in self.loops.by_key.items():
            key = keys.status(loop_key)
            if question.matches(key):
                out.append((key, self._current(number, self.loops[number])))
        return out

    def _current(self, number: int, loop: Loop) -> bytes:
        """Return a loop's row: of this run, or the last one kept of an earlier run."""
        if self.engine.verdict(number) is None and loop.key in self._old_rows:
            return self._old_rows[loop.key]
        return encode_record(self.row(number))

    def _history(self, question: Any) -> list[tuple[str, bytes, str]]:
        """Return stored assessments of the loops asked for, one key each."""
        asked = question.parameters
        since, until = (_instant(name, asked.get(name)) for name in ("since", "until"))
        limit = _limit(asked.get("limit"))
        last = question.key.rpartition("/")[2]
        out: list[tuple[str, bytes, str]] = []
        for loop_key in self.loops.by_key:
            if not question.matches(keys.history(loop_key, last)):
                continue
            for identity, payload in self.store.assessments(loop_key, since, until, limit):
                key = keys.history(loop_key, identity)
                if question.matches(key):
                    out.append((key, payload, JSON_MIME))
            if len(out) >= MOST_ANSWERS:
                break
        return out[:MOST_ANSWERS]

    def status(self) -> dict[str, Any]:
        """Return the monitor's health, for the bus and for ``loopsight status``."""
        counts = self.engine.counts()
        ok = counts.pop("ok")
        causes = (
            "malformed",
            "too_large",
            "unknown_loop",
            "future",
            "bad_time",
            "missed_frames",
            "repeated_frames",
        )
        for name in ("late", "duplicate", "conflict"):
            counts[name] += getattr(self.order, name)
        now = self._monotonic()
        self._measure(now, ok)
        watched = self.loops.by_name.values()
        verdicts = [self.engine.verdict(k) or WORST_FIRST[-1] for k in watched]
        return {
            "id": self.config.id,
            "time": iso(self._clock()),
            "uptime": round(now - self._started, 1),
            "ready": self.ready,
            "not_ready": [why for why, so in (("store", not self.stores), ("silent", self.silent)) if so],
            "loops": {
                "total": len(watched),
                **{v: verdicts.count(v) for v in WORST_FIRST},
                "open": len(self.engine.open_rows()),
                "stale": len(self._stale),
            },
            "flagged": [self.loops[k].name for k in sorted(self._flagged)[:100]],
            "messages": self.bus.inbox.received,
            "dropped": self.bus.inbox.dropped,
            "samples_ok": ok,
            **counts,
            **{cause: self.decoder.causes[cause] for cause in causes},
            "clock_steps": self.order.steps,
            "clock_ahead": [self.loops[k].name for k in sorted(self.decoder.ahead)[:MOST_NAMED]],
            "stale": [self.loops[k].name for k in sorted(self._stale)[:MOST_NAMED]],
            "disturbances": self.engine.disturbances,
            "unknown": dict(self.decoder.unknown.most_common(20)),
            "rates": {"messages": round(self._rates[0], 1), "samples": round(self._rates[1], 1)},
            "queue": len(self.bus.inbox),
            "latency": round(self._latency, 3),
            "held": self.order.waiting,
            "crowded": self.order.crowded,
            "backlog": self.engine.backlog,
            "waiting_for_store": len(self._unkept),
            "given_up": self.given_up,
            "unsaid": self.bus.unsaid,
        }

    def _measure(self, now: float, ok: int) -> None:
        """Rates [1/s] since the last look, at least a second ago."""
        then, messages, samples = self._last
        if now - then >= 1.0:
            received = self.bus.inbox.received
            self._rates = ((received - messages) / (now - then), (ok - samples) / (now - then))
            self._last = (now, received, ok)

    def _look_for_silence(self, now: float) -> None:
        """Notice loops that send bad samples, or none, for three periods; say what has changed, in a line."""
        last = self.engine.last_samples()
        order = self.order.state[: len(last.time)]
        seen = last.good > 0
        heard = seen | (last.bad_run >= NEVER_GOOD)
        # what a clock says of the last good sample, and, for values out of range, what the samples' own times say
        behind = is_stale((order["newest"] - last.time) * 1e-9, last.period, LIVE)
        quiet = is_stale(now - order["arrival"], last.period, LIVE) | ((last.bad_run > 0) & behind)
        found = set(np.flatnonzero(heard & (quiet | ~seen)).tolist())
        silent = bool(found) and len(found) == int(heard.sum())
        if silent != self.silent:
            self.silent = silent
            self._next_status = now  # said at once, and once: not for each loop
            log.warning("%s", "no good samples of any loop: not ready" if silent else "samples are back")
        elif not silent:
            new = found - self._stale
            bad = {k for k in new if last.bad_run[k] > 0}
            changes = (("stale", new - bad), ("only bad samples", bad), ("heard again", self._stale - found))
            for what, rows in changes:
                if rows:
                    log.warning("%s: %s", what, self._named(rows))
        self._stale = found

    def _named(self, rows: Iterable[int]) -> str:
        """Name loops in a line, the first of them."""
        names = [plain(self.loops[k].name) for k in sorted(rows)]
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        return ", ".join(names[:MOST_NAMED]) + more

    def row(self, number: int) -> LoopRow:
        """Return a loop's row, marked where nothing comes from it any more."""
        last = self.engine.last_sample(number)
        return mark_stale(self.engine.row(number), last, iso(last.time) if number in self._stale else None)

    def rows(self) -> list[LoopRow]:
        """Return all loops' rows, worst first."""
        return sorted(map(self.row, self.loops.by_name.values()), key=worst_first)

    # -- begin and end ------------------------------------------------------------------------------

    def _take_up(self) -> list[Record]:
        """Go on with the events that were open when the process was killed; return the others, as interrupted."""
        going_on = self._open.take_up(
            self.engine, self.order, self._row_of, self.store.is_over, self._clock(), self._monotonic()
        )
        left = [e for e in map(decode_event, self.store.open_events()) if e.loop in self.loops.by_name]
        left = [e for e in left if e.id not in going_on]
        if left:
            log.warning("%d events were open when the last run ended: interrupted", len(left))
        return [msgspec.structs.replace(e, state="interrupted") for e in left]

    def _row_of(self, name: str, key: str) -> int:
        """Return a loop's row, -1 where it is not watched."""
        row = self.loops.by_name.get(name)
        if row is None and self.decoder.register is not None:
            row = self.decoder.register(name, key)
        return -1 if row is None else row

    def run(self, stop: threading.Event) -> None:
        """Tick until told to stop; then finish what is held."""
        while not stop.is_set():
            if self.tick() == 0:
                stop.wait(self.config.tick)
        self.finish()

    def finish(self) -> None:
        """Work off the inbox and the window, close open events, store and publish.

        What comes in meanwhile is left: a publisher that never pauses must not keep us.
        """
        until = self._monotonic() + FINISH_TIME
        left = len(self.bus.inbox)
        while left > 0 and self._monotonic() < until and (taken := self.tick()):
            left -= taken
        last = self.order.release(np.inf)
        records = [*self._left_open, *(self.engine.detect(last) if len(last) else [])]
        records += self.engine.close()
        while True:
            self._retry = 0.0
            self._publish(records)
            self._tell(records)
            if not self.engine.backlog or self._monotonic() >= until:
                break
            records = self._assess(10 * ASSESS_TIME)
        self._open.keep(self.engine, self.order, self._clock())  # now there is none
        if self.engine.backlog or left > 0:
            log.warning(
                "stop: %d events are kept without an assessment, %d messages left",
                self.engine.backlog,
                max(left, 0),
            )
        if self._unkept:
            log.error("store: still failing; %d records are lost", len(self._unkept))


def _instant(name: str, text: str | None) -> int | None:
    """Read a time of a query [ns]: ISO or epoch seconds."""
    if text is None:
        return None
    try:
        return given_time(text.replace(" ", "+"))  # what a browser makes of a + in a zone
    except ValueError:
        raise ValueError(f"{name}: {text[:50]!r}, expected ISO time or epoch seconds") from None


def _limit(text: str | None) -> int:
    """Read how many assessments of each loop are asked for."""
    if text is None:
        return 1000
    if not (text.isascii() and text.isdigit() and 0 < len(text) <= 9):
        raise ValueError(f"limit: {text[:50]!r}, expected a whole number of 0 or more")
    return min(int(text), MOST_ANSWERS)


def plain(text: str) -> str:
    """Return text that does nothing to a terminal or a log."""
    return "".join(c if c.isprintable() else "\ufffd" for c in text)


def warm_up() -> None:
    """Compile (or load) all kernels on a small rehearsal, so that the first real event does not wait for them."""
    loops = LoopTable([Loop(name="sluggish", kp=0.4, ti=300.0), Loop(name="swinging")])
    engine, order = Engine(loops), Order(2)
    n = 1500
    k = np.arange(n)
    sp = np.where((k >= 200) & (k < n - 20), 4.0, 0.0)  # one event that ends, one that is open at the end
    pv, op = np.zeros(n), np.zeros(n)
    integral = 0.0
    for j in range(1, n):
        pv[j] = pv[j - 1] + (0.05 * op[j - 5] if j >= 5 else 0.0)
        integral += (sp[j] - pv[j]) / 300.0
        op[j] = 0.4 * (sp[j] - pv[j] + integral)
    wave = np.sin(0.15 * k)
    time_ns = 10**18 + k * 10**9
    engine.step(Samples.of(0, time_ns, sp, pv + 1e-3 * np.sin(37.0 * k), op))
    engine.step(Samples.of(1, time_ns, 0.0, wave, -wave))
    engine.flush()
    engine.rows()
    order.push(np.zeros(1, order.held.dtype), 0.0)
    order.release(0.0)
