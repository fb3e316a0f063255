"""Whether a loop was retuned between two audits: by the loop table, and by the controller that the data show."""

from __future__ import annotations

import json
import math
from typing import NamedTuple

from monitor.contract.changes import KEPT, RETUNED, UNKNOWN
from monitor.contract.records import LoopRow

NAMES = {"kp": "", "ti": " s", "td": " s"}
"""Settings that are compared, with the unit of a time."""
TYPED_RATIO = 1.02
"""Up to which two settings of a table are one: what is typed is rounded."""
SEEN_RATIO = 1.15
"""Up to which two that the data show are one, even where their intervals do not meet: those say nothing of what else
has changed."""


class SettingsChange(NamedTuple):
    """What became of a loop's settings."""

    state: str
    """`RETUNED`, `KEPT` or `UNKNOWN`."""
    words: str
    as_suggested: bool
    """Whether those of now are what the earlier audit suggested."""


def settings_change(before: LoopRow, after: LoopRow) -> SettingsChange:
    """Return whether a loop was retuned. Where table and data contradict each other, the data count, and it is said."""
    table, seen = _by_table(before, after), _by_data(before, after)
    if seen is not None and table is not None and seen != table:
        moved = _moved(before, after, "_seen") if seen else _moved(before, after, "")
        said = (
            f"the data show {moved}; the loop table was not brought up to date"
            if seen
            else f"the loop table says {moved}, the data still show the old ones: were they typed in?"
        )
        return SettingsChange(RETUNED if seen else KEPT, said, False)
    retuned = table if table is not None else seen
    if retuned is None:
        retuned = _mixed(before, after)
    if retuned is None:
        return SettingsChange(UNKNOWN, "settings not known in both", False)
    if not retuned:
        return SettingsChange(
            KEPT, f"{_words(after, '' if after.kp is not None else '_seen')}, as before", False
        )
    end = "" if None not in (before.kp, after.kp) else "_seen"
    suggested = before.new_kp is not None and all(
        _alike(getattr(before, f"new_{n}"), getattr(after, n), SEEN_RATIO) for n in NAMES
    )
    source = "" if table is not None else " (as the data show)"
    return SettingsChange(RETUNED, f"{_moved(before, after, end)}{source}", suggested)


def way_back(row: LoopRow) -> str:
    """Return a loop's settings as one types them: the fields of its block where they are known."""
    if row.fields:
        fields = {n: v for n, v in json.loads(row.fields).items() if n not in ("note", "unavailable")}
        return ", ".join(
            f"{n} = {v:.4g}" if isinstance(v, float) else f"{n} = {v}" for n, v in fields.items()
        )
    return _words(row, "" if row.kp is not None else "_seen")


def _by_table(before: LoopRow, after: LoopRow) -> bool | None:
    if not before.settings_source == after.settings_source == "table":
        return None
    return not all(_alike(getattr(before, n), getattr(after, n), TYPED_RATIO) for n in NAMES)


def _by_data(before: LoopRow, after: LoopRow) -> bool | None:
    """Whether the data show other settings; None where they do not show them in both."""
    if before.kp_seen is None or after.kp_seen is None:
        return None
    return any(_apart(before, after, name) for name in NAMES)


def _apart(before: LoopRow, after: LoopRow, name: str) -> bool:
    ends = [(getattr(r, f"{name}_seen_lo"), getattr(r, f"{name}_seen_hi")) for r in (before, after)]
    if any(end is None for pair in ends for end in pair):
        return False
    meet = ends[0][0] <= ends[1][1] and ends[1][0] <= ends[0][1]
    return not meet and not _alike(
        getattr(before, f"{name}_seen"), getattr(after, f"{name}_seen"), SEEN_RATIO
    )


def _mixed(before: LoopRow, after: LoopRow) -> bool | None:
    """Whether settings of a table differ from those that the data show in the other audit."""
    if before.kp is None or after.kp is None:
        return None
    return not all(_alike(getattr(before, n), getattr(after, n), SEEN_RATIO) for n in NAMES)


def _alike(one: float | None, other: float | None, ratio: float) -> bool:
    """Whether two settings are the same; no integral action is None or inf, no derivative action None or 0."""
    x, y = (0.0 if v is None or math.isinf(v) else v for v in (one, other))
    if x == 0.0 or y == 0.0:
        return x == y
    return x * y > 0.0 and 1.0 / ratio <= x / y <= ratio


def _moved(before: LoopRow, after: LoopRow, end: str) -> str:
    pairs = [(n, getattr(before, f"{n}{end}"), getattr(after, f"{n}{end}")) for n in NAMES]
    return ", ".join(
        f"{n} {_figure(n, x)} → {_figure(n, y)}{NAMES[n]}"
        for n, x, y in pairs
        if not _alike(x, y, TYPED_RATIO)
    )


def _words(row: LoopRow, end: str) -> str:
    values = {n: getattr(row, f"{n}{end}") for n in NAMES}
    return ", ".join(f"{n} = {_figure(n, v)}{NAMES[n]}" for n, v in values.items() if n != "td" or v)


def _figure(name: str, value: float | None) -> str:
    if value is None or math.isinf(value):
        return "none" if name == "ti" else "0"
    return f"{value:.4g}"
