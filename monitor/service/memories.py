"""What is known of each loop outlives the process: kept beside its records, taken up at the next start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import TypeVar

import msgspec

from monitor import memory
from monitor.adapters.store import Memory, Store
from monitor.contract.loops import Loop, LoopTable
from monitor.engine import Engine
from monitor.memory import LAYOUT, LoopMemory, WaitingEvent

from .journal import note
from .reorder import Reorder

_Kind = TypeVar("_Kind", LoopMemory, WaitingEvent)

KEPT_A_SECOND = 50.0
"""Loops without a new record that are kept in a second: a thousand take 20 s, and 1 MB/s at most is written."""


class Memories:
    """Keeps what is known of the loops, and goes on with it.

    Parameters
    ----------
    now
        [s, monotonic]
    """

    def __init__(self, loops: LoopTable, engine: Engine, reorder: Reorder, store: Store, now: float) -> None:
        self._loops, self._engine, self._reorder, self._store = loops, engine, reorder, store
        self._at_once: set[int] = set()
        self._due: dict[int, None] = {}
        """Rows of which more is known, the longest waiting first."""
        self._gone: set[str] = set()
        """Keys of loops that are watched no more."""
        self._waiting: set[str] = set()
        """Ids of the events of which it is kept that they wait."""
        self._kept_at = now

    # -- kept ---------------------------------------------------------------------------------------

    def hasten(self, row: int) -> None:
        """Keep a loop with the next records: they rest on it."""
        self._at_once.add(row)

    def forget(self, row: int) -> None:
        """Forget a loop that is watched no more."""
        self._gone.add(self._loops[row].key)
        self._at_once.discard(row)
        self._due.pop(row, None)

    def due(self, now: float) -> bool:
        """Whether something is to be kept, records or not, at ``now`` [s, monotonic]."""
        self._due |= dict.fromkeys(self._engine.take_changed())
        return bool(self._at_once or self._gone or (self._due and now - self._kept_at >= 1.0))

    def keep(self, now: float) -> Callable[[], None]:
        """Put what is due at ``now`` [s, monotonic] into the store's transaction; return what to call after its commit.

        Raises
        ------
        StoreError, sqlite3.Error
            Disk full, read-only, damaged: all of it stays due.
        """
        self._due |= dict.fromkeys(self._engine.take_changed())
        some = islice(self._due, int(KEPT_A_SECOND * min(now - self._kept_at, 1.0)))
        rows, gone = self._at_once | set(some), set(self._gone)
        for key in gone:
            self._store.drop_memory(key)
        for row in rows:
            self._store.keep_memory(self._of(row))
        waiting = {one.id: one for one in self._engine.waiting}
        for identity in waiting.keys() - self._waiting:
            one = waiting[identity]
            self._store.keep_waiting(identity, self._loops[one.event.row].key, LAYOUT, memory.encode(one))
        for identity in self._waiting - waiting.keys():
            self._store.drop_waiting(identity)

        def kept() -> None:
            for row in rows:
                self._due.pop(row, None)
            self._at_once -= rows
            self._gone -= gone
            self._waiting = set(waiting)
            self._kept_at = now

        return kept

    def hasten_all(self) -> None:
        """Keep all of which more is known: the process ends."""
        self._at_once |= self._due.keys() | self._engine.take_changed()

    def _of(self, row: int) -> Memory:
        """Return what is known of a loop, as it is kept."""
        known = replace(self._engine.remember(row), tags=self._reorder.tags(row))
        declared, loop = (
            msgspec.msgpack.encode(one) for one in (self._engine.declared(row), self._loops[row])
        )
        return Memory(self._loops[row].key, declared, loop, LAYOUT, memory.encode(known))

    # -- taken up -----------------------------------------------------------------------------------

    def take_up(self, row_of: Callable[[str, str], int]) -> list[int]:
        """Go on with what is kept; return the rows of the loops of which it is more than settings.

        Parameters
        ----------
        row_of
            A loop's row in the table by name and key, -1 where it is not watched any more.
        """
        rows: list[int] = []
        unread = 0
        for kept in self._store.memories():
            try:
                declared, loop = (
                    msgspec.msgpack.decode(one, type=Loop) for one in (kept.declared, kept.loop)
                )
            except (msgspec.MsgspecError, ValueError) as error:
                note("memory_damaged", key=kept.key, why=error)
                continue
            row = row_of(declared.name, kept.key)
            if row < 0:
                continue
            self._engine.follow()
            self._reorder.grow(len(self._loops))
            known = self._read(kept.key, kept.layout, kept.known, LoopMemory)
            self._engine.recall(row, declared, loop, known)
            if known is None:
                unread += 1
                continue
            self._reorder.hold(row, known.tags, self._kept_at)
            rows.append(row)
        self._wait_again()
        if unread:
            note("memory_version", count=unread)
        return rows

    def _wait_again(self) -> None:
        """Have the events wait that were to be assessed."""
        for identity, key, layout, payload in self._store.waiting():
            self._waiting.add(identity)  # one that does not wait any more goes with the next records
            row, known = self._loops.by_key.get(key), self._read(key, layout, payload, WaitingEvent)
            if row is not None and known is not None:
                self._engine.waiting.append(replace(known, event=replace(known.event, row=row)))

    @staticmethod
    def _read(key: str, layout: str, payload: bytes, kind: type[_Kind]) -> _Kind | None:
        """Read what this version wrote; None where it was another, or where it is damaged."""
        try:
            known = memory.decode(payload) if layout == LAYOUT else None
        except ValueError as error:
            note("memory_damaged", key=key, why=error)
            return None
        return known if isinstance(known, kind) else None
