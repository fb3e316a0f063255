"""SQLite: what has been said, kept before it is said.

One transaction a tick (WAL, ``synchronous=FULL``): what is committed survives a kill at any instant.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

SCHEMA = """
CREATE TABLE IF NOT EXISTS event (id TEXT PRIMARY KEY, key TEXT NOT NULL, start INTEGER NOT NULL, json BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS assessment
  (id TEXT PRIMARY KEY, key TEXT NOT NULL, start INTEGER NOT NULL, json BLOB NOT NULL, window BLOB);
CREATE INDEX IF NOT EXISTS assessment_of ON assessment (key, start);
CREATE TABLE IF NOT EXISTS suggestion (number INTEGER PRIMARY KEY, key TEXT NOT NULL, json BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS loop (key TEXT PRIMARY KEY, json BLOB NOT NULL);
"""
VERSION = 1
PATIENCE = 0.25
"""How long a lock of somebody else's may hold up the tick [s]."""


class StoreError(OSError):
    """The state cannot be opened or written; one line."""


class Store:
    """The monitor's memory of what it published.

    Parameters
    ----------
    folder
        Made where it is missing; holds ``loopsight.sqlite``.

    Raises
    ------
    StoreError
        The folder or the file cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "loopsight.sqlite"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, timeout=PATIENCE, isolation_level=None)
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=FULL")
            found = self._db.execute("PRAGMA user_version").fetchone()[0]
            if found in {0, VERSION}:
                self._db.executescript(SCHEMA)
                self._db.execute(f"PRAGMA user_version={VERSION}")
        except (sqlite3.Error, OSError) as error:
            raise StoreError(f"{self.path}: {error}") from None
        if found not in {0, VERSION}:
            self._db.close()
            raise StoreError(f"{self.path}: written by another version ({found}), expected {VERSION}")

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
        names = ("event", "assessment", "suggestion")
        return {n: int(self._read(f"SELECT count(*) FROM {n}")[0][0]) for n in names}  # noqa: S608 (our own names)

    def close(self) -> None:
        """Close the file."""
        self._db.close()
