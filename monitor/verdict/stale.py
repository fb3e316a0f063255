"""What a loop's row says where no good samples come, or come no more; the same words live and in the audit."""

from __future__ import annotations

from typing import Any

import msgspec

from monitor.contract.records import NOT_ASSESSED, LoopRow

STALE = "stale"
"""The flag."""


class Last(msgspec.Struct, frozen=True):
    """How a loop's samples ended."""

    time: int
    """Of the last good one [ns since 1970]."""
    period: float
    """[s]; 0 where it is not known."""
    good: int
    bad_value: int
    bad_quality: int
    spoilt: int
    """Bad ones since the last good one."""


def last_of(state: Any) -> Last:
    """Read it from a loop's state (dtype `STATE`)."""
    counts = (int(state[n]) for n in ("ok", "bad_value", "bad_quality", "spoilt"))
    return Last(int(state["time"]), float(state["period"]), *counts)


def tell(row: LoopRow, last: Last, when: str | None) -> LoopRow:
    """Write into a row what is to be said of silence; the row is changed and returned.

    Parameters
    ----------
    when
        The time of the last good sample, in words, of a loop that is stale; None: it is not.
    """
    if last.good == 0:
        if row.verdict == NOT_ASSESSED:
            row.reason = f"no data: {_nothing(last)}"
        return row
    if when is None:
        return row
    said = f"nothing but bad samples ({last.spoilt})" if last.spoilt else "no sample"
    said = f"{said} since {when}"
    row.flags = (*row.flags, STALE)
    order = (said, row.reason) if row.verdict == NOT_ASSESSED else (row.reason, said)
    row.reason = "; ".join(filter(None, order))
    return row


def _nothing(last: Last) -> str:
    """Say why there is no good sample."""
    bad = last.bad_quality + last.bad_value
    if bad == 0:
        return "no sample was seen"
    cause = "quality" if last.bad_quality >= last.bad_value else "no number, or out of range"
    mixed = last.bad_quality and last.bad_value
    return f"all {bad} samples were bad ({'most: ' if mixed else ''}{cause})"
