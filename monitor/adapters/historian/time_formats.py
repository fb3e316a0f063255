"""Times as plants write them, as text, to nanoseconds: dates with names of months, AM and PM, days before months.

A time is read by its fields (one compiled expression over a column, arithmetic for the rest), so that no list of
formats is tried. What the fields do not say, whether the day or the month stands first, the whole column has to.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from .clock import DAY_FIRST, MONTH_FIRST, YEAR_FIRST

MONTH_NAMES = (
    ("jan", "january", "januar", "jän", "jänner"),
    ("feb", "february", "februar", "feber"),
    ("mar", "march", "mär", "märz", "mrz", "maerz"),
    ("apr", "april"),
    ("may", "mai"),
    ("jun", "june", "juni"),
    ("jul", "july", "juli"),
    ("aug", "august"),
    ("sep", "sept", "september"),
    ("oct", "october", "okt", "oktober"),
    ("nov", "november"),
    ("dec", "december", "dez", "dezember"),
)
"""Names of months, English and German, lower case."""
_MONTH = {name: number for number, names in enumerate(MONTH_NAMES, 1) for name in names}
MONTHS, DAYS = 12, 31
CENTURY_YEARS = 100
"""A year below it is one of this century."""
OLDEST_YEAR, NEWEST_YEAR = 1678, 2262
"""Between which nanoseconds in 64 bits count."""

_DATES = (
    r"(?P<y>\d{4})[-/. ](?P<m>\d{1,2})[-/. ](?P<d>\d{1,2})",
    r"(?P<a>\d{1,2})(?P<s>[-/.])(?P<b>\d{1,2})[-/.](?P<y>\d{4}|\d{2})",
    r"(?P<d>\d{1,2})\.?[-/. ]?\s?(?P<n>[a-zA-Zäöü]{3,9})\.?[-/. ,]?\s?(?P<y>\d{4}|\d{2})",
    r"(?P<n>[a-zA-Zäöü]{3,9})\.?[- ](?P<d>\d{1,2})(?:st|nd|rd|th)?,?[- ](?P<y>\d{4})",
)
"""Dates: year first; two numbers before the year, in either order; with a month's name."""
_CLOCK = (
    r"(?P<H>\d{1,2})[:.](?P<M>\d{2})(?:[:.](?P<S>\d{2})(?:[.,:](?P<f>\d{1,9}))?)?"
    r"(?:\s*(?P<p>[aApP])\.?[mM]\.?)?"
)
_ZONE = r"(?:\s*(?P<z>[zZ]|UTC|GMT|(?:UTC|GMT)?[+-]\d{2}:?\d{2}|[+-]\d{2}))?"
_DAY_NAME = r"(?:[a-zA-Z]{2,9}\.?,?\s+)?"
_ZONES = {
    **dict.fromkeys(("UTC", "GMT", "WET", "Z"), 0),
    **dict.fromkeys(("CET", "MEZ", "BST", "WEST"), 1),
    **dict.fromkeys(("CEST", "MESZ", "EET"), 2),
    "EEST": 3,
    "EST": -5,
    "EDT": -4,
    "CST": -6,
    "CDT": -5,
    "MST": -7,
    "MDT": -6,
    "PST": -8,
    "PDT": -7,
}
"""Names of zones in times of programs written in Java; [h]."""
PATTERNS = (
    *(rf"^\s*{_DAY_NAME}{date}(?:(?:[T,:])?\s*{_CLOCK}(?:\s+Uhr)?{_ZONE})?\s*$" for date in _DATES),
    *(rf"^\s*{_CLOCK}\s+{date}\s*$" for date in _DATES),
    (
        r"^\s*(?P<y>(?:19|20)\d{2})(?P<m>\d{2})(?P<d>\d{2})(?:[T ]?(?P<H>\d{2})(?P<M>\d{2})"
        rf"(?P<S>\d{{2}})(?:[.,](?P<f>\d{{1,9}}))?{_ZONE})?\s*$"
    ),
    rf"^\s*(?P<y>(?:19|20)\d{{2}})(?P<m>\d{{2}})(?P<d>\d{{2}})[T ]\s*{_CLOCK}{_ZONE}\s*$",
    (
        r"^\s*[A-Za-z]{3} (?P<n>[A-Za-z]{3}) (?P<d>\d{1,2}) (?P<H>\d{2}):(?P<M>\d{2}):(?P<S>\d{2})"
        rf" (?:(?P<z>{'|'.join(_ZONES)}) )?(?P<y>\d{{4}})\s*$"
    ),
)
"""Of each kind of text; a text is of the first kind that fits."""
_KINDS = tuple(map(re.compile, PATTERNS))
Ns = NDArray[np.int64]
Mask = NDArray[np.bool_]


