"""What a reader hands on: a batch of rows as they stood in the file, and what was counted on the way."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.samples import Picked

MOST_NAMES = 100_000
"""Names of loops outside the table that are remembered."""
MOST_KEPT_LINES = 50
"""Lines that could not be read of which number and cause are remembered, per file."""
MOST_TEXT_CHARACTERS = 40
"""Characters of such a text that are kept."""
MOST_TEXTS = 10_000
"""Different texts in place of values that are told apart."""


HOLD_SP, HOLD_OP = 1, 2


class UnusableError(ValueError):
    """A file that cannot be used, in one line; ``line`` is 1-based where known."""

    def __init__(self, name: str, reason: str, line: int | None = None) -> None:
        where = name if line is None else f"{name}:{line}"
        super().__init__(f"{where}: {reason}")
        self.name, self.reason, self.line = name, reason, line

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel between processes with all arguments."""
        return UnusableError, (self.name, self.reason, self.line)


@dataclass(eq=False, slots=True)
class Rows:
    """N rows of a file, in the file's order; times may repeat and go back."""

    loop: NDArray[np.int32]
    """(N,) code of the loop among those asked for."""
    time: NDArray[np.int64]
    """(N,) [ns] since 1970, UTC or, for a zone still to be applied, local."""
    sp: NDArray[np.float64]
    pv: NDArray[np.float64]
    op: NDArray[np.float64]
    auto: NDArray[np.int8]
    """(N,) 1 automatic, 0 manual, -1 unknown."""
    quality: NDArray[np.uint8]
    hold: NDArray[np.uint8]
    """(N,) 1: the set point, 2: OP, 3: both were not written again; the loop's last value holds."""
    row: int = 0
    """Number of the batch's first row in its file."""

    def __len__(self) -> int:
        return len(self.time)

    def take(self, rows: Picked) -> Rows:
        """Return these rows (index array, mask or slice)."""
        return Rows(**{name: getattr(self, name)[rows] for name in ROW_COLUMNS}, row=self.row)


ROW_COLUMNS = tuple(f.name for f in fields(Rows) if f.name != "row")


def join_rows(parts: list[Rows]) -> Rows:
    """Put batches one behind the other."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(p, name) for p in parts]) for name in ROW_COLUMNS
    }
    return Rows(**columns, row=parts[0].row)


@dataclass(slots=True)
class Tally:
    """What was read, and what was left out. Adds up over tasks: ``rows`` are those of the loops asked for."""

    rows: int = 0
    bad_time: int = 0
    """Rows without a usable time."""
    outside: int = 0
    """Rows before ``since`` or from ``until`` on."""
    duplicate: int = 0
    """Rows at a time that the loop has already had; the first is kept."""
    conflict: int = 0
    """Duplicates whose values differ from those kept."""
    bad_texts: int = 0
    """Values that were text."""
    texts: dict[str, int] = field(default_factory=dict)
    """The texts, as they stood there."""
    qualities: dict[str, int] = field(default_factory=dict)
    """Qualities that are not good, as they stood there."""
    times: set[str] = field(default_factory=set)
    """What stood in place of a time."""
    loop_rows: dict[str, int] = field(default_factory=dict)
    """Rows of each loop."""
    unknown: set[str] = field(default_factory=set)
    """Names in the data that were not asked for."""
    lines: dict[str, dict[int, str]] = field(default_factory=dict)
    """Lines that could not be read, by file: number and reason."""
    lost_lines: dict[str, int] = field(default_factory=dict)
    """How many of them, by file."""
    file_rows: dict[str, int] = field(default_factory=dict)
    """Rows read of each file, whosever they are."""

    def count_text(self, value: str, times: int) -> None:
        """Count a text that stood in place of a value; the number of different ones is bounded."""
        self.bad_texts += times
        _bounded(self.texts, value, times)

    def count_quality(self, value: str, times: int) -> None:
        """Count a quality that is not good."""
        _bounded(self.qualities, value, times)

    def note_bad_time(self, value: object) -> None:
        """Remember what stood in place of a time."""
        if len(self.times) < MOST_TEXTS:
            self.times.add(str(value)[:MOST_TEXT_CHARACTERS])

    def note_unknown_loop(self, name: str) -> None:
        """Remember a loop that was not asked for."""
        if len(self.unknown) < MOST_NAMES:
            self.unknown.add(name[:200])

    def add(self, other: Tally) -> None:
        """Take in another task's tally; several tasks may have read the same lines of a file."""
        for name in ("rows", "bad_time", "outside", "duplicate", "conflict", "bad_texts"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for counts, more in (
            (self.loop_rows, other.loop_rows),
            (self.texts, other.texts),
            (self.qualities, other.qualities),
        ):
            for key, n in more.items():
                counts[key] = counts.get(key, 0) + n
        self.unknown |= other.unknown
        self.times |= other.times
        for file, lines in other.lines.items():
            self.lines.setdefault(file, {}).update(lines)
        for most, more in ((self.lost_lines, other.lost_lines), (self.file_rows, other.file_rows)):
            for key, n in more.items():
                most[key] = max(n, most.get(key, 0))


def _bounded(counts: dict[str, int], text: str, times: int) -> None:
    text = text[:MOST_TEXT_CHARACTERS]
    if text in counts or len(counts) < MOST_TEXTS:
        counts[text] = counts.get(text, 0) + times
