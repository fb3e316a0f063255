"""A file's times to nanoseconds since 1970 UTC: units of numbers, local time and its two bad hours a year."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
from numpy.typing import NDArray

from monitor.contract.times import UNIT_NS

Ns = NDArray[np.int64]

EXCEL = "excel"
OPTION = "--time-unit s|ms|us|ns|excel"

OLDEST_S, NEWEST_S = 315_532_800.0, 7_258_118_400.0
"""[s] 1980 to 2200: a time of day lies in it. Seconds, ms, us and ns of that span do not overlap."""
EXCEL_OLDEST_DAYS, EXCEL_NEWEST_DAYS = 32_874.0, 73_051.0
"""[days] 1990 to 2100 as a spreadsheet counts."""
EXCEL_EPOCH_DAYS = 25_569
"""[days] from a spreadsheet's day 0, 1899-12-30, to 1970-01-01."""
EXCEL_STEP_DAYS = 0.005
"""[days] (7 min) a spreadsheet's step is shorter; seconds that far from 0 come in steps of 1 s or more."""
DAY_FIRST, MONTH_FIRST, YEAR_FIRST = "day/month/year", "month/day/year", "year/month/day"
_OLDEST_NS, _NEWEST_NS = int(OLDEST_S) * 10**9, int(NEWEST_S) * 10**9
_INT64 = float(np.iinfo(np.int64).max)


@dataclass(frozen=True, slots=True)
class Clock:
    """How a file tells time."""

    kind: str
    """``timestamp``, ``text`` or ``number``."""
    unit: str = "ns"
    """Of numbers: a key of `UNIT_NS`, or ``excel``."""
    naive: bool = False
    """Local time, to be read in the zone that the user names."""
    order: str = ""
    """Of day and month in a text with slashes: `DAY_FIRST` or `MONTH_FIRST`; empty for text that needs none."""
    fields: bool = False
    """Of a text: read field by field (`time_formats`), for it is none that a plain cast takes."""
    epoch: bool = True
    """Times of day: what lies before 1980 or after 2200 is not a time. False: seconds from some start."""

    @property
    def numeric(self) -> bool:
        """Results carry times as seconds, like the input."""
        return self.kind == "number" and self.unit != EXCEL


def clock_of_numbers(values: NDArray[Any], unit: str | None = None) -> Clock:
    """Tell the unit of numeric times by their range and step.

    Parameters
    ----------
    values
        (N,) the file's first times, in its own unit.
    unit
        What the user says it is.

    Raises
    ------
    ValueError
        Units are mixed, or seconds and a spreadsheet's days cannot be told apart.
    """
    t = np.asarray(values, dtype=np.float64)
    t = t[np.isfinite(t)]
    if unit == EXCEL:
        return Clock("number", EXCEL, naive=True)
    if unit is not None:
        return Clock("number", unit, epoch=_is_epoch(t * (UNIT_NS[unit] / 1e9)))
    if not len(t):
        raise ValueError("time: no number in it, expected timestamps, ISO text or numeric seconds")
    found = {u: int(np.sum(_within(t, u))) for u in UNIT_NS}
    units = [u for u, n in found.items() if n]
    if len(units) > 1:
        raise ValueError(
            f"time: {' and '.join(units)} since 1970 mixed, expected one unit; name it by {OPTION}"
        )
    if units and 2 * found[units[0]] >= len(t):
        return Clock("number", units[0])
    if np.max(np.abs(t)) >= OLDEST_S:
        far = t[np.argmax(np.abs(t))]
        raise ValueError(
            f"time: {far:.17g}, expected a time from 1980 to 2200 or seconds from 0; see {OPTION}"
        )
    if np.all((t >= EXCEL_OLDEST_DAYS) & (t <= EXCEL_NEWEST_DAYS)):
        return _days_or_seconds(t)
    return Clock("number", "s", epoch=False)


def _within(t: NDArray[np.float64], unit: str) -> NDArray[np.bool_]:
    seconds = t * (UNIT_NS[unit] / 1e9)
    out: NDArray[np.bool_] = (seconds >= OLDEST_S) & (seconds <= NEWEST_S)
    return out


def _is_epoch(seconds: NDArray[np.float64]) -> bool:
    return len(seconds) > 0 and bool(np.median(seconds) >= OLDEST_S)


def _days_or_seconds(t: NDArray[np.float64]) -> Clock:
    """Tell a spreadsheet's days from seconds since some start by the step."""
    steps = np.abs(np.diff(np.unique(t)))
    if len(steps) and np.median(steps) <= EXCEL_STEP_DAYS and np.ptp(t) < 366:
        return Clock("number", EXCEL, naive=True)
    if len(steps) and np.median(steps) >= 0.999:
        return Clock("number", "s", epoch=False)
    raise ValueError(f"time: {t[0]:.17g} may be seconds or a spreadsheet's days; say which by {OPTION}")


