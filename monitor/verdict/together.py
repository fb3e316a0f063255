"""Loops that cycle together: one finding, with the loop to look at first.

One cycle travels through a plant and shows in every loop that it passes, at the same period. Where it is largest
against the loop's own noise it is nearest to its source, or amplified by a loop: either is where to look first (after
N. F. Thornhill, A. Horch, Control Eng. Practice 15 (2007) 1196-1206, on plant-wide disturbances).
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from monitor.contract.records import LoopRow
from monitor.contract.text import duration

SAME_PERIOD_SHARE = 0.05
"""Difference of two periods up to which they are one."""
MOST_NAMED = 5
"""Loops that are named in a finding."""


def cycling_together(rows: Sequence[LoopRow]) -> list[LoopRow]:
    """Return the rows, in their order, each of a loop that cycles with others saying so.

    Parameters
    ----------
    rows
        Of all loops. Those whose flags say `oscillating` are compared by period and by the time of their cycles.
    """
    said = {}
    for group in _groups([row for row in rows if "oscillating" in row.flags and row.oscillation_period]):
        first, *others = sorted(group, key=lambda row: (-_over_noise(row), row.loop))
        more = f" and {len(group) - MOST_NAMED} more" if len(group) > MOST_NAMED else ""
        for row in group:
            beside = ", ".join([r.loop for r in (first, *others) if r is not row][:MOST_NAMED])
            cycle = f"cycles together with {beside}{more} (period {duration(row.oscillation_period or 0.0)})"
            look = "where the cycle is largest against its noise: look here first"
            look = (
                look if row is first else f"look at {first.loop} first, where it is largest against the noise"
            )
            said[row.loop] = replace(
                row, reason=f"{row.reason}; {cycle}; {look}" if row.reason else f"{cycle}; {look}"
            )
    return [said.get(row.loop, row) for row in rows]


def _groups(rows: list[LoopRow]) -> list[list[LoopRow]]:
    """Return groups of two loops or more whose periods follow each other closely and whose cycles overlap in time."""
    groups: list[list[LoopRow]] = []
    for row in sorted(rows, key=lambda r: (r.oscillation_period or 0.0, r.loop)):
        for group in groups:
            near = (row.oscillation_period or 0.0) <= (1.0 + SAME_PERIOD_SHARE) * (
                group[0].oscillation_period or 0.0
            )
            if near and any(_overlap(row, other) for other in group):
                group.append(row)
                break
        else:
            groups.append([row])
    return [group for group in groups if len(group) > 1]


def _overlap(one: LoopRow, other: LoopRow) -> bool:
    """Whether two loops cycled at the same time, as far as that is known."""
    times = (one.oscillation_start, one.oscillation_end, other.oscillation_start, other.oscillation_end)
    if any(time is None for time in times):
        return True
    a, b, c, d = (time or 0 for time in times)
    return a < d and c < b


def _over_noise(row: LoopRow) -> float:
    """Return the size of a loop's cycle over PV's noise; 0 where it is not known."""
    size = row.oscillation_amplitude or 0.0
    return size / max(row.noise or 0.0, row.quantum or 0.0, 1e-6 * size, 1e-300)
