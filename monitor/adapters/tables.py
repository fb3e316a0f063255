"""The audit's tables: records to the columns of ``events.parquet``, ``loops.parquet`` and ``loops.csv``."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from monitor.adapters.historian.source import ZONED
from monitor.contract.evidence import Answers, Window
from monitor.contract.records import TIMES, Assessment, LoopRow, Spell
from monitor.contract.text import inert
from monitor.contract.times import iso

from .files import replacing, write_text
from .workbook import Sheet, write_workbook

EVENTS_FILE, LOOPS_FILE, LOOPS_CSV_FILE = "events.parquet", "loops.parquet", "loops.csv"
EVIDENCE_FILE, ANSWERS_FILE, SPELLS_FILE = "evidence.parquet", "answers.parquet", "spells.parquet"
WORKBOOK_FILE = "loops.xlsx"
MOST_SHEET_EVENTS = 20_000
"""Events in the workbook, the newest: a sheet of more opens slowly, and takes longer to write than to find out."""
WHOLE_FROM = 1e6
"""From here on a number is told to the unit: a time, say."""


def write_tables(
    out: Path, events: Sequence[Assessment], loops: Sequence[LoopRow], *, seconds: bool
) -> list[Path]:
    """Write the tables of loops and events; the same records give the same bytes.

    Parameters
    ----------
    seconds
        Times as float seconds since 1970 (the input's were numbers) rather than as timestamps.

    Returns
    -------
    list of Path
        The files, in the order in which a reader wants them.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    write_parquet(out / EVENTS_FILE, columns(Assessment, events, seconds=seconds))
    write_parquet(out / LOOPS_FILE, columns(LoopRow, loops, seconds=seconds))
    write_text(out / LOOPS_CSV_FILE, loops_csv(loops))
    write_workbook(out / WORKBOOK_FILE, _sheets(events, loops))
    return [out / LOOPS_CSV_FILE, out / WORKBOOK_FILE, out / LOOPS_FILE, out / EVENTS_FILE]


def _sheets(events: Sequence[Assessment], loops: Sequence[LoopRow]) -> list[Sheet]:
    """Return the sheets of ``loops.xlsx``, for the eye: times as text, today's settings beside the new ones."""
    cells = by_eye(columns(LoopRow, loops, seconds=True))
    newest = sorted(
        sorted(events, key=lambda e: e.start)[-MOST_SHEET_EVENTS:], key=lambda e: (e.loop, e.start)
    )
    told = columns(Assessment, newest, seconds=False)
    for name in TIMES:
        told[name] = "str", [iso(time, "ms") for time in told[name][1]]
    left = len(events) - len(newest)
    note = f"the newest {len(newest)} of {len(events)} events; {EVENTS_FILE} has all" if left else ""
    return [
        Sheet("loops", {name: values for name, (_, values) in cells.items()}),
        Sheet("events", {name: values for name, (_, values) in told.items()}, note),
    ]


def by_eye(table: Mapping[str, tuple[str, list[Any]]]) -> dict[str, tuple[str, list[Any]]]:
    """Return columns in the order of a reader: today's settings beside those to be typed in."""
    moved = {name: f"new_{name}" for name in ("kp", "ti", "td", "tf", "fields")}
    order = [name for name in table if name not in moved]
    for name, new in moved.items():
        order.insert(order.index(new), name)
    return {name: table[name] for name in order}


def columns(
    record: type[Assessment | LoopRow | Spell], records: Sequence[Any], *, seconds: bool
) -> dict[str, tuple[str, list[Any]]]:
    """Turn records into columns: heading to (kind, values), in the order of the record's fields."""
    out: dict[str, tuple[str, list[Any]]] = {}
    for name, hint in get_type_hints(record).items():
        values = [getattr(r, name) for r in records]
        kind = _kind(str(hint))
        if name in TIMES:
            kind = "float" if seconds else "time"
            if seconds:
                values = [v / 1e9 for v in values]
        if kind in {"int", "time"}:
            values = [int(v) for v in values]
        elif kind == "float":
            values = [None if v is None or math.isnan(v) else v for v in values]
        out[name] = kind, values
    return out


def _kind(hint: str) -> str:
    for kind, mark in (("list", "tuple"), ("float", "float"), ("int", "int"), ("str", "str")):
        if mark in hint:
            return kind
    raise TypeError(f"a field of type {hint} has no column type")


def loops_csv(loops: Sequence[LoopRow]) -> str:
    """Return ``loops.csv``: flags joined by ``;``, an empty cell for what is not known, ``inf`` as such.

    Floats have six significant digits (``loops.parquet`` has all), today's settings stand beside the new ones.

    A text that a spreadsheet would run as a formula (it begins with = + - @ or a tab) has an apostrophe
    before it; ``loops.parquet`` holds it as it is.
    """
    return csv_text(by_eye(columns(LoopRow, loops, seconds=True)))


def csv_text(table: Mapping[str, tuple[str, Sequence[Any]]]) -> str:
    """Return columns, heading to (kind, values), as CSV for the eye: cells as `loops_csv` has them."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(table)
    for cells in zip(*(values for _, values in table.values()), strict=True):
        writer.writerow([_cell(c) for c in cells])
    return file.getvalue()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, tuple | list):
        value = ";".join(value)
    if isinstance(value, str):
        return inert(value)
    if isinstance(value, float) and abs(value) < WHOLE_FROM:
        return f"{value:.6g}"
    return f"{value:.0f}" if isinstance(value, float) and math.isfinite(value) else repr(value)


# ---------------------------------------------------------------------------------------------------
# out

_TYPES = {
    "float": pa.float64(),
    "int": pa.int64(),
    "str": pa.string(),
    "list": pa.list_(pa.string()),
    "time": ZONED,
    "floats": pa.list_(pa.float32()),
}


def write_parquet(path: Path, columns: Mapping[str, tuple[str, Sequence[Any]]]) -> None:
    """Write a table; the same columns give the same bytes.

    Parameters
    ----------
    columns
        Heading to (kind, values); kinds: ``float``, ``int``, ``str``, ``list`` (of texts), ``floats`` (arrays),
        ``time`` [ns since 1970]; None = empty.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    schema = pa.schema([(name, _TYPES[kind]) for name, (kind, _) in columns.items()])
    arrays = [pa.array(list(values), type=_TYPES[kind]) for kind, values in columns.values()]
    with replacing(path) as file:
        pq.write_table(pa.table(arrays, schema=schema), file, compression="zstd")


def write_spells(out: Path, spells: Sequence[Spell], *, seconds: bool) -> Path:
    """Write ``spells.parquet``: how each loop ran in equal spells of time.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    write_parquet(out / SPELLS_FILE, columns(Spell, spells, seconds=seconds))
    return out / SPELLS_FILE


def write_evidence(
    out: Path, windows: Sequence[Window], answers: Sequence[Answers], *, seconds: bool
) -> list[Path]:
    """Write what an eye is shown: ``evidence.parquet`` (events) and ``answers.parquet`` (predicted responses).

    Raises
    ------
    OSError
        A file cannot be written.
    """
    onset = ("float", [w.onset / 1e9 for w in windows]) if seconds else ("time", [w.onset for w in windows])
    columns: dict[str, tuple[str, list[Any]]] = {
        **{name: ("str", [getattr(w, name) for w in windows]) for name in ("loop", "id")},
        "onset": onset,
        "time": ("floats", [_short(np.asarray(w.time - w.onset, dtype=np.float64) * 1e-9) for w in windows]),
        **{n: ("floats", [_short(getattr(w, n)) for w in windows]) for n in ("sp", "pv", "op", "model")},
    }
    write_parquet(out / EVIDENCE_FILE, columns)
    curves = {n: [getattr(a, n) for a in answers] for n in ("today", "new")}
    columns = {
        **{name: ("str", [getattr(a, name) for a in answers]) for name in ("loop", "kind")},
        "time": ("floats", [_short(a.time) for a in answers]),
        **{
            f"{n}{end}": ("floats", [_short(c[k]) for c in curves[n]])
            for n in curves
            for k, end in enumerate(_ENDS)
        },
    }
    write_parquet(out / ANSWERS_FILE, columns)
    return [out / EVIDENCE_FILE, out / ANSWERS_FILE]


_ENDS = ("", "_lo", "_hi")
"""Of a response: by the model found, and the least and largest of all models."""


def _short(values: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.asarray(values, dtype=np.float32)


# ---------------------------------------------------------------------------------------------------
# in


def read_evidence(out: Path) -> tuple[list[Window], list[Answers]]:
    """Return what `write_evidence` has written; nothing where an older audit has written none.

    Raises
    ------
    OSError
        A file cannot be read.
    ValueError
        It is no such table: one line that names it.
    """
    if not (out / EVIDENCE_FILE).exists() or not (out / ANSWERS_FILE).exists():
        return [], []
    events, curves = read_table(out / EVIDENCE_FILE), read_table(out / ANSWERS_FILE)
    try:
        windows = [
            Window(loop=row["loop"], id=row["id"], onset=(onset := _ns(row["onset"])),
                   time=onset + np.round(row["time"] * 1e9).astype(np.int64),
                   sp=row["sp"], pv=row["pv"], op=row["op"], model=row["model"])
            for row in _rows(events)
        ]  # fmt: skip
        answers = [
            Answers(row["loop"], row["kind"], row["time"],
                    *(np.stack([row[f"{n}{end}"] for end in _ENDS]) for n in ("today", "new")))
            for row in _rows(curves)
        ]  # fmt: skip
    except KeyError as column:
        raise ValueError(f"{out}: {EVIDENCE_FILE} and {ANSWERS_FILE}: no column {column}") from None
    return windows, answers


def _rows(table: Mapping[str, list[Any]]) -> list[dict[str, Any]]:
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


def _ns(time: float) -> int:
    """Return a time [ns since 1970] of a column that has those, or float seconds."""
    return round(time * 1e9) if isinstance(time, float) else time


Record = TypeVar("Record", Assessment, LoopRow, Spell)


def read_records(path: Path, record: type[Record]) -> list[Record]:
    """Return the records of a table that `write_tables` has written, in its order.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no such table: one line that names the file and what is missing.
    """
    table = read_table(path)
    known = {name: values for name, values in table.items() if name in record.__struct_fields__}
    try:
        return [msgspec.convert(_plain(row), record) for row in _rows(known)]
    except msgspec.ValidationError as error:
        raise ValueError(f"{path}: no table of an audit: {error}") from None


def missing_columns(path: Path, record: type[Assessment | LoopRow]) -> list[str]:
    """Return the columns that a table of such records does not have, since an earlier version wrote it.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    have = set(pq.read_schema(path).names)
    return [name for name in record.__struct_fields__ if name not in have]


def read_table(path: Path) -> dict[str, list[Any]]:
    """Return a table's columns, times as integer nanoseconds since 1970, or as float seconds where it has those.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no Parquet.
    """
    try:
        table = pq.read_table(path)
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path}: no Parquet file: {error}") from None
    return {name: _values(table.column(name)) for name in table.column_names}


def _values(column: pa.ChunkedArray) -> list[Any]:
    if pa.types.is_timestamp(column.type):
        return list(column.cast(pa.int64()).to_pylist())
    if column.type == _TYPES["floats"]:
        return [v.values.to_numpy().astype(np.float64) for v in column]
    return list(column.to_pylist())


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row as a record takes it: times are integers, an empty text is one, other empty cells stay away."""
    times = {n: _ns(row[n]) for n in TIMES if row.get(n) is not None}
    return {**{n: v for n, v in row.items() if v is not None}, **times}
