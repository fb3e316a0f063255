"""Historian exports in, tables out: Parquet and CSV, a file's columns and nothing about the order of time.

A file is looked at once (`inspect`: format, layout, clock, bounds) and then read in batches (`read`), so that
memory does not grow with history. Nothing is resampled; what cannot be read is counted in a `Tally`.
"""

from __future__ import annotations

import codecs
import csv
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from .cells import codes_of
from .clock import Clock
from .columns import Taker, clock_of, sparse_of
from .layout import LONG, TIME, Layout, layout_of, normal_name
from .rows import MOST_LINES, Rows, Tally, UnusableError

CELLS = 1 << 20
"""Values decoded at a time: 8 MB, so that a batch stays in the cache between reading and detection."""
MOST_COLUMNS = 100_000
MOST_LINE_BYTES = 16 << 20
"""Longest line of a CSV file; also what is read of it at a time."""
BLOCK_BYTES = 1 << 20
BUFFER_BYTES = 64 << 20
"""Read ahead of a Parquet file, over all columns."""
FREE_BYTES = 256 << 20
"""Decoded size up to which the ratio to the file's size does not matter."""
MOST_RATIO = 1000
"""Decoded size over file size. Idle loops of a fleet come to 40; a file made to do harm has thousands."""
MOST_CHUNK_BYTES = 2 << 30
"""Decoded size of one column in one row group, as the file declares it."""
_ZONED = pa.timestamp("ns", tz="UTC")
_HEAD = 65_536
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


def inspect(path: Path, name: str = "", names: Collection[str] = (), unit: str | None = None) -> Source:
    """Look at a file without reading it: format, layout, clock; check all bounds.

    Parameters
    ----------
    name
        What to call it; default: its path.
    names
        Names of the loop table.
    unit
        Unit of numeric times, where the user names it.

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
        return look(path, name, names, unit, stat)
    except (ValueError, OSError, NotImplementedError, pa.ArrowException, csv.Error) as error:
        raise _unusable(name, error) from None


def headings(path: Path) -> tuple[str, ...]:
    """Return a file's headings; none where it cannot be read."""
    try:
        return (
            tuple(_open_parquet(path).schema_arrow.names) if path.suffix == ".parquet" else _csv_head(path)[0]
        )
    except (ValueError, OSError, csv.Error, pa.ArrowException):
        return ()


def _unusable(name: str, error: BaseException) -> UnusableError:
    if isinstance(error, UnusableError):
        return error
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    line = " ".join(reason.split())[:300]
    if "straddling" in line:
        line = f"a line of more than {MOST_LINE_BYTES >> 20} MB, or a quote that is never closed"
    elif "invalid UTF8" in line:
        line = "neither UTF-8 nor, from its start, another encoding; save it as UTF-8"
    return UnusableError(name, line or type(error).__name__)


def _with_head(source: Source, first: Any, unit: str | None) -> Source:
    """Tell by the first rows how the file tells time, and what it writes only on change."""
    times = None if first is None else first.column(first.schema.get_field_index(source.layout.time))[:_HEAD]
    clock = clock_of(times, unit, _ZONED, comma=source.comma)
    return replace(source, clock=clock, sparse=sparse_of(first, source.layout))


# ---------------------------------------------------------------------------------------------------
# Parquet