def is_time_text(text: str) -> bool:
    """Whether a text is a date, with or without a time of day.

    Examples
    --------
    >>> [is_time_text(t) for t in ("02-Mar-26 08:00:00", "3/2/2026 8:00 AM", "48.8", "2026-03-02T08:00:00+01:00")]
    [True, True, False, True]
    """
    found = next((m for kind in _KINDS if (m := kind.match(text))), None)
    if found is None:
        return False
    name = found.groupdict().get("n")
    return name is None or name.lower() in _MONTH


class TextTimes:
    """A column of texts, as fields of dates; (N,) each.

    Parameters
    ----------
    array
        The texts, an Arrow array.
    """

    def __init__(self, array: Any) -> None:
        array = array.cast(pa.string())
        self.n = len(array)
        self._numbers = {
            name: np.zeros(self.n, np.int64) for name in ("y", "m", "d", "a", "b", "H", "M", "S", "f")
        }
        self._offset = np.zeros(self.n, np.int64)
        self._aware = np.zeros(self.n, np.bool_)
        self._half = np.zeros(self.n, np.int8)
        """1 before noon, 2 after it, 0 where the text has 24 hours."""
        self._short = np.zeros(self.n, np.bool_)
        """Years of two digits."""
        dotted = np.zeros(self.n, np.bool_)
        left = np.arange(self.n)
        for pattern in _in_order(array):
            if not len(left):
                break
            fields = pc.extract_regex(array if len(left) == self.n else array.take(pa.array(left)), pattern)
            found = np.asarray(fields.is_valid().to_numpy(zero_copy_only=False), np.bool_)
            if found.any():
                rows = left[found]
                self._take(rows, fields.filter(pa.array(found)), dotted)
            left = left[~found]
        self.a, self.b, self.year = self._numbers["a"], self._numbers["b"], self._numbers["y"]
        self.open = (self.a > 0) & ~dotted
        """Where day and month are two numbers before the year."""

    def _take(self, rows: Ns, fields: Any, dotted: Mask) -> None:
        """Take over the fields of the texts of one kind (in place)."""
        for name in (fields.type.field(k).name for k in range(fields.type.num_fields)):
            column = pc.struct_field(fields, name)
            if name == "n":
                self._numbers["m"][rows] = _by_word(column, lambda word: _MONTH.get(word.lower(), 0))
            elif name == "z":
                self._offset[rows] = _by_word(column, _zone_seconds)
                self._aware[rows] = _by_word(column, bool) > 0
            elif name == "p":
                self._half[rows] = _by_word(column, lambda word: " ap".find(word.lower()) if word else 0)
            elif name == "s":
                dotted[rows] = _by_word(column, lambda word: word == ".") > 0
            else:
                text = (
                    pc.utf8_rpad(column, 9, "0")
                    if name == "f"
                    else pc.if_else(pc.equal(column, ""), "0", column)
                )
                self._numbers[name][rows] = text.cast(pa.int64()).to_numpy(zero_copy_only=False)
                if name == "y":
                    self._short[rows] = pc.equal(pc.utf8_length(column), 2).to_numpy(zero_copy_only=False)

    def orders(self) -> set[str]:
        """Return the orders of day and month that the open dates allow; both where there is none."""
        a, b = self.a[self.open], self.b[self.open]
        out = set()
        if not (a > DAYS).any() and not (b > MONTHS).any():
            out.add(DAY_FIRST)
        if not (b > DAYS).any() and not (a > MONTHS).any():
            out.add(MONTH_FIRST)
        return out

    def read(self, order: str) -> tuple[Ns, Mask, Mask]:
        """Return times.

        Parameters
        ----------
        order
            Of day and month where both are numbers before the year.

        Returns
        -------
        time, good, aware
            (N,) [ns], UTC where ``aware`` of a zone, local elsewhere; (N,) whether the text is a time.
        """
        number = self._numbers
        month_first = self.open & (order == MONTH_FIRST)
        day = np.where(self.a > 0, np.where(month_first, self.b, self.a), number["d"])
        month = np.where(self.a > 0, np.where(month_first, self.a, self.b), number["m"])
        year = np.where(self._short, self.year + 2000, self.year)
        hour, minute, second = number["H"], number["M"], number["S"]
        odd = (self._half > 0) & ((hour > 12) | (hour == 0))
        hour = np.where(self._half == 2, hour % 12 + 12, np.where(self._half == 1, hour % 12, hour))
        good = (year >= OLDEST_YEAR) & (year < NEWEST_YEAR) & (month >= 1) & (month <= MONTHS)
        good &= (day >= 1) & ~odd & (hour < 24) & (minute < 60) & (second < 60)
        first, length = _months(np.where(good, year, 1970), np.where(good, month, 1))
        good &= day <= length
        date = first + day - 1
        seconds = date * 86_400 + hour * 3600 + minute * 60 + second
        ns = (seconds - self._offset) * 10**9 + number["f"]
        return np.where(good, ns, 0), good, self._aware & good


