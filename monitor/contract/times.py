"""Times: integer nanoseconds since 1970 (UTC) inside, ISO 8601 with Z outside."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

EARLIEST, LATEST = 86_400 * 10**9, 9_200_000_000 * 10**9
"""Times outside are no times: 1970 is a gateway's zero, and int64 nanoseconds end in 2262 [ns]."""


def seconds_to_ns(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Epoch seconds to ns, rounded to the microsecond that a float can hold; 0 where they are none.

    Examples
    --------
    >>> seconds_to_ns(np.array([1.5, np.nan]))
    array([1500000000,          0])
    """
    usable = np.isfinite(seconds) & (np.abs(seconds) < LATEST * 1e-9)
    return np.round(np.where(usable, seconds, 0.0) * 1e6).astype(np.int64) * 1000


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


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
        when = datetime.fromisoformat(value)
        when = when.replace(tzinfo=UTC) if when.tzinfo is None else when
        delta = when - EPOCH
        time = ((delta.days * 86_400 + delta.seconds) * 1_000_000 + delta.microseconds) * 1000
        return time if abs(time) <= LATEST else 0
    # as `seconds_to_ns`, at a tenth of its cost
    return round(value * 1e6) * 1000 if math.isfinite(value) and abs(value) < LATEST * 1e-9 else 0


def iso(time: int) -> str:
    """Return a time [ns since 1970] as ISO 8601 with Z.

    Examples
    --------
    >>> iso(1_795_341_600_250_000_000)
    '2026-11-22T10:00:00.250000Z'
    """
    return str(np.datetime_as_string(np.datetime64(time, "ns"), unit="us")) + "Z"


def nanoseconds(iso: object) -> int | None:
    """ISO time with zone (without: UTC) as [ns since 1970]; None where it is no time."""
    try:
        moment = datetime.fromisoformat(iso) if isinstance(iso, str) else None
    except ValueError:
        return None
    if moment is None:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return round(moment.timestamp() * 1e6) * 1000
