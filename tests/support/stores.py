"""A store that does not wait for the disk (what survives a power cut is not what is tested), and what one holds."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any, TypeVar

from monitor.adapters.store import Store

Kind = TypeVar("Kind", bound=Store)


def quick(folder: Path, kind: type[Kind] = Store) -> Kind:  # type: ignore[assignment]
    """Open a store whose transactions are done when the system has them."""
    store = kind(folder)
    store._db.execute("PRAGMA synchronous=OFF")
    return store


def stored(folder: Path, table: str = "assessment") -> dict[str, dict[str, Any]]:
    """Return what a folder's store has in a table, by id; whoever writes to it is not disturbed."""
    with closing(sqlite3.connect(f"file:{folder}/loopsight.sqlite?mode=ro", uri=True)) as db:
        rows = db.execute(f"SELECT id, json FROM {table}").fetchall()  # noqa: S608 (a name of ours)
    return {identity: json.loads(row) for identity, row in rows}
