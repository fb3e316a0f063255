"""Workbooks (xlsx): a table in one of their sheets, as columns."""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
from python_calamine import CalamineError, CalamineWorkbook

from .mapping import NO_MAPPING, ExportMapping
from .recognised import recognised, unread
from .source import Source
from .table_head import MOST_HEAD_CELLS, MOST_HEAD_ROWS, comma_of, table_head

MOST_CELLS = 50_000_000
"""Cells of a sheet: a workbook is read whole (2 GB)."""


def inspect_excel(
    path: Path,
    name: str,
    names: Collection[str],
    unit: str | None,
    stat: Any,
    given: ExportMapping = NO_MAPPING,
) -> Source:
    """Look at a workbook: the first sheet that is an export; as `reader.inspect`."""
    wrong: ValueError | None = None
    book = _open(path)
    for sheet in book.sheet_names:
        rows = _rows(book, sheet)
        if not rows:
            continue
        try:
            source = replace(unread(path, name, stat, given), format="excel", sheet=sheet)
            return _sheet(source, rows, names, unit, given)
        except ValueError as error:
            wrong = wrong or ValueError(f"sheet {sheet!r}: {error}")
    raise wrong or ValueError("no rows in any sheet")


def _sheet(
    source: Source,
    rows: Sequence[Sequence[Any]],
    names: Collection[str],
    unit: str | None,
    given: ExportMapping,
) -> Source:
    n = max(20, min(MOST_HEAD_ROWS, MOST_HEAD_CELLS // max(1, len(rows[0]))))
    head = table_head([[_text(cell) for cell in row] for row in rows[:n]], given.head)
    source = replace(
        source,
        rows=len(rows) - head.data,
        headings=head.headings,
        skip=head.data,
        decimal=given.decimal or ("," if comma_of(head, ";") else ""),
    )

    def batches(headings: list[str]) -> Iterator[Any]:
        yield _batch(source, rows, headings)

    return recognised(source, head.kinds, head.by_heading, batches, names, unit, given)


def excel_batches(source: Source, headings: list[str]) -> Iterator[tuple[int, Any]]:
    """Read columns of a sheet: (0, batch)."""
    yield 0, _batch(source, _rows(_open(source.path), source.sheet), headings)


def _open(path: Path) -> Any:
    try:
        return CalamineWorkbook.from_path(str(path))
    except CalamineError as error:
        raise ValueError(f"no workbook: {error}") from None


def _rows(book: Any, sheet: str) -> list[list[Any]]:
    found = book.get_sheet_by_name(sheet)
    if found.total_height * found.total_width > MOST_CELLS:
        raise ValueError(f"sheet {sheet!r}: more than {MOST_CELLS} cells; export it as CSV or Parquet")
    rows: list[list[Any]] = found.to_python(skip_empty_area=False)
    return rows


def _batch(source: Source, rows: Sequence[Sequence[Any]], headings: list[str]) -> Any:
    place = {h: k for k, h in reversed(list(enumerate(source.headings)))}
    body = [row for row in rows[source.skip :] if any(cell != "" for cell in row)]
    arrays = [_array([row[place[h]] if place[h] < len(row) else "" for row in body]) for h in headings]
    return pa.RecordBatch.from_arrays(arrays, names=headings)


def _array(cells: list[Any]) -> Any:
    """Make a column of one type: times, numbers, or text."""
    filled = [cell for cell in cells if cell != ""]
    if filled and all(isinstance(cell, dt.datetime) for cell in filled):
        # a spreadsheet's double holds today to a microsecond, and shows milliseconds: round to those
        ms = [None if cell == "" else _ms(cell) for cell in cells]
        return pa.array(ms, pa.int64()).cast(pa.timestamp("ms"))
    if filled and all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in filled):
        return pa.array([None if cell == "" else float(cell) for cell in cells], pa.float64())
    return pa.array([None if cell == "" else _text(cell) for cell in cells], pa.string())


def _ms(cell: dt.datetime) -> int:
    since = cell - dt.datetime(1970, 1, 1)  # noqa: DTZ001 (a cell has no zone)
    return round(since / dt.timedelta(milliseconds=1))


def _text(cell: Any) -> str:
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15:
        return str(int(cell))
    if isinstance(cell, dt.datetime):
        return cell.isoformat(" ")
    return str(cell)
