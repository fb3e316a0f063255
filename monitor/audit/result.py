"""What an audit found."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from monitor.contract.records import Assessment, LoopRow

PARTS_FOLDER = ".parts"
"""Folder in DIR for what is done of an audit that is not."""


@dataclass(slots=True)
class AuditResult:
    """What an audit found, and where it is."""

    exit_code: int
    """0 where something was audited, 2 where nothing was usable."""
    problems: list[str] = field(default_factory=list)
    """What was left out, one line each: ``file[:line]: reason``."""
    rows: list[LoopRow] = field(default_factory=list)
    """Worst first."""
    events: list[Assessment] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """How exports of other layouts than the documented ones were read, and which columns were not used."""
