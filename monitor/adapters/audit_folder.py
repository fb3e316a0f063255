"""An audit's folder, read: its tables of loops, events and spells, and what it says of itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from monitor.contract.records import Assessment, LoopRow, Spell

from .tables import EVENTS_FILE, LOOPS_FILE, SPELLS_FILE, missing_columns, read_records

ABOUT_FILE = "audit.json"


@dataclass(frozen=True, slots=True)
class AuditFolder:
    """What an audit has written, as records."""

    path: Path
    about: dict[str, Any]
    """``audit.json``."""
    rows: list[LoopRow]
    """Worst first."""
    events: list[Assessment]
    spells: list[Spell]
    """Empty where an earlier version has written no such table."""
    lacks: tuple[str, ...]
    """Columns that its tables of loops and events do not have yet, and files."""


def read_audit(path: Path) -> AuditFolder:
    """Read an audit's folder; what an earlier version did not write stays empty, and is named in ``lacks``.

    Raises
    ------
    OSError
        A file cannot be read.
    ValueError
        The folder holds no audit: one line that says what is missing.
    """
    for name in (LOOPS_FILE, EVENTS_FILE, ABOUT_FILE):
        if not (path / name).is_file():
            raise ValueError(f"{path}: no {name}, expected the folder of an audit (--out)")
    try:
        about = msgspec.json.decode((path / ABOUT_FILE).read_bytes(), type=dict[str, Any])
    except msgspec.MsgspecError as error:
        raise ValueError(f"{path / ABOUT_FILE}: not what an audit says of itself: {error}") from None
    rows = read_records(path / LOOPS_FILE, LoopRow)
    events = read_records(path / EVENTS_FILE, Assessment)
    lacks = [
        *missing_columns(path / LOOPS_FILE, LoopRow),
        *missing_columns(path / EVENTS_FILE, Assessment),
    ]
    spells: list[Spell] = []
    if (path / SPELLS_FILE).is_file():
        spells = read_records(path / SPELLS_FILE, Spell)
    else:
        lacks.append(SPELLS_FILE)
    return AuditFolder(path, about, rows, events, spells, tuple(lacks))
