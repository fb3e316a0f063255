"""Which loops of an export have fallen silent, and since when: seen against where the others end."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from monitor.contract.records import LoopRow
from monitor.verdict.stale import LastSample, is_stale, mark_stale, patience_of_export

from .tasks import Part


def end_of_most(last: Iterable[Mapping[str, LastSample]]) -> int:
    """Return where the good samples of half of the loops or more have not ended yet [ns]; 0 where there are none.

    One loop that goes on alone, or whose clock is wrong, makes no others silent.
    """
    ends = sorted(sample.time for loops in last for sample in loops.values() if sample.good > 0)
    return ends[len(ends) // 2] if ends else 0


@dataclass(frozen=True, slots=True)
class Silence:
    """Where an export begins, and where most of its loops end [ns]."""

    first: int
    end: int

    def rows(self, part: Part) -> list[LoopRow]:
        """Return a part's rows, marked where a loop's good samples end well before those of the others."""
        patience, rows = patience_of_export(self.first, self.end), []
        for row in part.rows:
            last = part.last[row.loop]
            stale = is_stale((self.end - last.time) * 1e-9, last.period, patience)
            rows.append(mark_stale(row, last, bool(stale)))
        return rows