def numbers_to_ns(values: NDArray[Any], clock: Clock) -> tuple[Ns, NDArray[np.bool_]]:
    """Convert numeric times: whole numbers exactly, others to the microsecond that a float of today can hold.

    Returns
    -------
    time, good
        (N,) [ns]; where not ``good`` the number is no time (not finite, 0 or 1900 among times of day).

    Raises
    ------
    ValueError
        Times of another unit are among them.
    """
    if values.dtype.kind in "iu" and clock.unit != EXCEL:
        scale = UNIT_NS[clock.unit]
        good = np.abs(values.astype(np.float64)) < _INT64 / scale
        ns = np.where(good, values, 0).astype(np.int64) * scale
    else:
        t = np.asarray(values, dtype=np.float64)
        if clock.unit == EXCEL:
            # a spreadsheet's double holds today to a microsecond, and shows milliseconds: round to those
            us = np.rint((t - EXCEL_EPOCH_DAYS) * 86_400e3) * 1e3
        else:
            us = np.round(t * (UNIT_NS[clock.unit] / 1e3))
        good = np.abs(us) < _INT64 / 1e3
        ns = np.where(good, us, 0.0).astype(np.int64) * 1000
    if not clock.epoch:
        if len(ns) and ns.max() >= OLDEST_S * 1e9:
            raise ValueError(f"time: seconds from a start and since 1970 mixed; see {OPTION}")
        return ns, good
    good &= plausible(ns, clock)
    if not good.all() and clock.unit != EXCEL:
        # what is no time in this unit, but in another, betrays a mixture
        rest = np.asarray(values, dtype=np.float64)[~good]
        for unit in UNIT_NS:
            if unit != clock.unit and _within(rest, unit).any():
                raise ValueError(f"time: {clock.unit} and {unit} since 1970 mixed, expected one unit")
    return ns, good


def plausible(ns: Ns, clock: Clock) -> NDArray[np.bool_]:
    """Mark the times of day that lie between 1980 and 2200; all, where times count from some start."""
    if not clock.epoch or not len(ns) or (ns.min() >= _OLDEST_NS and ns.max() <= _NEWEST_NS):
        return np.ones(len(ns), np.bool_)
    return np.asarray((ns >= _OLDEST_NS) & (ns <= _NEWEST_NS))


# ---------------------------------------------------------------------------------------------------
# local time


def zone_of(name: str) -> ZoneInfo | None:
    """Return a time zone; None for UTC.

    Raises
    ------
    ValueError
        There is no zone of that name.
    """
    if name.upper() in {"UTC", "Z", "GMT", "ETC/UTC"}:
        return None
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ValueError(f"--tz: {name!r}, expected the name of a zone, e.g. Europe/Berlin") from None


def to_utc(local: Ns, loop: NDArray[np.int32], zone: ZoneInfo) -> Ns:
    """Read local times as UTC; the hour that a change of the clocks repeats is told apart by order.

    Parameters
    ----------
    local
        (N,) [ns] in the file's order.
    loop
        (N,) whose time it is: each loop's rows have their own order.

    Raises
    ------
    MissingHourError
        A time that the zone skipped.
    """
    import pandas as pd  # noqa: PLC0415 (half a second; only where a zone is given)

    index = pd.DatetimeIndex(local.view("M8[ns]"))
    summer = np.ones(len(local), np.bool_)
    first = index.tz_localize(zone, ambiguous=summer, nonexistent="NaT")
    missing = np.flatnonzero(np.asarray(first.isna()))
    if len(missing):
        raise MissingHourError(int(missing[0]), f"{index[missing[0]]} does not exist in {zone.key}")
    utc = _ns(first)
    second = _ns(index.tz_localize(zone, ambiguous=~summer, nonexistent="NaT"))
    twice = np.flatnonzero(utc != second)
    if len(twice):
        for code in np.unique(loop[twice]):
            rows = np.flatnonzero(loop == code)
            utc[rows] = _fold(local[rows], utc[rows], second[rows])
    return utc


def _ns(index: Any) -> Ns:
    return np.array(index.tz_convert("UTC").tz_localize(None).as_unit("ns").asi8, dtype=np.int64)


class MissingHourError(ValueError):
    """A local time that its zone skipped; ``row`` is the first such row."""

    def __init__(self, row: int, reason: str) -> None:
        super().__init__(reason)
        self.row, self.reason = row, reason


def _fold(local: Ns, first: Ns, second: Ns) -> Ns:
    """Decide for one loop's rows in file order which of the repeated hour's two times is meant."""
    if local[0] > local[-1]:  # newest first
        return _fold(local[::-1], first[::-1], second[::-1])[::-1]
    out = first.copy()
    twice = first != second
    edges = np.flatnonzero(np.diff(np.concatenate([[0], twice.astype(np.int8), [0]])))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        back = np.flatnonzero(np.diff(local[start:end]) < 0)
        if len(back):
            out[start + back[0] + 1 : end] = second[start + back[0] + 1 : end]
            continue
        # passed once: it belongs to the side on which the rows go on without an hour's gap
        before = first[start] - first[start - 1] if start else np.iinfo(np.int64).max
        after = second[end] - second[end - 1] if end < len(local) else np.iinfo(np.int64).max
        if after < before:
            out[start:end] = second[start:end]
    return out
