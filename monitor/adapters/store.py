"""SQLite: what has been said, kept before it is said.

One transaction a tick (WAL, ``synchronous=FULL``): what is committed survives a kill at any instant. What is old
goes when it is older than the store is to reach back, or when the store has grown beyond its size, oldest first;
by when it was kept, not by its own time, for a replay of past years is as new as what happens now.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

_LATEST = """
SELECT (SELECT coalesce(max(rowid), 0) FROM event), (SELECT coalesce(max(rowid), 0) FROM assessment),
  (SELECT coalesce(max(rowid), 0) FROM suggestion)
"""
"""The newest row of each table that grows."""
SCHEMA = """
CREATE TABLE IF NOT EXISTS event (id TEXT PRIMARY KEY, key TEXT NOT NULL, start INTEGER NOT NULL, json BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS assessment
  (id TEXT PRIMARY KEY, key TEXT NOT NULL, start INTEGER NOT NULL, json BLOB NOT NULL, window BLOB);
CREATE INDEX IF NOT EXISTS assessment_of ON assessment (key, start);
CREATE TABLE IF NOT EXISTS suggestion (number INTEGER PRIMARY KEY, key TEXT NOT NULL, json BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS loop (key TEXT PRIMARY KEY, json BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS memory
  (key TEXT PRIMARY KEY, declared BLOB NOT NULL, loop BLOB NOT NULL, layout TEXT NOT NULL, known BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS waiting (id TEXT PRIMARY KEY, key TEXT NOT NULL, layout TEXT NOT NULL, known BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS shelf (key TEXT PRIMARY KEY, until INTEGER NOT NULL, reason TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS published (event INTEGER, assessment INTEGER, suggestion INTEGER);
CREATE TABLE IF NOT EXISTS day (number INTEGER PRIMARY KEY, event INTEGER, assessment INTEGER, suggestion INTEGER);
"""
VERSION = 2
_FROM = {1: "DROP TABLE IF EXISTS plan; INSERT INTO published " + _LATEST}
"""What makes the next version's out of an earlier one; of version 1 a retune that was under way is forgotten."""
_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}
"""Errors, without their extended part, that say that the file is no database any more."""
LOCK_WITHIN_S = 0.25
"""How long a lock of somebody else's may hold up the tick [s]."""
KEEP_DAYS = 730.0
"""How far back what was kept reaches [days]."""
KEEP_BYTES = 4 * 2**30
"""How much it may be: about 200,000 events with their evidence."""
TIDY_RECORDS = 200
"""That one `tidy` removes at most: a few milliseconds."""
_DAY_NS = 86_400 * 10**9
_COUNT = {
    "event": "SELECT count(*) FROM event",
    "assessment": "SELECT count(*) FROM assessment",
    "suggestion": "SELECT count(*) FROM suggestion",
}
"""Of the tables that grow."""
_REMOVE = {
    "event": "DELETE FROM event WHERE rowid IN (SELECT rowid FROM event WHERE rowid <= ? ORDER BY rowid LIMIT ?)",
    "assessment": """DELETE FROM assessment WHERE rowid IN
      (SELECT rowid FROM assessment WHERE rowid <= ? ORDER BY rowid LIMIT ?)""",
    "suggestion": """DELETE FROM suggestion WHERE rowid IN
      (SELECT rowid FROM suggestion WHERE rowid <= ? ORDER BY rowid LIMIT ?)""",
}
"""The oldest rows up to one, so many of them."""
_SINCE = (
    "SELECT key, json, NULL FROM event WHERE rowid > ? ORDER BY rowid",
    "SELECT key, json, window FROM assessment WHERE rowid > ? ORDER BY rowid",
    "SELECT key, json, NULL FROM suggestion WHERE rowid > ? ORDER BY rowid",
)
"""The rows after one, of each of these tables."""
_ANY = 2**63 - 1


class Latest(NamedTuple):
    """The newest row of each table that grows."""

    event: int
    assessment: int
    suggestion: int


class Memory(NamedTuple):
    """What is known of a loop."""

    key: str
    declared: bytes
    """Its row of the loop table, MessagePack."""
    loop: bytes
    """The same with what was said since, MessagePack."""
    layout: str
    """Of ``known``."""
    known: bytes


class Shelved(NamedTuple):
    """A loop whose flag is put aside."""

    key: str
    until: int
    """[ns since 1970]"""
    reason: str


class Unpublished(NamedTuple):
    """A record that may not have been published."""

    kind: str
    """``event``, ``assessment`` or ``suggestion``."""
    key: str
    """The loop's."""
    json: bytes
    window: bytes | None
    """Of an assessment."""


class StoreError(OSError):
    """The state cannot be opened or written; one line."""


class Store:
    """The monitor's memory of what it published.

    Parameters
    ----------
    folder
        Made where it is missing; holds ``loopsight.sqlite``.
    keep_days, keep_bytes
        What is older, or more, is removed by `tidy`.

    Raises
    ------
    StoreError
        The folder or the file cannot be used, or another monitor uses it.
    """

    def __init__(self, folder: Path, keep_days: float = KEEP_DAYS, keep_bytes: int = KEEP_BYTES) -> None:
        self.path = folder / "loopsight.sqlite"
        self.keep_days, self.keep_bytes = keep_days, keep_bytes
        self.damage = ""
        """What was damaged when the file was opened, in words, and what became of it; empty where nothing was."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"{self.path}: {error}") from None
        self._lock = _lock(folder)
        try:
            self._open()
        except StoreError:
            self._lock.close()
            raise

    def _open(self) -> None:
        """Open the file; a damaged one is set aside, for whoever wants to save what is left, and a new one begun."""
        try:
            why = self._connect()
            if why:
                aside = self.path.with_name(f"{self.path.name}.damaged-{time.strftime('%Y%m%dT%H%M%S')}")
                for end in ("", "-wal", "-shm"):
                    with suppress(FileNotFoundError):
                        Path(f"{self.path}{end}").rename(f"{aside}{end}")
                self.damage = f"{self.path}: damaged ({why}); set aside as {aside.name}, and begun anew"
                why = self._connect()
        except (sqlite3.Error, OSError) as error:
            raise error if isinstance(error, StoreError) else StoreError(f"{self.path}: {error}") from None
        if why:
            raise StoreError(f"{self.path}: {why}")

    def _connect(self) -> str:
        """Open the file as it is, and bring it up to this version; return what is damaged, empty where nothing is."""
        self._db = sqlite3.connect(self.path, timeout=LOCK_WITHIN_S, isolation_level=None)
        try:
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=FULL")
            found = self._db.execute("PRAGMA user_version").fetchone()[0]
            why = "ok" if found == 0 else str(self._db.execute("PRAGMA quick_check(1)").fetchone()[0])
            if why == "ok" and found <= VERSION:
                change = f"{SCHEMA}; {_FROM.get(found, '')}; PRAGMA user_version={VERSION}"
                self._db.executescript(f"BEGIN; {change}; COMMIT;")
        except BaseException as error:
            self._db.close()
            if isinstance(error, sqlite3.DatabaseError) and error.sqlite_errorcode & 0xFF in _DAMAGED:
                return str(error)
            raise
        if why == "ok" and found <= VERSION:
            return ""
        self._db.close()
        if found > VERSION:
            raise StoreError(f"{self.path}: written by a later version ({found}), expected {VERSION} or less")
        return why

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All that is kept inside is committed together, or not at all.

        Raises
        ------
        StoreError
            Disk full, read-only, damaged.
        """
        try:
            self._db.execute("BEGIN IMMEDIATE")
            yield
            self._db.execute("COMMIT")
        except BaseException as error:
            with suppress(sqlite3.Error):  # a disk that fails may fail here again
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")
            if isinstance(error, sqlite3.Error):
                raise StoreError(f"{self.path}: {error}") from None
            raise

    def keep_event(self, identity: str, key: str, start: int, json: bytes) -> None:
        """Keep an event; a closing replaces its opening."""
        self._db.execute("INSERT OR REPLACE INTO event VALUES (?, ?, ?, ?)", (identity, key, start, json))

    def keep_assessment(self, identity: str, key: str, start: int, json: bytes, window: bytes) -> None:
        """Keep an assessment with its evidence; the same event assessed again replaces it."""
        self._db.execute(
            "INSERT OR REPLACE INTO assessment VALUES (?, ?, ?, ?, ?)", (identity, key, start, json, window)
        )

    def keep_suggestion(self, key: str, json: bytes) -> None:
        """Append a suggestion to the history."""
        self._db.execute("INSERT INTO suggestion (key, json) VALUES (?, ?)", (key, json))

    def keep_row(self, key: str, json: bytes) -> None:
        """Keep a loop's current row."""
        self._db.execute("INSERT OR REPLACE INTO loop VALUES (?, ?)", (key, json))

    def keep_memory(self, memory: Memory) -> None:
        """Keep what is known of a loop, in place of what was."""
        self._db.execute("INSERT OR REPLACE INTO memory VALUES (?, ?, ?, ?, ?)", memory)

    def drop_memory(self, key: str) -> None:
        """Forget a loop."""
        self._db.execute("DELETE FROM memory WHERE key = ?", (key,))

    def memories(self) -> Iterator[Memory]:
        """Yield what is known of each loop."""
        for row in self._read("SELECT key FROM memory"):  # one at a time: together they may be a gigabyte
            yield Memory(*self._read("SELECT * FROM memory WHERE key = ?", row)[0])

    def keep_waiting(self, identity: str, key: str, layout: str, known: bytes) -> None:
        """Keep an event that waits to be assessed."""
        self._db.execute("INSERT OR REPLACE INTO waiting VALUES (?, ?, ?, ?)", (identity, key, layout, known))

    def drop_waiting(self, identity: str) -> None:
        """Forget that an event waits."""
        self._db.execute("DELETE FROM waiting WHERE id = ?", (identity,))

    def waiting(self) -> list[tuple[str, str, str, bytes]]:
        """Return (id, loop key, layout, what is known) of the events that wait to be assessed, in order."""
        rows = self._read("SELECT id, key, layout, known FROM waiting ORDER BY rowid")
        return [(str(i), str(k), str(layout), bytes(known)) for i, k, layout, known in rows]

    def keep_shelved(self, one: Shelved) -> None:
        """Keep that a loop's flag is put aside."""
        self._db.execute("INSERT OR REPLACE INTO shelf VALUES (?, ?, ?)", one)

    def drop_shelved(self, key: str) -> None:
        """Forget that a loop's flag is put aside."""
        self._db.execute("DELETE FROM shelf WHERE key = ?", (key,))

    def shelved(self) -> list[Shelved]:
        """Return the loops whose flags are put aside."""
        return [Shelved(*row) for row in self._read("SELECT key, until, reason FROM shelf ORDER BY key")]

    # -- what has been published --------------------------------------------------------------------

    def latest(self) -> Latest:
        """Return the newest row of each table that grows."""
        return Latest(*self._read(_LATEST)[0])

    def keep_published(self, up_to: Latest) -> None:
        """Note that all up to these rows has been published."""
        self._db.execute("DELETE FROM published")
        self._db.execute("INSERT INTO published VALUES (?, ?, ?)", up_to)

    def unpublished(self) -> list[Unpublished]:
        """Return what was kept after what is known to have been published, events first."""
        since = (self._read("SELECT * FROM published") or [(0, 0, 0)])[0]
        return [
            Unpublished(name, *row)
            for name, question, after in zip(_COUNT, _SINCE, since, strict=True)
            for row in self._read(question, (after,))
        ]

    def assessments(
        self, key: str, since: int | None = None, until: int | None = None, limit: int = 1000
    ) -> list[tuple[str, bytes]]:
        """Return (id, json) of a loop's assessments with ``since <= start < until``, oldest first, newest kept."""
        rows = self._read(
            "SELECT id, json FROM (SELECT * FROM assessment WHERE key = ? AND start >= ? AND start < ?"
            " ORDER BY start DESC LIMIT ?) ORDER BY start",
            (key, -(2**63) if since is None else since, 2**63 - 1 if until is None else until, limit),
        )
        return [(str(i), bytes(j)) for i, j in rows]

    def assessment(self, identity: str) -> tuple[str, bytes] | None:
        """Return (loop key, json) of an event's assessment."""
        rows = self._read("SELECT key, json FROM assessment WHERE id = ?", (identity,))
        return (str(rows[0][0]), bytes(rows[0][1])) if rows else None

    def open_events(self) -> list[tuple[str, bytes]]:
        """Return (loop key, json) of the events that were said to have opened, and not to have closed."""
        rows = self._read("SELECT key, json FROM event WHERE instr(json, ?)", (b'"state":"open"',))
        return [(str(k), bytes(j)) for k, j in rows]

    def is_over(self, identity: str) -> bool:
        """Whether an event is known to have closed."""
        closed = self._read(
            "SELECT 1 FROM event WHERE id = ? AND NOT instr(json, ?)", (identity, b'"state":"open"')
        )
        return bool(closed or self._read("SELECT 1 FROM assessment WHERE id = ?", (identity,)))

    def _read(self, question: str, values: tuple[Any, ...] = ()) -> list[Any]:
        try:
            return self._db.execute(question, values).fetchall()
        except (sqlite3.Error, OverflowError) as error:
            raise StoreError(f"{self.path}: {error}") from None

    def window(self, identity: str) -> tuple[str, bytes] | None:
        """Return (loop key, Arrow stream) of an event's evidence."""
        rows = self._read("SELECT key, window FROM assessment WHERE id = ?", (identity,))
        return (str(rows[0][0]), bytes(rows[0][1])) if rows and rows[0][1] is not None else None

    def rows(self) -> dict[str, bytes]:
        """Return the last row of each loop, by key."""
        return {str(k): bytes(j) for k, j in self._read("SELECT key, json FROM loop")}

    def counts(self) -> dict[str, int]:
        """Return how many of each are kept."""
        return {name: int(self._read(question)[0][0]) for name, question in _COUNT.items()}

    def tidy(self, now: int) -> bool:
        """Remove some of what is too old or too much; True if there may be more of it.

        Parameters
        ----------
        now
            Wall time [ns since 1970].

        Raises
        ------
        StoreError
            Disk full, read-only, damaged.
        """
        with self.transaction():
            today = now // _DAY_NS
            latest = self._read(_LATEST)[0]
            self._db.execute("INSERT OR REPLACE INTO day VALUES (?, ?, ?, ?)", (today, *latest))
            old = self._read(
                "SELECT number, event, assessment, suggestion FROM day WHERE number < ? ORDER BY number DESC LIMIT 1",
                (today - self.keep_days,),
            )
            removed = 0
            for name, last in zip(_REMOVE, old[0][1:] if old else (), strict=False):
                removed += self._remove(name, last)
            if old and not removed:  # what that day ended with is gone
                self._db.execute("DELETE FROM day WHERE number <= ?", (old[0][0],))
            while self.size > self.keep_bytes and removed < TIDY_RECORDS:
                gone = self._remove("assessment", most=10) or self._remove("event")
                removed += gone
                if not gone:
                    break
        return removed > 0

    def _remove(self, name: str, last: int = _ANY, most: int = TIDY_RECORDS) -> int:
        """Remove the oldest of a table's rows, up to a ``last`` one; return how many went."""
        return self._db.execute(_REMOVE[name], (last, most)).rowcount

    @property
    def size(self) -> int:
        """What is kept [bytes]; room that has become free is used again, so that the file does not outgrow it."""
        pages, free, size = (
            int(self._read(f"PRAGMA {n}")[0][0]) for n in ("page_count", "freelist_count", "page_size")
        )
        return (pages - free) * size

    def close(self) -> None:
        """Close the file."""
        self._db.close()
        self._lock.close()


def _lock(folder: Path) -> sqlite3.Connection:
    """Keep other monitors out for as long as this connection is open; a kill opens it."""
    path = folder / "loopsight.lock"
    try:
        lock = sqlite3.connect(path, timeout=0.0, isolation_level=None)
    except sqlite3.Error as error:
        raise StoreError(f"{path}: {error}") from None
    try:
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:
        lock.close()
        why = "another monitor uses this folder" if "locked" in str(error) else str(error)
        raise StoreError(f"{path}: {why}") from None
    return lock
