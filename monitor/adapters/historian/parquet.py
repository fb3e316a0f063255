"""Parquet exports: bounds, and batches of columns."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from .cell_kinds import NUMBER, decimal_comma
from .cells import is_text, plain
from .clock import Clock
from .layout import LONG, BoundsError, Layout, layout_of
from .mapping import NO_MAPPING, ExportMapping
from .recognised import documented_or_recognised, recognised, texts_of, unread
from .source import BATCH_CELLS, HEAD_ROWS, MOST_COLUMNS, Source, headings_of, with_head
from .table_head import MOST_HEAD_ROWS

BUFFER_BYTES = 64 << 20
"""Read ahead of a Parquet file, over all columns."""
FREE_BYTES = 256 << 20
"""Decoded size up to which the ratio to the file's size does not matter."""
MOST_RATIO = 1000
"""Decoded size over file size. Idle loops of a fleet come to 40; a file made to do harm has thousands."""
MOST_CHUNK_BYTES = 2 << 30
"""Decoded size of one column in one row group, as the file declares it."""


# ---------------------------------------------------------------------------------------------------
# Parquet


def open_parquet(path: Path, loop: str = "", columns: int = 1) -> Any:
    """Open a file to be read column by column in pieces; to buffer ahead would hold all of it in memory."""
    piece = max(4096, BUFFER_BYTES // columns)
    return pq.ParquetFile(path, read_dictionary=[loop] if loop else None, pre_buffer=False, buffer_size=piece)


def inspect_parquet(
    path: Path,
    name: str,
    names: Collection[str],
    unit: str | None,
    stat: Any,
    given: ExportMapping = NO_MAPPING,
) -> Source:
    """Look at a Parquet file: bounds, layout, clock; as `reader.inspect`."""
    return documented_or_recognised(
        lambda: _documented(path, name, names, unit, stat),
        lambda: _by_content(path, name, names, unit, stat, given),
        given,
    )


def _opened(path: Path) -> tuple[Any, Any]:
    """Open a file and return it with its metadata; refuse what has too many columns."""
    file = open_parquet(path)
    if file.metadata.num_columns > MOST_COLUMNS:
        raise BoundsError(f"{file.metadata.num_columns} columns, expected at most {MOST_COLUMNS}")
    return file, file.metadata


def _by_content(
    path: Path, name: str, names: Collection[str], unit: str | None, stat: Any, given: ExportMapping
) -> Source:
    file, meta = _opened(path)
    headings = tuple(file.schema_arrow.names)
    source = replace(unread(path, name, stat, given), format="parquet", rows=meta.num_rows, headings=headings)
    first = next(open_parquet(path, columns=len(headings)).iter_batches(MOST_HEAD_ROWS), None)
    if first is None:
        raise ValueError("no rows")
    cells, kinds = texts_of(first)
    commas = [
        decimal_comma(cells[h]) for h in headings if kinds[h] == NUMBER and is_text(plain(first.column(h)))
    ]
    source = replace(source, decimal=given.decimal or ("," if True in commas else ""))

    def batches(columns: list[str]) -> Iterator[Any]:
        return (batch for _, batch in parquet_batches(source, columns, None))

    found = recognised(source, kinds, cells, batches, names, unit, given)
    _bound(meta, found.layout, stat.st_size)
    return found


def _documented(path: Path, name: str, names: Collection[str], unit: str | None, stat: Any) -> Source:
    file, meta = _opened(path)
    layout = layout_of(file.schema_arrow.names, path, names)
    _bound(meta, layout, stat.st_size)
    source = Source(
        path, name, stat.st_size, stat.st_mtime_ns, "parquet", layout, Clock("text"), meta.num_rows,
        headings=tuple(file.schema_arrow.names),
    )  # fmt: skip
    wanted = headings_of(layout, None)
    first = next(file.iter_batches(max(64, min(BATCH_CELLS // len(wanted), HEAD_ROWS)), columns=wanted), None)
    return with_head(source, first, unit)


def _bound(meta: Any, layout: Layout, size: int) -> None:
    """Refuse before anything is decoded what would decode to too much.

    Raises
    ------
    ValueError
        The rows times their width, or a column of a row group, exceed the bounds.
    """
    wanted = headings_of(layout, None)
    decoded = meta.num_rows * 8 * len(wanted)
    if decoded > max(FREE_BYTES, MOST_RATIO * size):
        raise BoundsError(
            f"{meta.num_rows} rows decode to {decoded / 1e6:.0f} MB, {decoded / size:.0f} times the file; "
            f"expected at most {MOST_RATIO} times"
        )
    for g in range(meta.num_row_groups):
        group = meta.row_group(g)
        for c in range(group.num_columns):
            column = group.column(c)
            if column.path_in_schema in wanted and column.total_uncompressed_size > MOST_CHUNK_BYTES:
                raise BoundsError(f"column {column.path_in_schema!r} decodes to more than 2 GB a row group")


def parquet_batches(
    source: Source, headings: list[str], groups: Collection[int] | None
) -> Iterator[tuple[int, Any]]:
    """Read columns of these row groups (None: all): (first row, batch)."""
    loop = source.layout.loop if source.layout.kind == LONG else ""
    file = open_parquet(source.path, loop, len(headings))
    size = max(64, min(BATCH_CELLS // len(headings), 1 << 18))
    row = 0
    for g in range(file.num_row_groups):
        n = file.metadata.row_group(g).num_rows
        if groups is None or g in groups:
            at = row
            for batch in file.iter_batches(size, row_groups=[g], columns=headings):
                yield at, batch
                at += len(batch)
        row += n
