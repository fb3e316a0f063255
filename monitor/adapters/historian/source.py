"""Historian exports in, tables out: Parquet and CSV, a file's columns and nothing about the order of time.

A file is looked at once (`inspect`: format, layout, clock, bounds) and then read in batches (`read`), so that
memory does not grow with history. Nothing is resampled; what cannot be read is counted in a `Tally`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from .cells import plain
from .clock import Clock
from .columns import clock_of, clock_of_texts, sparse_of, times_of
from .layout import LONG, TAGS, TALL, Layout
from .time_formats import order_of_dates, order_of_format

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
    """``parquet``, ``csv`` or ``excel``."""
    layout: Layout
    clock: Clock
    rows: int | None = None
    """Rows of the file, where its metadata say so."""
    headings: tuple[str, ...] = ()
    delimiter: str = ","
    encoding: str = "utf8"
    sparse: frozenset[str] = frozenset()
    """Headings of set points and outputs that are written only where they change."""
    skip: int = 1
    """Rows above the data: titles, headings, units."""
    decimal: str = ""
    """``,`` or ``.`` where the data, or the user, say which."""
    sheet: str = ""
    """Of a workbook."""
    modes: tuple[tuple[str, int], ...] = ()
    """What the user says of texts of modes, lower case: 1 automatic, 0 not."""
    quality_scale: str = ""
    """Of qualities that are numbers, where it is another than OPC's: a name of `QUALITY_SCALES`."""
    recognised: bool = False
    """Whether the file is of another layout than those of the documentation, and was recognised by what is in it."""

    @property
    def comma(self) -> bool:
        """Whether decimal commas may occur."""
        return self.decimal == "," if self.decimal else self.format == "csv" and self.delimiter != ","

    @property
    def loops(self) -> list[str]:
        """Names of the loops that the headings tell; none for a long file (see `scan`)."""
        return [] if self.layout.kind == LONG else list(self.layout.columns)

    def line(self, row: int) -> int:
        """Where a user finds row ``row`` (from 0): the line of a CSV file, the running number otherwise."""
        return row + 1 if self.format == "parquet" else row + 1 + self.skip


def with_head(source: Source, first: Any, unit: str | None) -> Source:
    """Tell by the first rows how the file tells time, and what it writes only on change."""
    times = None if first is None else first.column(source.layout.time)[:HEAD_ROWS]
    clock = clock_of(times, unit, ZONED, comma=source.comma)
    return replace(source, clock=clock, sparse=sparse_of(first, source.layout))


def with_clock(
    source: Source, batches: Callable[[list[str]], Iterable[Any]], unit: str | None, time_format: str
) -> Source:
    """Tell how a recognised file tells time, by all of it where its beginning does not say.

    Parameters
    ----------
    batches
        Reads these columns of the whole file, in batches.
    unit
        Of numeric times, where the user names it.
    time_format
        Of times as text, where the user names it.

    Raises
    ------
    ValueError
        They are no times, or may be read in two ways.
    """
    layout = source.layout
    columns = [layout.time, *([layout.clock] if layout.clock else [])]
    first = next(iter(batches(headings_of(layout, None))), None)
    if first is None or not len(first):
        raise ValueError("no rows")
    head = times_of(first, layout)[:HEAD_ROWS]
    order = order_of_format(time_format) if time_format else ""
    clock = clock_of_texts(head, unit, ZONED, order, comma=source.comma)
    if clock is None:
        texts = (plain(times_of(batch, layout)) for batch in batches(columns))
        order = order or order_of_dates(texts)
        clock = clock_of_texts(head, unit, ZONED, order, comma=source.comma, decided=True)
    if clock is None:
        raise ValueError("no column of times")
    sparse = frozenset() if layout.joins else sparse_of(first, layout)
    return replace(source, clock=clock, sparse=sparse)


# ---------------------------------------------------------------------------------------------------
# any format


def headings_of(layout: Layout, wanted: Collection[str] | None) -> list[str]:
    """Headings to read for these loops (None: all)."""
    out = [
        layout.time,
        *([layout.clock] if layout.clock else []),
        *([layout.loop] if layout.kind == LONG else []),
    ]
    if layout.kind == TALL:
        return [*out, *layout.tags, layout.value, *([layout.quality] if layout.quality else [])]
    if layout.kind == TAGS and layout.quality:
        out.append(layout.quality)
    for name, roles in layout.columns.items():
        if layout.kind == LONG or wanted is None or name in wanted:
            out += roles.values()
            out += (
                layout.times[h] for h in roles.values() if layout.times.get(h, layout.time) != layout.time
            )
    return out
