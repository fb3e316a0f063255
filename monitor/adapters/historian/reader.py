"""A file of any format, looked at once and then read in batches."""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from monitor.contract.entries import MODE_UNKNOWN

from .cells import codes_of
from .columns import Meanings, Taker
from .csv_files import bad_lines, csv_batches, csv_head, inspect_csv
from .excel_files import excel_batches, inspect_excel
from .layout import LONG, normal_name
from .mapping import NO_MAPPING, ExportMapping
from .parquet import inspect_parquet, open_parquet, parquet_batches
from .rows import Rows, Tally, UnusableError
from .source import MOST_LINE_BYTES, ZONED, Source, headings_of


def inspect(
    path: Path,
    name: str = "",
    names: Collection[str] = (),
    unit: str | None = None,
    given: ExportMapping = NO_MAPPING,
) -> Source:
    """Look at a file without reading it: format, layout, clock; check all bounds.

    Parameters
    ----------
    name
        What to call it; default: its path.
    names
        Names of the loop table.
    unit
        Unit of numeric times, where the user names it.
    given
        What the user says of the file.

    Raises
    ------
    UnusableError
        In one line, why the file cannot be used.
    """
    name = name or str(path)
    try:
        look = FORMATS[path.suffix.lower()]
    except KeyError:
        raise UnusableError(name, f"suffix {path.suffix!r}, expected {' or '.join(FORMATS)}") from None
    try:
        stat = path.stat()
        if stat.st_size == 0:
            raise UnusableError(name, "an empty file")
        return look(path, name, names, unit, stat, given)
    except (ValueError, OSError, NotImplementedError, pa.ArrowException, csv.Error) as error:
        raise unusable(name, error) from None


FOLDER_FORMATS = (".parquet", ".csv", ".tsv", ".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
"""Formats that are looked for in folders; where none is there, text files are."""


def headings(path: Path) -> tuple[str, ...]:
    """Return a file's headings; none where it cannot be read."""
    try:
        return (
            tuple(open_parquet(path).schema_arrow.names) if path.suffix == ".parquet" else csv_head(path)[0]
        )
    except (ValueError, OSError, csv.Error, pa.ArrowException):
        return ()


def unusable(name: str, error: BaseException) -> UnusableError:
    """Return in one line why a file cannot be used."""
    if isinstance(error, UnusableError):
        return error
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    line = " ".join(reason.split())[:300]
    if "straddling" in line:
        line = f"a line of more than {MOST_LINE_BYTES >> 20} MB, or a quote that is never closed"
    elif "invalid UTF8" in line:
        line = "neither UTF-8 nor, from its start, another encoding; save it as UTF-8"
    return UnusableError(name, line or type(error).__name__)


FORMATS: dict[str, Callable[..., Source]] = {
    ".parquet": inspect_parquet,
    ".csv": inspect_csv,
    ".txt": inspect_csv,
    ".tsv": inspect_csv,
    **dict.fromkeys((".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), inspect_excel),
}


def read(
    source: Source, wanted: Mapping[str, int], tally: Tally, groups: Collection[int] | None = None
) -> Iterator[Rows]:
    """Read a file's rows of the loops asked for, in the file's order.

    Parameters
    ----------
    wanted
        Loop name to its code in `Rows.loop`.
    tally
        Counts rows, bad times, texts, lines that could not be read, and loops not asked for.
    groups
        Row groups of a Parquet file to read; default: all.

    Raises
    ------
    UnusableError
        The file turned out to be damaged, or its times contradict its beginning.
    """
    layout = source.layout
    if layout.kind != LONG and not any(name in wanted for name in layout.columns):
        for name in layout.columns:
            tally.note_unknown_loop(name)
        return
    try:
        take = Taker(
            source.layout,
            source.clock,
            wanted,
            tally,
            ZONED,
            comma=source.comma,
            sparse=source.sparse,
            meanings=Meanings(
                dict(source.modes), 0 if source.recognised else MODE_UNKNOWN, source.quality_scale
            ),
        )
        for row, batch in counted_batches(source, headings_of(layout, wanted), tally, groups):
            yield from take(row, batch)
        if source.name in tally.lost_lines:
            bad_lines(source, tally)
    except (ValueError, OSError, NotImplementedError, pa.ArrowException) as error:
        raise unusable(source.name, error) from None


def counted_batches(
    source: Source, headings: list[str], tally: Tally, groups: Collection[int] | None = None
) -> Iterator[tuple[int, Any]]:
    """Read columns of a file of any format: (first row, batch); count rows, and lines that could not be read."""
    lost = 0

    def lose(_: Any) -> str:
        nonlocal lost
        lost += 1
        return "skip"

    for row, batch in batches_of(source, headings, lose, groups):
        tally.file_rows[source.name] = row + len(batch)
        yield row, batch
    if lost:
        tally.lost_lines[source.name] = lost


def batches_of(
    source: Source,
    headings: list[str],
    on_bad_line: Callable[[Any], str] = lambda _: "skip",
    groups: Collection[int] | None = None,
) -> Iterator[tuple[int, Any]]:
    """Read columns of a file of any format: (first row, batch)."""
    if source.format == "parquet":
        return parquet_batches(source, headings, groups)
    if source.format == "excel":
        return excel_batches(source, headings)
    return csv_batches(source, headings, on_bad_line)


def scan(source: Source) -> list[dict[str, int]]:
    """Return the names in a long file, and their rows, for each of its row groups (a CSV file is one).

    Raises
    ------
    UnusableError
        The file turned out to be damaged.
    """
    loop = source.layout.loop
    out: list[dict[str, int]] = []
    try:
        if source.format != "parquet":
            out.append(_count(batch.column(0) for _, batch in batches_of(source, [loop])))
        else:
            file = open_parquet(source.path, loop)
            out += (
                _count(file.read_row_group(g, columns=[loop]).column(0).chunks)
                for g in range(file.num_row_groups)
            )
    except (ValueError, OSError, NotImplementedError, pa.ArrowException) as error:
        raise unusable(source.name, error) from None
    return out


def _count(arrays: Any) -> dict[str, int]:
    names: dict[str, int] = {}

    def code(name: str | None) -> int:
        return names.setdefault(normal_name(name or ""), len(names))

    total = np.zeros(0, np.int64)
    for array in arrays:
        found = np.bincount(codes_of(array, code), minlength=len(names))
        found[: len(total)] += total
        total = found
    return {name: int(n) for name, n in zip(names, total, strict=True) if n}
