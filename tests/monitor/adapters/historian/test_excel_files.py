"""Workbooks."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import openpyxl
import pytest

from monitor.adapters.historian.excel_files import excel_batches
from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.rows import UnusableError


def book(path: Path, rows: list[list[object]]) -> Path:
    made = openpyxl.Workbook()
    for row in rows:
        made.active.append(row)
    made.save(path)
    return path


def test_a_cell_is_what_it_is(tmp_path: Path) -> None:
    times = [dt.datetime(2026, 3, 14, 8, 0, s) for s in (0, 5)]  # noqa: DTZ001 (a cell has no zone)
    rows = [
        ["Time", "A.SP", "A.PV", "A.OP", "A.MODE"],
        *([t, 50, "Bad" if k else 1.5, 40.5, "MAN"] for k, t in enumerate(times)),
    ]
    source = inspect(book(tmp_path / "d.xlsx", rows))
    assert source.clock.naive
    [(_, batch)] = excel_batches(source, ["Time", "A.SP", "A.PV", "A.MODE"])
    assert batch.to_pydict() == {
        "Time": times,
        "A.SP": [50, 50],
        "A.PV": ["1.5", "Bad"],
        "A.MODE": ["MAN", "MAN"],
    }


@pytest.mark.parametrize("rows", [[], [["only", "words"], ["a", "b"]]])
def test_what_is_no_export_is_said(tmp_path: Path, rows: list[list[object]]) -> None:
    with pytest.raises(UnusableError, match=r"d\.xlsx: "):
        inspect(book(tmp_path / "d.xlsx", rows))


def test_what_is_no_workbook_is_said(tmp_path: Path) -> None:
    (tmp_path / "d.xlsx").write_bytes(b"PK nothing")
    with pytest.raises(UnusableError, match="no workbook"):
        inspect(tmp_path / "d.xlsx")
