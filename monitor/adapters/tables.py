"""The audit's tables: records to the columns of ``events.parquet``, ``loops.parquet`` and ``loops.csv``."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import pyarrow as pa
import pyarrow.parquet as pq

from monitor.adapters.historian.source import ZONED
from monitor.contract.records import TIMES, Assessment, LoopRow

from .files import replacing, write_text

EVENTS_FILE, LOOPS_FILE, LOOPS_CSV_FILE = "events.parquet", "loops.parquet", "loops.csv"
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def write_tables(
    out: Path, events: Sequence[Assessment], loops: Sequence[LoopRow], *, seconds: bool
) -> list[Path]:
    """Write all three tables; the same records give the same bytes.

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
    return [out / LOOPS_CSV_FILE, out / LOOPS_FILE, out / EVENTS_FILE]


def columns(
    record: type[Assessment | LoopRow], records: Sequence[Any], *, seconds: bool
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

    A text that a spreadsheet would run as a formula (it begins with = + - @ or a tab) has an apostrophe
    before it; ``loops.parquet`` holds it as it is.
    """
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    table = columns(LoopRow, loops, seconds=True)
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
        return "'" + value if value.startswith(_FORMULA) else value
    return repr(value)


# ---------------------------------------------------------------------------------------------------
# out

_TYPES = {
    "float": pa.float64(),
    "int": pa.int64(),
    "str": pa.string(),
    "list": pa.list_(pa.string()),
    "time": ZONED,
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
    with replacing(path) as file:
        pq.write_table(pa.table(arrays, schema=schema), file, compression="zstd")
