"""Records on their way: to the store first, then to the bus. What has been published is kept, whatever happens.

While the store fails nothing is published: both wait, up to a bound, beyond which the oldest are lost and counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from monitor.adapters.store import Latest, Store, StoreError
from monitor.contract import keys
from monitor.contract.evidence import Window
from monitor.contract.loops import LoopTable
from monitor.contract.records import RETUNE, Assessment, Event, LoopRow, Record, Suggestion
from monitor.wire.arrow import encode_window
from monitor.wire.encode import FRAME_MIME, JSON_MIME, encode_record

from .bus import Bus
from .journal import note
from .memories import Memories

WAITING_RECORDS = 10_000
"""That wait for a store that fails; beyond, the oldest are lost and counted."""
NOTE_S = 1.0
"""Where no records come, time after which it is noted what was published: who is killed before says it again [s]."""
RETRY_S = 1.0
"""Pause before a store that failed is tried again [s]."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """One record, encoded: how it is kept, and as what it is published then."""

    key: str
    payload: bytes
    encoding: str
    keep: Callable[[Store], None]


class Outbox:
    """Keeps and publishes records, in their order.

    Parameters
    ----------
    loops
        For the loops' keys.
    memories
        Of the loops: kept with their records.
    row
        A loop's current row, which is kept with each of its assessments.
    """

    def __init__(
        self, loops: LoopTable, bus: Bus, store: Store, memories: Memories, row: Callable[[int], LoopRow]
    ) -> None:
        self.stores = True
        """Whether what is found can be kept."""
        self.records_lost = 0
        """Because the store failed for too long."""
        self._loops, self._bus, self._store, self._row = loops, bus, store, row
        self._memories = memories
        self._waiting: deque[Outgoing] = deque()
        self._published: Latest | None = None
        """Up to where all has been published since that was last noted."""
        self._note = 0.0
        self._retry = 0.0

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, records: Iterable[Record]) -> list[tuple[int, LoopRow]]:
        """Take records on their way; return the loops that were assessed, each with its row of now."""
        records = list(records)
        windows = {r.id: r for r in records if isinstance(r, Window)}
        rows: list[tuple[int, LoopRow]] = []
        for record in records:
            if isinstance(record, Event):
                self._waiting.append(_event(self._key(record.loop), record))
            elif isinstance(record, Assessment):
                number = self._loops.by_name[record.loop]
                rows.append((number, self._row(number)))
                self._memories.hasten(number)
                self._waiting += self._assessment(record, windows[record.id], rows[-1][1])
            elif isinstance(record, Suggestion):
                self._waiting.append(self._suggestion(record))
        return rows

    def send(self, now: float, at_once: bool = False) -> None:
        """Commit what waits, then publish it; where the store fails, wait with both.

        Parameters
        ----------
        now
            [s, monotonic]
        at_once
            Try a store that has just failed again.
        """
        while len(self._waiting) > WAITING_RECORDS:
            self._waiting.popleft()
            self.records_lost += 1
        unnoted = self._published is not None and (at_once or now >= self._note)
        if not (self._waiting or unnoted or self._memories.due(now)):
            return
        if not (self.stores or at_once or now >= self._retry):
            return
        wrong = self._commit(now)
        if wrong:
            if self.stores:
                note("store_failing", why=wrong)
            self.stores = False
            self._retry = now + RETRY_S
            return
        if not self.stores:
            note("store_back", count=len(self._waiting))
            self.stores = True
        for outgoing in self._waiting:
            self._bus.publish(outgoing.key, outgoing.payload, outgoing.encoding)
        if self._waiting:
            self._published, self._note = self._store.latest(), now + NOTE_S
        self._waiting.clear()

    def _commit(self, now: float) -> str:
        """Keep all that waits, or nothing; return why not, empty where it is kept."""
        try:
            with self._store.transaction():
                if self._published is not None:
                    self._store.keep_published(self._published)
                for outgoing in self._waiting:
                    outgoing.keep(self._store)
                kept = self._memories.keep(now)
        except StoreError as error:
            return str(error)
        self._published = None
        kept()
        return ""

    def catch_up(self) -> None:
        """Publish what an earlier process has kept and may not have published: the same ids, the same records."""
        for record in self._store.unpublished():
            self._bus.publish(getattr(keys, record.kind)(record.key), record.json, JSON_MIME)
            if record.window is not None:
                self._bus.publish(keys.window(record.key), record.window, FRAME_MIME)
        self._published = self._store.latest()

    def let_go(self, key: str, event: Event) -> None:
        """Say that an event of a loop that is watched no more was interrupted."""
        self._waiting.append(_event(key, event))

    def tidy(self, now: int) -> bool:
        """Remove some of what is too old from the store at ``now`` [ns since 1970]; True if there may be more."""
        try:
            return self.stores and self._store.tidy(now)
        except StoreError as error:
            note("store_untidy", why=error)  # `send` says it where it matters
            return False

    # -- a record, encoded --------------------------------------------------------------------------

    def _key(self, loop: str) -> str:
        return self._loops[self._loops.by_name[loop]].key

    def _assessment(self, record: Assessment, window: Window, row: LoopRow) -> list[Outgoing]:
        """Return the assessment, and its evidence for the eye; both are kept with the loop's row."""
        key, payload, row_json = self._key(record.loop), encode_record(record), encode_record(row)
        evidence = encode_window(window, record.verdict, record.reason)
        note(
            "retune" if record.verdict == RETUNE else "assessment",
            loop=record.loop,
            verdict=record.verdict,
            kind=record.kind,
            reason=record.reason,
        )

        def keep(store: Store) -> None:
            store.keep_assessment(record.id, key, record.start, payload, evidence)
            store.keep_row(key, row_json)

        return [
            Outgoing(keys.assessment(key), payload, JSON_MIME, keep),
            Outgoing(keys.window(key), evidence, FRAME_MIME, lambda _: None),
        ]

    def _suggestion(self, suggestion: Suggestion) -> Outgoing:
        key, payload = self._key(suggestion.row.loop), encode_record(suggestion)
        note("suggestion", loop=suggestion.row.loop, action=suggestion.row.action)
        return Outgoing(
            keys.suggestion(key), payload, JSON_MIME, lambda store: store.keep_suggestion(key, payload)
        )


def _event(key: str, event: Event) -> Outgoing:
    payload = encode_record(event)
    return Outgoing(
        keys.event(key), payload, JSON_MIME,
        lambda store: store.keep_event(event.id, key, event.start, payload),
    )  # fmt: skip
