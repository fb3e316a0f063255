"""Where a table begins in an export: title rows above its headings, rows of units beneath them, two rows of them."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from .cell_kinds import CLOCK, NUMBER, TIME, column_kind, decimal_comma, kind_of, stands_for_value
from .layout import NotUnderstoodError, is_time_heading
from .tag_roles import read_tag, role_of

SEPARATORS = (",", ";", "\t", "|")
MOST_HEAD_ROWS = 300
"""Rows by which a table is told."""
MOST_HEAD_CELLS = 200_000
"""Cells looked at; a wide table of a fleet has tens of thousands in a row."""
MOST_HEADING_ROWS = 8
"""Rows above the data among which the headings are looked for."""


@dataclass(frozen=True, slots=True)
class Head:
    """Where a table's headings and data are."""

    headings: tuple[str, ...]
    """One a column; ``column 1``, ... where there is no row of headings."""
    header: int
    """Row of the headings, from 0; -1: there is none."""
    data: int
    """First row of data, from 0."""
    cells: tuple[tuple[str, ...], ...]
    """First cells of each column, from the data on."""

    @property
    def by_heading(self) -> dict[str, tuple[str, ...]]:
        """First cells of each column, by its heading."""
        return dict(zip(self.headings, self.cells, strict=True))

    @property
    def kinds(self) -> dict[str, str]:
        """Kind of each column, by its heading."""
        return {h: column_kind(c) for h, c in zip(self.headings, self.cells, strict=True)}


@dataclass(frozen=True, slots=True)
class HeadHints:
    """What a user says of a table; None: to be told by itself."""

    separator: str | None = None
    header: int | None = None
    data: int | None = None


def separator_of(lines: Sequence[str]) -> str:
    """Tell what separates a text's cells: where it does, cells are values, and lines alike.

    Examples
    --------
    >>> separator_of(["Zeit;A.PV", "25.11.2026 01:00:00;48,8", "25.11.2026 01:00:05;48,9"])
    ';'
    """
    if lines and lines[0].lower().startswith("sep=") and len(lines[0].strip()) == 5:
        return lines[0].strip()[-1]

    def score(separator: str) -> tuple[int, int]:
        rows = [row for row in csv.reader(lines, delimiter=separator) if row]
        width = Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
        alike = [row for row in rows if len(row) == width]
        if width < 2:
            return 0, 0
        return sum(stands_for_value(cell) for row in alike for cell in row), sum(map(len, rows))

    return max(SEPARATORS, key=score)


def table_head(rows: Sequence[Sequence[str]], hints: HeadHints | None = None) -> Head:
    """Find a table among an export's first rows.

    Parameters
    ----------
    rows
        Their cells, as text; empty rows have none.
    hints
        What the user says.

    Raises
    ------
    ValueError
        No rows of data are among them.
    """
    hints = hints or HeadHints()
    full = [row for row in rows if any(cell.strip() for cell in row)]
    if not full:
        raise NotUnderstoodError("no rows")
    widths = Counter(len(row) for row in full[len(full) // 2 :])
    width = max(widths, key=lambda w: (widths[w], w))
    data = hints.data if hints.data is not None else _first_data_row(rows, width)
    header = hints.header if hints.header is not None else _header_row(rows, data, width)
    headings = _headings(rows, header, data, width)
    body = [row for row in rows[data:] if any(cell.strip() for cell in row)]
    cells = tuple(tuple(row[k] if k < len(row) else "" for row in body) for k in range(width))
    return Head(headings, header, data, cells)


def _first_data_row(rows: Sequence[Sequence[str]], width: int) -> int:
    """Find the first of the rows that go on alike to the end of what is looked at."""
    half = [row for row in rows if len(row) == width][-max(1, len(rows) // 2) :]
    times = [
        k
        for k in range(min(width, MOST_HEADING_ROWS))
        if half and column_kind([row[k] for row in half]) in {TIME, CLOCK}
    ]
    for k, row in enumerate(rows):
        if len(row) != width:
            continue
        kinds = [kind_of(row[t]) for t in times]
        if times and all(kind in {TIME, CLOCK, NUMBER} for kind in kinds):
            return k
        filled = [cell for cell in row if cell.strip()]
        if not times and filled and sum(map(stands_for_value, filled)) * 2 >= len(filled):
            return k
    raise NotUnderstoodError(f"no rows of data, expected rows of {width} cells with a time")


def _score(row: Sequence[str]) -> int:
    """Count the cells that read as headings."""
    return sum(
        bool(is_time_heading(c) or role_of(c) is not None or read_tag(c) is not None)
        for c in row
        if c.strip() and kind_of(c) not in {NUMBER, TIME}
    )


def _header_row(rows: Sequence[Sequence[str]], data: int, width: int) -> int:
    above = [k for k in range(max(0, data - MOST_HEADING_ROWS), data) if any(c.strip() for c in rows[k])]
    scores = {k: _score(rows[k]) for k in above if len(rows[k]) <= width or _score(rows[k]) > 1}
    if scores and max(scores.values()) > 0:
        return max(scores, key=lambda k: (scores[k], -k))
    alike = [k for k in above if len(rows[k]) == width and sum(bool(c.strip()) for c in rows[k]) * 2 > width]
    return alike[0] if alike else -1


def _headings(rows: Sequence[Sequence[str]], header: int, data: int, width: int) -> tuple[str, ...]:
    if header < 0:
        return tuple(f"column {k + 1}" for k in range(width))
    row = [rows[header][k].strip() if k < len(rows[header]) else "" for k in range(width)]
    row = _with_names_above(rows, header, data, row)
    seen: Counter[str] = Counter()
    out = []
    for k, cell in enumerate(row):
        heading = cell or f"column {k + 1}"
        seen[heading] += 1
        out.append(heading if seen[heading] == 1 else f"{heading} ({seen[heading]})")
    return tuple(out)


def _with_names_above(rows: Sequence[Sequence[str]], header: int, data: int, row: list[str]) -> list[str]:
    """Join two rows of headings: the loops' names, each over its roles."""
    roles = [k for k, cell in enumerate(row) if role_of(cell) not in {None, ""}]
    if len(roles) < 3 or len({role_of(row[k]) for k in roles}) * 2 > len(roles) + 2:
        return row
    for names in (header - 1, header + 1):
        if not 0 <= names < data or names == header:
            continue
        last, out = "", list(row)
        for k in range(len(row)):
            cell = rows[names][k].strip() if k < len(rows[names]) else ""
            last = cell or last
            if k in roles and last:
                out[k] = f"{last}.{row[k]}"
        if len(set(out)) == len(out):
            return out
    return row


def comma_of(head: Head, separator: str) -> bool:
    """Whether a table's numbers have a decimal comma."""
    kinds = head.kinds
    found = [decimal_comma(c) for h, c in zip(head.headings, head.cells, strict=True) if kinds[h] == NUMBER]
    return True in found and (separator != "," or found.count(True) > found.count(False))
