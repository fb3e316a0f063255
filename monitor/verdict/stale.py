"""When a loop is stale, and what its row says where no good samples come, or come no more: live and in the audit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from monitor.contract.records import NOT_ASSESSED, LoopRow
from monitor.contract.times import in_words

Seconds = float | NDArray[np.floating[Any]]

STALE = "stale"
"""The flag."""
SILENT_PERIODS = 3.0
"""Sample periods without a good sample after which a loop is stale, at the earliest."""
EXPORT_SHARE = 0.01
"""Share of an export's time for which a loop may be silent at its end: a historian that writes what changes is
silent for a while."""


@dataclass(frozen=True, slots=True)
class Patience:
    """For how long a silence is none, however fast the loop is sampled."""

    least: float
    """[s]"""
    unknown: float
    """While the loop's period is not known [s]."""


LIVE = Patience(least=10.0, unknown=600.0)


def patience_of_export(first: int, end: int) -> Patience:
    """Return how long a loop may be silent at the end of an export from ``first`` to ``end`` [ns], an hour at least.

    All loops' samples must end together, whether their period is known or not.
    """
    least = max(3600.0, EXPORT_SHARE * (end - first) * 1e-9)
    return Patience(least, unknown=least)


def is_stale(silence: Seconds, period: Seconds, patience: Patience) -> NDArray[np.bool_]:
    """Whether loops are stale.

    Parameters
    ----------
    silence
        From the last good sample to now: the newest sample's time, or a clock's [s].
    period
        Of the samples [s]; 0 where it is not known.

    Examples
    --------
    >>> is_stale(silence=np.array([5.0, 40.0]), period=np.array([1.0, 10.0]), patience=LIVE)
    array([False,  True])
    """
    least = np.maximum(SILENT_PERIODS * np.asarray(period), patience.least)
    return np.asarray(silence > np.where(np.asarray(period) > 0, least, patience.unknown))


class LastSample(msgspec.Struct, frozen=True):
    """How a loop's samples ended."""

    time: int
    """Of the last good one [ns since 1970]."""
    period: float
    """[s]; 0 where it is not known."""
    good: int
    bad_value: int
    bad_quality: int
    bad_run: int
    """Bad ones since the last good one."""


class LastSamples(NamedTuple):
    """The same of all loops, in columns (L,)."""

    time: NDArray[np.int64]
    period: NDArray[np.float64]
    good: NDArray[np.int64]
    bad_value: NDArray[np.int64]
    bad_quality: NDArray[np.int64]
    bad_run: NDArray[np.int64]


def mark_stale(row: LoopRow, last: LastSample, stale: bool) -> LoopRow:
    """Return a row with what is to be said of silence.

    Parameters
    ----------
    stale
        It is silent for too long (`is_stale`).
    """
    if last.good == 0:
        if row.verdict != NOT_ASSESSED:
            return row
        return msgspec.structs.replace(row, reason=f"no data: {_nothing(last)}")
    if not stale:
        return row
    said = f"nothing but bad samples ({last.bad_run})" if last.bad_run else "no sample"
    said = f"{said} since {in_words(last.time)}"
    order = (said, row.reason) if row.verdict == NOT_ASSESSED else (row.reason, said)
    reason = "; ".join(filter(None, order))
    return msgspec.structs.replace(row, flags=(*row.flags, STALE), reason=reason)


def _nothing(last: LastSample) -> str:
    """Say why there is no good sample."""
    bad = last.bad_quality + last.bad_value
    if bad == 0:
        return "no sample was seen"
    cause = "quality" if last.bad_quality >= last.bad_value else "no number, or out of range"
    mixed = last.bad_quality and last.bad_value
    return f"all {bad} samples were bad ({'most: ' if mixed else ''}{cause})"
