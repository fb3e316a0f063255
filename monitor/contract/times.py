"""Times: integer nanoseconds since 1970 (UTC) inside, ISO 8601 with Z outside."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta, tzinfo
from typing import Literal

import numpy as np
from numpy.typing import NDArray

EARLIEST_NS, LATEST_NS = 86_400 * 10**9, 9_200_000_000 * 10**9
"""Times outside are no times: 1970 is a gateway's zero, and int64 nanoseconds end in 2262 [ns]."""


def seconds_to_ns(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Epoch seconds to ns, rounded to the microsecond that a float can hold; 0 where they are none.

    Examples
    --------
    >>> seconds_to_ns(np.array([1.5, np.nan]))
    array([1500000000,          0])
    """
    usable = np.isfinite(seconds) & (np.abs(seconds) < LATEST_NS * 1e-9)
    return np.round(np.where(usable, seconds, 0.0) * 1e6).astype(np.int64) * 1000


UNIT_NS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""[ns]"""
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def ns_of(when: datetime, zone: tzinfo = UTC) -> int:
    """Return a moment [ns since 1970], exactly; one that names no zone is read in ``zone``."""
    delta = (when.replace(tzinfo=zone) if when.tzinfo is None else when) - EPOCH
    return ((delta.days * 86_400 + delta.seconds) * 1_000_000 + delta.microseconds) * 1000


def instant(text: str, zone: tzinfo = UTC) -> int:
    """Return the time [ns since 1970] that ISO text says; without a zone of its own, in ``zone``.

    Raises
    ------
    ValueError
        Text that is no time.

    Examples
    --------
    >>> instant("1970-01-01T00:00:01.5Z")
    1500000000
    >>> instant("1969-12-31T23:59:58.5+00:00")
    -1500000000
    """
    return ns_of(datetime.fromisoformat(text), zone)


def given_time(text: str, zone: tzinfo = UTC) -> int:
    """Return the time [ns since 1970] that a user gives: ISO text, or seconds since 1970.

    What integer nanoseconds cannot hold is the last, or the first, time that they can.

    Raises
    ------
    ValueError
        Text that is no time.

    Examples
    --------
    >>> given_time("2.5"), given_time("1970-01-01 00:00:02.5")
    (2500000000, 2500000000)
    """
    try:
        seconds = float(text)
    except ValueError:
        return min(max(instant(text, zone), -LATEST_NS), LATEST_NS)
    if not math.isfinite(seconds):
        raise ValueError(f"{text!r} is no time")
    return round(min(max(seconds, -LATEST_NS * 1e-9), LATEST_NS * 1e-9) * 1e6) * 1000


def time_of(value: float | str | None, default: int) -> int:
    """Return the time of a sample [ns]: ISO text (naive = UTC), epoch seconds, else the default; 0 out of range.

    Raises
    ------
    ValueError
        Text that is no time.

    Examples
    --------
    >>> time_of("2026-11-22T10:00:00.250Z", default=0)
    1795341600250000000
    >>> time_of(1.5, default=0)
    1500000000
    >>> time_of(None, default=7)  # the time of arrival, say
    7
    """
    if value is None:
        return default
    if isinstance(value, str):
        time = instant(value)
        return time if abs(time) <= LATEST_NS else 0
    # as `seconds_to_ns`, at a tenth of its cost
    return round(value * 1e6) * 1000 if math.isfinite(value) and abs(value) < LATEST_NS * 1e-9 else 0


def nanoseconds(text: object) -> int | None:
    """Return the time [ns since 1970] of a record's ISO text; None where it is no time."""
    try:
        return instant(text) if isinstance(text, str) else None
    except ValueError:
        return None


def iso(time: int, unit: Literal["ms", "us", "ns"] = "us") -> str:
    """Return a time [ns since 1970] as ISO 8601 with Z, as finely as ``unit`` says.

    Examples
    --------
    >>> iso(1_500_000_000)
    '1970-01-01T00:00:01.500000Z'
    """
    return str(np.datetime_as_string(np.datetime64(time, "ns"), unit=unit)) + "Z"


RELATIVE_NS = 10**17
"""Times below it are counted from a start, not from 1970 [ns]."""


def in_words(time: int) -> str:
    """Say a time [ns since 1970] to the minute, with its day of the week; of times that count from a start, the second.

    Examples
    --------
    >>> in_words(1_795_486_200 * 10**9)
    'Tuesday 2026-11-24, 02:10 UTC'
    >>> in_words(90 * 10**9)
    'second 90'
    """
    if abs(time) < RELATIVE_NS:
        return f"second {time * 1e-9:.0f}"
    return f"{EPOCH + timedelta(microseconds=time // 1000):%A %Y-%m-%d, %H:%M} UTC"
