"""CSV exports: heading, delimiter, encoding, and batches of columns as text."""

from __future__ import annotations

import codecs
import csv
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv as pa_csv

from .clock import Clock
from .layout import BoundsError, LoopTableFoundError, is_loop_table, layout_of
from .mapping import NO_MAPPING, ExportMapping
from .recognised import documented_or_recognised, recognised, unread
from .rows import MOST_KEPT_LINES, Tally
from .source import MOST_COLUMNS, MOST_LINE_BYTES, Source, headings_of, with_head
from .table_head import MOST_HEAD_CELLS, MOST_HEAD_ROWS, Head, comma_of, separator_of, table_head

BLOCK_BYTES = 1 << 20


# ---------------------------------------------------------------------------------------------------
# CSV


def inspect_csv(
    path: Path,
    name: str,
    names: Collection[str],
    unit: str | None,
    stat: Any,
    given: ExportMapping = NO_MAPPING,
) -> Source:
    """Look at a CSV file: headings, layout, clock; as `reader.inspect`."""

    def documented() -> Source:
        found, delimiter, encoding = csv_head(path)
        if is_loop_table(found):
            raise LoopTableFoundError("a loop table, not data")
        layout = layout_of(found, path, names)
        source = Source(
            path, name, stat.st_size, stat.st_mtime_ns, "csv", layout, Clock("text"),
            headings=found, delimiter=delimiter, encoding=encoding,
        )  # fmt: skip
        first = next(csv_batches(source, headings_of(layout, None), lambda _: "skip"), None)
        return with_head(source, None if first is None else first[1], unit)

    def by_content() -> Source:
        source, head = _with_table(path, name, stat, given)

        def batches(headings: list[str]) -> Iterator[Any]:
            return (batch for _, batch in csv_batches(source, headings, lambda _: "skip"))

        return recognised(source, head.kinds, head.by_heading, batches, names, unit, given)

    return documented_or_recognised(documented, by_content, given)


def _with_table(path: Path, name: str, stat: Any, given: ExportMapping) -> tuple[Source, Head]:
    """Find the table in a CSV file: encoding, separator, rows above the data, decimal sign."""
    with path.open("rb") as file:
        raw = file.read(BLOCK_BYTES)
    encoding = given.encoding or _encoding(raw)
    text = (
        raw.decode(encoding, errors="replace")
        .removeprefix("\ufeff")
        .replace("\r\n", "\n")
        .replace("\r", "\n")
    )
    lines = text.split("\n")
    lines = lines[: min(len(lines) - (len(raw) == BLOCK_BYTES), MOST_HEAD_ROWS)]
    separator = given.separator or separator_of(lines)
    width = max((line.count(separator) + 1 for line in lines), default=1)
    if width > MOST_COLUMNS:
        raise BoundsError(f"{width} columns, expected at most {MOST_COLUMNS}")
    lines = lines[: max(20, min(MOST_HEAD_ROWS, MOST_HEAD_CELLS // width))]
    rows = [next(csv.reader([line], delimiter=separator), []) for line in lines]
    head = table_head(rows, given.head)
    source = replace(
        unread(path, name, stat, given),
        format="csv",
        headings=head.headings,
        delimiter=separator,
        encoding=encoding,
        skip=head.data,
        decimal=given.decimal or ("," if comma_of(head, separator) else "."),
    )
    return source, head


def csv_head(path: Path) -> tuple[tuple[str, ...], str, str]:
    """Return a CSV file's headings, delimiter and encoding.

    Raises
    ------
    ValueError
        The line of headings exceeds the bounds.
    """
    with path.open("rb") as file:
        head = file.read(BLOCK_BYTES)
        if b"\n" not in head:
            head += file.read(MOST_LINE_BYTES - BLOCK_BYTES)
    encoding = _encoding(head)
    line, newline, _ = head.decode(encoding, errors="replace").removeprefix("\ufeff").partition("\n")
    if not newline and len(head) == MOST_LINE_BYTES:
        raise BoundsError(f"a line of more than {MOST_LINE_BYTES >> 20} MB")
    line = line.rstrip("\r")
    delimiter = max(",;\t", key=line.count)
    if line.count(delimiter) >= MOST_COLUMNS:
        raise BoundsError(f"{line.count(delimiter) + 1} columns, expected at most {MOST_COLUMNS}")
    return tuple(h.strip() for h in next(csv.reader([line], delimiter=delimiter), [])), delimiter, encoding


def _encoding(head: bytes) -> str:
    """UTF-16 by its mark, or by a zero in every second byte; UTF-8; else one byte a character."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    odd, even = head[1:4096:2], head[0:4096:2]
    if len(odd) > 8 and odd.count(0) * 2 > len(odd):
        return "utf-16-le"
    if len(even) > 8 and even.count(0) * 2 > len(even):
        return "utf-16-be"
    try:
        codecs.getincrementaldecoder("utf8")().decode(head)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf8"


def csv_batches(
    source: Source,
    headings: list[str],
    on_bad_line: Callable[[Any], str],
    *,
    threads: bool = True,
) -> Iterator[tuple[int, Any]]:
    """Read columns as text; ``on_bad_line`` sees each line with another number of cells."""
    ids = [f"c{k}" for k in range(len(source.headings))]  # headings may repeat
    place = {h: k for k, h in reversed(list(enumerate(source.headings)))}
    wanted = [ids[place[h]] for h in headings]
    block = BLOCK_BYTES
    while block < min(MOST_LINE_BYTES, 64 * len(source.headings)):
        block *= 2
    reader = pa_csv.open_csv(
        source.path,
        read_options=pa_csv.ReadOptions(
            column_names=ids,
            skip_rows=source.skip,
            use_threads=threads,
            block_size=block,
            encoding=source.encoding,
        ),
        parse_options=pa_csv.ParseOptions(delimiter=source.delimiter, invalid_row_handler=on_bad_line),
        convert_options=pa_csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pa.string()), include_columns=wanted, strings_can_be_null=False
        ),
    )
    row = 0
    for batch in reader:
        yield row, batch.rename_columns(headings)
        row += len(batch)


def bad_lines(source: Source, tally: Tally) -> None:
    """Find the numbers of lines with too few or too many cells (a second pass, only where there are any)."""
    lines: dict[int, str] = {}

    def note(row: Any) -> str:
        if len(lines) < MOST_KEPT_LINES:
            lines[row.number] = f"{row.actual_columns} cells, expected {row.expected_columns}"
        return "skip"

    for _ in csv_batches(source, [source.layout.time], note, threads=False):
        if len(lines) >= MOST_KEPT_LINES:
            break
    tally.lines[source.name] = lines