def _in_order(array: Any) -> list[str]:
    """Return the patterns, that of the first text before the others."""
    first = next((str(t) for t in array[:100] if t.as_py()), "")
    return sorted(PATTERNS, key=lambda pattern: re.match(pattern, first) is None)


def _by_word(column: Any, meaning: Callable[[str], float]) -> Ns:
    """Look up each different word once."""
    encoded = pc.fill_null(column, "").dictionary_encode()
    table = np.array([*(meaning(word) for word in encoded.dictionary.to_pylist()), 0], np.int64)
    return np.asarray(table[encoded.indices.to_numpy(zero_copy_only=False)])


def _zone_seconds(zone: str) -> int:
    found = re.search(r"([+-])(\d{2}):?(\d{2})?$", zone)
    if found is None:
        return 3600 * _ZONES.get(zone.upper(), 0)
    size = int(found[2]) * 3600 + int(found[3] or 0) * 60
    return size if found[1] == "+" else -size


def _months(year: Ns, month: Ns) -> tuple[Ns, Ns]:
    """Return the first day of months, in days since 1970, and how many days they have."""
    since = ((year - 1970) * MONTHS + month - 1).astype("datetime64[M]")
    first, end = (m.astype("datetime64[D]").astype(np.int64) for m in (since, since + np.timedelta64(1, "M")))
    return first, end - first


def read_text_times(array: Any, order: str = "") -> tuple[Ns, Mask, Mask]:
    """Read a column of texts as times; each different text once.

    Parameters
    ----------
    array
        The texts, an Arrow array.
    order
        Of day and month, as `order_of_dates` says.

    Returns
    -------
    time, good, aware
        (N,) [ns], local where not ``aware`` of a zone; (N,) whether the text is a time.
    """
    encoded = array.cast(pa.string()).dictionary_encode()
    ns, good, aware = TextTimes(encoded.dictionary).read(order)
    index = encoded.indices.fill_null(len(ns)).to_numpy(zero_copy_only=False)
    none = np.zeros(1, np.bool_)
    return (
        np.concatenate([ns, [0]])[index],
        np.concatenate([good, none])[index],
        np.concatenate([aware, none])[index],
    )


