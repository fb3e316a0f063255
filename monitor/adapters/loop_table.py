"""Loop tables from files: CSV, TOML, Parquet."""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path
from typing import Any

from monitor.contract.loop_fields import TABLE_COLUMNS, known_forms, parse_row
from monitor.contract.loops import LoopTable, LoopTableError
from monitor.contract.table_words import unknown_column
from monitor.contract.text import as_named

# ---------------------------------------------------------------------------------------------------
# files


def read_loop_table(path: Path | str) -> LoopTable:
    """Read ``.csv``, ``.toml`` (tables ``[[loop]]``) or ``.parquet``.

    Raises
    ------
    LoopTableError
        With every problem of the file: ``file:row: field: value, expected …``.
    OSError
        The file cannot be read.
    """
    path = Path(path)
    table, problems = LoopTable([]), []
    try:
        rows = _rows(path)
    except (UnicodeDecodeError, csv.Error, tomllib.TOMLDecodeError, ValueError) as error:
        raise LoopTableError([f"{path}: {error}"]) from None
    forms = known_forms()
    for number, row in rows:
        loop, wrong = parse_row(row, forms)
        problems += [f"{path}:{number}: {what}" for what in wrong]
        if loop is None:
            continue
        try:
            table.add(loop)
        except ValueError as error:
            problems.append(f"{path}:{number}: name: {error}, expected a unique name and key")
    if problems:
        raise LoopTableError(problems)
    if not len(table):
        raise LoopTableError([f"{path}: no loop in it, expected a row per loop with a column `name`"])
    return table


def unknown_columns(path: Path | str) -> list[str]:
    """Say which columns of a loop table are not known, one line each with the known one that may be meant.

    Nothing is said of a table that cannot be read: `read_loop_table` does.
    """
    try:
        rows = _rows(Path(path))
    except (OSError, UnicodeDecodeError, csv.Error, tomllib.TOMLDecodeError, ValueError):
        return []
    columns: dict[str, list[object]] = {}
    for _, row in rows:
        for column, value in row.items():
            columns.setdefault(str(column), []).append(value)
    return [
        f"{path}: {said}" for column, values in columns.items() if (said := unknown_column(column, values))
    ]


def _rows(path: Path) -> list[tuple[int, dict[str, Any]]]:
    """Read the rows with the line (CSV) or running number by which a user finds them."""
    if path.suffix == ".toml":
        tables = tomllib.loads(path.read_text(encoding="utf-8")).get("loop", [])
        if not isinstance(tables, list):
            raise ValueError("loop: expected tables [[loop]]")
        return list(enumerate(tables, 1))
    if path.suffix == ".parquet":
        import pandas as pd  # noqa: PLC0415 (half a second, only for this format)

        records = pd.read_parquet(path).to_dict("records")
        return [(n, {str(k): v for k, v in r.items()}) for n, r in enumerate(records, 1)]
    with path.open(encoding="utf-8-sig", newline="") as file:
        head = file.readline()
        file.seek(0)
        reader = csv.DictReader(file, delimiter=";" if head.count(";") > head.count(",") else ",")
        if reader.fieldnames is None or "name" not in [f.strip() for f in reader.fieldnames]:
            raise ValueError(f"no column `name` in its header, expected some of {', '.join(TABLE_COLUMNS)}")
        reader.fieldnames = [f.strip() for f in reader.fieldnames]
        return [(reader.line_num, {**row, "name": as_named(row["name"] or "")}) for row in reader]
