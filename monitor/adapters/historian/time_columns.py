"""Which column of an export is its time: one for all, date and time of day apart, or one before each tag."""

from __future__ import annotations

from collections.abc import Sequence

from .cell_kinds import CLOCK, NUMBER, TIME
from .layout import NEEDED, NotUnderstoodError, is_time_heading
from .look import HELP, Look
from .tag_roles import read_tag


def time_columns(look: Look) -> tuple[str, str]:
    """Return the headings of the time, and of the time of day where it stands apart."""
    given = look.given
    if given.time:
        lacking = [h for h in given.time if h not in look.headings]
        if lacking:
            raise ValueError(f"no column {lacking[0]!r}, which the mapping names as the time")
        return given.time[0], given.time[1] if len(given.time) > 1 else ""
    named = [h for h in look.headings if is_time_heading(h)]
    dates = [h for h in look.headings if look.kinds[h] == TIME]
    clocks = [h for h in look.headings if look.kinds[h] == CLOCK]
    if clocks and dates and not any(":" in cell for cell in look.cells[dates[0]][:1]):
        if len(dates) > 1 or len(clocks) > 1:
            raise ValueError(f"several dates or times of day ({', '.join([*dates, *clocks])}); {HELP}")
        return dates[0], clocks[0]
    best = [h for h in named if h in dates] or dates
    if best:
        source = [h for h in best if "source" in h.lower()]
        return (source or best)[0], ""
    numbers = [h for h in named if look.kinds[h] == NUMBER]
    if numbers:
        return numbers[0], ""
    if look.headings and look.kinds[look.headings[0]] == NUMBER and look.headings[0].startswith("column "):
        return look.headings[0], ""
    raise NotUnderstoodError(
        f"no column of times among {', '.join(h[:40] for h in look.headings[:8])}; expected e.g. `time` with "
        f"2026-11-22T10:00:00; {HELP}"
    )


def own_times(look: Look, times: Sequence[str]) -> dict[str, str]:
    """Return each value's own time where every tag has one before it (compressed values of a spreadsheet's add-in).

    Parameters
    ----------
    times
        Headings of times beside the first one.
    """
    out: dict[str, str] = {}
    time = ""
    for heading in look.headings:
        if look.kinds[heading] == TIME:
            time = heading
        elif time and (tag := read_tag(heading)) is not None and tag.role:
            out[heading] = time
    different = set(out.values())
    return out if len(different) == len(out) >= len(NEEDED) and different >= set(times) else {}
