"""Historian exports in, tables out: Parquet and CSV, a file's columns and nothing about the order of time.

A file is looked at once (`inspect`: format, layout, clock, bounds) and then read in batches (`read`), so that
memory does not grow with history. Nothing is resampled; what cannot be read is counted in a `Tally`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from .clock import Clock
from .columns import clock_of, sparse_of
from .layout import LONG, Layout

BATCH_CELLS = 1 << 20
"""Values decoded at a time: 8 MB, so that a batch stays in the cache between reading and detection."""
MOST_COLUMNS = 100_000
MOST_LINE_BYTES = 16 << 20
"""Longest line of a CSV file; also what is read of it at a time."""
ZONED = pa.timestamp("ns", tz="UTC")
HEAD_ROWS = 65_536
"""Rows by which the clock is told."""


@dataclass(frozen=True, slots=True)
class Source:
    """A file that can be read, and how."""

    path: Path
    name: str
    """As it is called in messages and in ``audit.json``."""
    size: int
    mtime_ns: int
    format: str
    """``parquet`` or ``csv``."""
    layout: Layout
    clock: Clock
    rows: int | None = None
    """Rows of the file, where its metadata say so."""
    headings: tuple[str, ...] = ()
    delimiter: str = ","
    encoding: str = "utf8"
    sparse: frozenset[str] = frozenset()
    """Headings of set points and outputs that are written only where they change."""

    @property
    def comma(self) -> bool:
        """Whether decimal commas may occur."""
        return self.format == "csv" and self.delimiter != ","

    @property
    def loops(self) -> list[str]:
        """Names of the loops that the headings tell; none for a long file (see `scan`)."""
        return [] if self.layout.kind == LONG else list(self.layout.columns)

    def line(self, row: int) -> int:
        """Where a user finds row ``row`` (from 0): the line of a CSV file, the running number otherwise."""
        return row + 2 if self.format == "csv" else row + 1


def with_head(source: Source, first: Any, unit: str | None) -> Source:
    """Tell by the first rows how the file tells time, and what it writes only on change."""
    times = (
        None if first is None else first.column(first.schema.get_field_index(source.layout.time))[:HEAD_ROWS]
    )
    clock = clock_of(times, unit, ZONED, comma=source.comma)
    return replace(source, clock=clock, sparse=sparse_of(first, source.layout))


# ---------------------------------------------------------------------------------------------------
# any format


def headings_of(layout: Layout, wanted: Collection[str] | None) -> list[str]:
    """Headings to read for these loops (None: all)."""
    out = [layout.time, *([layout.loop] if layout.kind == LONG else [])]
    for name, roles in layout.columns.items():
        if layout.kind == LONG or wanted is None or name in wanted:
            out += roles.values()
    return out