def _open_parquet(path: Path, loop: str = "", columns: int = 1) -> Any:
    """Open a file to be read column by column in pieces; to buffer ahead would hold all of it in memory."""
    piece = max(4096, BUFFER_BYTES // columns)
    return pq.ParquetFile(path, read_dictionary=[loop] if loop else None, pre_buffer=False, buffer_size=piece)


def _inspect_parquet(path: Path, name: str, names: Collection[str], unit: str | None, stat: Any) -> Source:
    file = _open_parquet(path)
    meta = file.metadata
    if meta.num_columns > MOST_COLUMNS:
        raise ValueError(f"{meta.num_columns} columns, expected at most {MOST_COLUMNS}")
    layout = layout_of(file.schema_arrow.names, path, names)
    _bound(meta, layout, stat.st_size)
    source = Source(
        path, name, stat.st_size, stat.st_mtime_ns, "parquet", layout, Clock("text"), meta.num_rows
    )
    wanted = _headings(layout, None)
    first = next(file.iter_batches(max(64, min(CELLS // len(wanted), _HEAD)), columns=wanted), None)
    return _with_head(source, first, unit)


def _bound(meta: Any, layout: Layout, size: int) -> None:
    """Refuse before anything is decoded what would decode to too much.

    Raises
    ------
    ValueError
        The rows times their width, or a column of a row group, exceed the bounds.
    """
    wanted = _headings(layout, None)
    decoded = meta.num_rows * 8 * len(wanted)
    if decoded > max(FREE_BYTES, MOST_RATIO * size):
        raise ValueError(
            f"{meta.num_rows} rows decode to {decoded / 1e6:.0f} MB, {decoded / size:.0f} times the file; "
            f"expected at most {MOST_RATIO} times"
        )
    for g in range(meta.num_row_groups):
        group = meta.row_group(g)
        for c in range(group.num_columns):
            column = group.column(c)
            if column.path_in_schema in wanted and column.total_uncompressed_size > MOST_CHUNK_BYTES:
                raise ValueError(f"column {column.path_in_schema!r} decodes to more than 2 GB a row group")


def _parquet_batches(
    source: Source, headings: list[str], groups: Collection[int] | None
) -> Iterator[tuple[int, Any]]:
    loop = source.layout.loop if source.layout.kind == LONG else ""
    file = _open_parquet(source.path, loop, len(headings))
    size = max(64, min(CELLS // len(headings), 1 << 18))
    row = 0
    for g in range(file.num_row_groups):
        n = file.metadata.row_group(g).num_rows
        if groups is None or g in groups:
            at = row
            for batch in file.iter_batches(size, row_groups=[g], columns=headings):
                yield at, batch
                at += len(batch)
        row += n


# ---------------------------------------------------------------------------------------------------
# CSV


def _inspect_csv(path: Path, name: str, names: Collection[str], unit: str | None, stat: Any) -> Source:
    found, delimiter, encoding = _csv_head(path)
    if "name" in found and not set(TIME) & {h.lower() for h in found}:
        raise ValueError("a loop table, not data")
    layout = layout_of(found, path, names)
    source = Source(
        path, name, stat.st_size, stat.st_mtime_ns, "csv", layout, Clock("text"),
        headings=found, delimiter=delimiter, encoding=encoding,
    )  # fmt: skip
    first = next(_csv_batches(source, _headings(layout, None), lambda _: "skip"), None)
    return _with_head(source, None if first is None else first[1], unit)


def _csv_head(path: Path) -> tuple[tuple[str, ...], str, str]:
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
        raise ValueError(f"a line of more than {MOST_LINE_BYTES >> 20} MB")
    line = line.rstrip("\r")
    delimiter = max(",;\t", key=line.count)
    if line.count(delimiter) >= MOST_COLUMNS:
        raise ValueError(f"{line.count(delimiter) + 1} columns, expected at most {MOST_COLUMNS}")
    return tuple(h.strip() for h in next(csv.reader([line], delimiter=delimiter), [])), delimiter, encoding


def _encoding(head: bytes) -> str:
    """UTF-16 by its mark; UTF-8; else one byte a character, as older historians write."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf8")().decode(head)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf8"


def _csv_batches(
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
            column_names=ids, skip_rows=1, use_threads=threads, block_size=block, encoding=source.encoding
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


def _bad_lines(source: Source, tally: Tally) -> None:
    """Find the numbers of lines with too few or too many cells (a second pass, only where there are any)."""
    lines: dict[int, str] = {}

    def note(row: Any) -> str:
        if len(lines) < MOST_LINES:
            lines[row.number] = f"{row.actual_columns} cells, expected {row.expected_columns}"
        return "skip"

    for _ in _csv_batches(source, [source.layout.time], note, threads=False):
        if len(lines) >= MOST_LINES:
            break
    tally.lines[source.name] = lines


FORMATS: dict[str, Callable[..., Source]] = {".parquet": _inspect_parquet, ".csv": _inspect_csv}


# ---------------------------------------------------------------------------------------------------
# any format


def _headings(layout: Layout, wanted: Collection[str] | None) -> list[str]:
    """Headings to read for these loops (None: all)."""
    out = [layout.time, *([layout.loop] if layout.kind == LONG else [])]
    for name, roles in layout.columns.items():
        if layout.kind == LONG or wanted is None or name in wanted:
            out += roles.values()
    return out


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
            tally.name(name)
        return
    headings = _headings(layout, wanted)
    lost = 0

    def lose(_: Any) -> str:
        nonlocal lost
        lost += 1
        return "skip"

    try:
        batches = (
            _parquet_batches(source, headings, groups)
            if source.format == "parquet"
            else _csv_batches(source, headings, lose)
        )
        take = Taker(
            source.layout,
            source.clock,
            wanted,
            tally,
            _ZONED,
            comma=source.comma,
            sparse=source.sparse,
        )
        for row, batch in batches:
            tally.file_rows[source.name] = row + len(batch)
            yield from take(row, batch)
        if lost:
            tally.lost_lines[source.name] = lost
            _bad_lines(source, tally)
    except (ValueError, OSError, NotImplementedError, pa.ArrowException) as error:
        raise _unusable(source.name, error) from None


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
        if source.format == "csv":
            out.append(_count(batch.column(0) for _, batch in _csv_batches(source, [loop], lambda _: "skip")))
        else:
            file = _open_parquet(source.path, loop)
            out += (
                _count(file.read_row_group(g, columns=[loop]).column(0).chunks)
                for g in range(file.num_row_groups)
            )
    except (ValueError, OSError, NotImplementedError, pa.ArrowException) as error:
        raise _unusable(source.name, error) from None
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


# ---------------------------------------------------------------------------------------------------
# out

_TYPES = {
    "float": pa.float64(),
    "int": pa.int64(),
    "str": pa.string(),
    "list": pa.list_(pa.string()),
    "time": _ZONED,
}


def write_parquet(path: Path, columns: Mapping[str, tuple[str, Sequence[Any]]]) -> None:
    """Write a table; the same columns give the same bytes.

    Parameters
    ----------
    columns
        Heading to (kind, values); kinds: ``float``, ``int``, ``str``, ``list`` (of texts), ``time``
        [ns since 1970]; None = empty.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    schema = pa.schema([(name, _TYPES[kind]) for name, (kind, _) in columns.items()])
    arrays = [pa.array(list(values), type=_TYPES[kind]) for kind, values in columns.values()]
    part = path.with_name(path.name + ".part")
    pq.write_table(pa.table(arrays, schema=schema), part, compression="zstd")
    part.replace(path)
