"""Tables to a workbook for a spreadsheet: the same tables give the same bytes, and no text is run as a formula."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import xlsxwriter

from monitor.contract.text import visible

from .files import replacing

MOST_CELL_LETTERS = 32_000
"""A spreadsheet takes 32,767."""
WIDEST_COLUMN, ROWS_LOOKED_AT = 60, 200
"""Letters of a column's width, and rows from which it is told."""
CREATED = datetime(2000, 1, 1, tzinfo=UTC).replace(tzinfo=None)
"""In place of the wall clock's time, which would make each file another one."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """One sheet: columns by heading, and a note above them where something has to be said."""

    name: str
    columns: Mapping[str, Sequence[Any]]
    note: str = ""


def write_workbook(path: Path, sheets: Sequence[Sheet]) -> None:
    """Write sheets, their head frozen and with filters; lists are joined by ``;``.

    Texts are texts, whatever they begin with; what does not print is shown as an escape. A number that a cell cannot
    hold (inf) is a text.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    options = {
        "in_memory": True,
        "strings_to_formulas": False,
        "strings_to_urls": False,
        "strings_to_numbers": False,
    }
    with replacing(path) as file:
        book = xlsxwriter.Workbook(file, options)
        book.set_properties({"created": CREATED})
        head = book.add_format({"bold": True, "text_wrap": True, "valign": "top"})
        for sheet in sheets:
            _fill(book.add_worksheet(sheet.name), sheet, head)
        book.close()


def _fill(page: Any, sheet: Sheet, head: Any) -> None:
    top = 0
    if sheet.note:
        page.write_string(0, 0, sheet.note, head)
        top = 1
    rows = 0
    for k, (name, values) in enumerate(sheet.columns.items()):
        page.write_string(top, k, visible(name), head)
        shown = [_cell(v) for v in values]
        rows = len(shown)
        for n, value in enumerate(shown, start=top + 1):
            if isinstance(value, str):
                page.write_string(n, k, value)
            elif value is not None:
                page.write_number(n, k, value)
        widths = [len(str(v)) for v in shown[:ROWS_LOOKED_AT] if v is not None]
        page.set_column(k, k, min(max([len(name), *widths], default=8) + 1, WIDEST_COLUMN))
    page.freeze_panes(top + 1, 1)
    if rows:
        page.autofilter(top, 0, top + rows, len(sheet.columns) - 1)


def _cell(value: Any) -> str | float | None:
    """Return what a cell holds: a text, a number with six significant digits, or nothing."""
    if value is None or value == "":
        return None
    if isinstance(value, tuple | list):
        value = ";".join(value)
    if isinstance(value, str):
        return visible(value, MOST_CELL_LETTERS) or None
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) and abs(value) < 1e6 else _large(value)
    return float(value)


def _large(value: float) -> str | float | None:
    if math.isnan(value):
        return None
    return round(value) if math.isfinite(value) else str(value)
