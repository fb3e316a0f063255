"""A store that does not wait for the disk: what survives a power cut is not what is tested."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from monitor.adapters.store import Store

Kind = TypeVar("Kind", bound=Store)


def quick(folder: Path, kind: type[Kind] = Store) -> Kind:  # type: ignore[assignment]
    """Open a store whose transactions are done when the system has them."""
    store = kind(folder)
    store._db.execute("PRAGMA synchronous=OFF")
    return store
