"""The workbook: cells as they are, no formula, the same bytes each time."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest

from monitor.adapters.workbook import Sheet, write_workbook


def xml(path: Path, name: str) -> str:
    with zipfile.ZipFile(path) as book:
        return book.read(name).decode()


def test_the_same_tables_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.xlsx", "b.xlsx"):
        write_workbook(tmp_path / name, [Sheet("loops", {"loop": ["x"], "kp": [1.25]})])
    assert (tmp_path / "a.xlsx").read_bytes() == (tmp_path / "b.xlsx").read_bytes()


@pytest.mark.parametrize(
    "text", ["=cmd()|' /C calc'!A0", "+1", "-1", "@SUM(1)", "\t=1", "http://x.y", "a\x1b[2J", "\u202egnp"]
)
def test_no_text_is_run(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.xlsx"
    write_workbook(path, [Sheet("loops", {"loop": [text], text: [1.0]})])
    sheet, strings = xml(path, "xl/worksheets/sheet1.xml"), xml(path, "xl/sharedStrings.xml")
    assert "<f>" not in sheet
    assert "hyperlink" not in sheet
    assert not re.search(r"[\x00-\x08\x0b-\x1f\u202a-\u202e]", strings)


def test_cells_hold_what_a_cell_can(tmp_path: Path) -> None:
    path = tmp_path / "a.xlsx"
    columns = {"v": [1.23456789, float("inf"), float("nan"), None, ("a", "b"), 1_772_323_200.5, 7]}
    write_workbook(path, [Sheet("loops", columns, "a note")])
    sheet, strings = xml(path, "xl/worksheets/sheet1.xml"), xml(path, "xl/sharedStrings.xml")
    assert re.findall(r"<v>([\d.]+)</v></c></row>", sheet)[2:] == ["1.23457", "2", "3", "1772323200", "7"]
    for text in ("inf", "a;b", "a note"):
        assert f"<t>{text}</t>" in strings


def test_no_rows_make_a_sheet(tmp_path: Path) -> None:
    write_workbook(tmp_path / "a.xlsx", [Sheet("loops", {"loop": []})])
    assert zipfile.is_zipfile(tmp_path / "a.xlsx")
