"""What a cell of an export may be, by its text alone: a number, a date, a time of day, a word in place of a value."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .time_formats import is_time_text

NUMBER, TIME, CLOCK, WORD, EMPTY = "number", "time", "clock", "word", "empty"
"""Kinds of a cell, and of most of a column's cells: number, date (with a time of day or without), time of day, other
text, nothing."""
MOST_ODD_SHARE = 0.5
"""Share of a column's cells that may be of another kind: text stands for bad values."""
_NUMBER = re.compile(r"^[+-]?(?:\d+(?:[.,]\d*)*|[.,]\d+)(?:[eE][+-]?\d+)?\s?%?$")
_CLOCK = re.compile(r"^\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?(?:\s*[aApP]\.?[mM]\.?)?$")
_BAD_WORDS = frozenset(
    "nan null none n/a na #n/a bad good uncertain questionable substituted inf -nan - -- ? true false wahr falsch "
    "auto aut man manual cas rcas rout trk iman oos hand automatik bad_input".split()
) | {
    "bad input",
    "i/o timeout",
    "no data",
    "pt created",
    "shutdown",
    "#n/a",
    "no result",
    "scan off",
    "not connect",
}


def kind_of(cell: str) -> str:
    """Return a cell's kind.

    Examples
    --------
    >>> [kind_of(cell) for cell in ("48,8", "02-Mar-26 08:00", "08:00:00", "%", "")]
    ['number', 'time', 'clock', 'word', 'empty']
    """
    text = cell.strip()
    if not text:
        return EMPTY
    if _NUMBER.match(text) and not (len(text) == 8 and text.isdigit() and text[:2] in {"19", "20"}):
        return TIME if re.match(r"^\d{1,2}\.\d{1,2}\.\d{2,4}$", text) and is_time_text(text) else NUMBER
    if _CLOCK.match(text):
        return CLOCK
    if re.match(r"^[\d\sA-Za-zäöü]", text) and is_time_text(text):
        return TIME
    return WORD


def stands_for_value(cell: str) -> bool:
    """Whether a cell is a value, or a word that historians write in place of one."""
    return kind_of(cell) in {NUMBER, TIME, CLOCK} or cell.strip().lower() in _BAD_WORDS


def column_kind(cells: Sequence[str]) -> str:
    """Return the kind of most of a column's cells, as far as they are not empty.

    Examples
    --------
    >>> column_kind(["1.5", "Bad Input", "1.6", ""])
    'number'
    """
    kinds = [kind for kind in map(kind_of, cells) if kind != EMPTY]
    if not kinds:
        return EMPTY
    for kind in (TIME, CLOCK, NUMBER):
        if kinds.count(kind) >= MOST_ODD_SHARE * len(kinds) and kinds.count(kind):
            return kind
    return WORD


def decimal_comma(cells: Sequence[str]) -> bool | None:
    """Whether numbers have a decimal comma; None where no cell tells.

    ``1,234`` may be either and tells nothing; ``12,5`` and ``0,125`` have one, ``1,234.5`` has none.
    """
    commas = points = 0
    for cell in cells:
        text = cell.strip()
        if kind_of(text) != NUMBER or not ("," in text or "." in text):
            continue
        comma, point = text.rfind(","), text.rfind(".")
        if comma >= 0 and point >= 0:
            commas, points = commas + (comma > point), points + (point > comma)
        elif comma >= 0:
            grouped = re.match(r"^[+-]?[1-9]\d{0,2}(?:,\d{3})+$", text)
            commas += grouped is None
        else:
            points += 1
    if commas and points:
        return commas > points
    return True if commas else (False if points else None)