def order_of_dates(batches: Iterable[Any], option: str = "--time-format") -> str:
    """Tell by a whole column whether the day or the month stands first; empty where its dates do not need it.

    A number above 12 tells; else what the dates do when a day ends: in one of the two readings they leap by a month.

    Parameters
    ----------
    batches
        The column's texts, Arrow arrays.

    Raises
    ------
    ValueError
        Each may be either, or both are needed.
    """
    allowed, shown, seen = {DAY_FIRST, MONTH_FIRST}, "", []
    for array in batches:
        different = array.cast(pa.string()).drop_null().unique()
        times = TextTimes(different)
        if not times.open.any():
            continue
        shown = shown or str(different[int(np.argmax(times.open))])
        allowed &= times.orders()
        if not allowed:
            raise ValueError(
                f"time: {shown[:40]!r} and others name now the day, now the month first; expected one order"
            )
        if len(allowed) == 1:
            return allowed.pop()
        days = np.unique(np.stack([times.year, times.a, times.b])[:, times.open], axis=1)
        seen.append(days)
    if not shown:
        return ""
    order = _order_by_days(np.unique(np.concatenate(seen, axis=1), axis=1))
    if order:
        return order
    raise ValueError(
        f"time: {shown[:40]!r} and all others may name the day or the month first; say which by "
        f"{option} '%d/%m/%Y %H:%M:%S' or '%m/%d/%Y %H:%M:%S'"
    )


LEAST_RUN_DAYS = 3
"""Days in a row from which on they tell which number is the day."""


def _order_by_days(days: Ns) -> str:
    """Tell by days that follow each other without a gap: only one of the two numbers counts on."""
    year, a, b = days
    if days.shape[1] < LEAST_RUN_DAYS:
        return ""
    year = np.where(year < CENTURY_YEARS, year + 2000, year)
    spans = {
        DAY_FIRST: np.ptp(_months(year, b)[0] + a) + 1,
        MONTH_FIRST: np.ptp(_months(year, a)[0] + b) + 1,
    }
    whole = [order for order, span in spans.items() if span == days.shape[1]]
    return whole[0] if len(whole) == 1 else ""


def day_only(array: Any) -> Any:
    """Return dates as text; of a timestamp at midnight the day alone."""
    text = array.cast(pa.string())
    return pc.replace_substring_regex(text, r"[ T]00:00(:00(\.0+)?)?$", "")


def joined_texts(date: Any, clock: Any) -> Any:
    """Put dates and times of day together, as text."""
    return pc.binary_join_element_wise(date, clock.cast(pa.string()), " ")


def order_of_format(text: str) -> str:
    """Return the order of day, month and year that a format names.

    Parameters
    ----------
    text
        As of ``strftime`` (``%d/%m/%Y %H:%M:%S``), or with letters: ``dd/MM/yyyy HH:mm``, ``dmy``.

    Raises
    ------
    ValueError
        It names no day and month.

    Examples
    --------
    >>> order_of_format("%m/%d/%Y %I:%M:%S %p"), order_of_format("dd.MM.yyyy"), order_of_format("%Y-%m-%d")
    ('month/day/year', 'day/month/year', 'year/month/day')
    """
    found = [c.lower() for c in re.findall(r"%([dmYyb])", text)] if "%" in text else []
    if not found:
        date = re.split(r"[\sT]+[Hh]", text)[0]
        found = [c[0].lower() for c in re.findall(r"[dD]+|M+|m+|[yY]+", date)]
    letters = "".join("m" if c == "b" else c for c in found)
    orders = {"dmy": DAY_FIRST, "mdy": MONTH_FIRST, "ymd": YEAR_FIRST, "dm": DAY_FIRST, "md": MONTH_FIRST}
    if letters not in orders:
        raise ValueError(
            f"--time-format: {text!r}, expected e.g. '%d/%m/%Y %H:%M:%S' or '%m/%d/%Y %I:%M:%S %p'"
        )
    return orders[letters]
