"""What the view knows of the loops, and which of them it shows. Pure: neither Zenoh nor Rerun, no clock."""

from __future__ import annotations

from collections import Counter

import numpy as np

from monitor.contract.danger import TO_RETUNE, danger, kind_of, worst_first
from monitor.contract.evidence import Fleet
from monitor.contract.fleet import ci_and_ms

from .pages import Row, as_record

SHOWN_LOOPS = 12
"""Loops with charts of their own: more tabs than this nobody looks at."""
SWAP_SHARE = 0.8
"""A loop takes another's place only when it is this much worse: tabs must not flicker."""
Rank = tuple[int, float, str]
"""As `worst_first` has it: danger, index, name."""


class Selection:
    """The loops as the monitor sees them, and which of them are shown."""

    def __init__(self, most: int = SHOWN_LOOPS) -> None:
        self.rows: dict[str, Row] = {}
        """Rows of the loops that need somebody, and of the pinned one."""
        self.keys: dict[str, str] = {}
        """Their loop keys."""
        self.pinned: str | None = None
        """A loop that is shown whatever its verdict."""
        self.shown: list[str] = []
        self._kinds: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._places: dict[str, tuple[float, float]] = {}
        """CI and Ms of the loops that have both."""
        self._ranks: dict[str, Rank] = {}
        """Of the rows' loops."""
        self._ranked: list[str] | None = None
        self._most = most
        self.moved = False
        """Whether a loop has moved in the picture of the fleet; whoever has drawn it says that it has not."""

    @property
    def placed(self) -> int:
        """Loops in the picture of the fleet."""
        return len(self._places)

    def put(self, row: Row, key: str) -> None:
        """Take over a loop's current row.

        Raises
        ------
        msgspec.ValidationError
            It is none.
        """
        record = as_record(row)
        name, kind, place = record.loop, kind_of(record), ci_and_ms(record)
        self.moved |= place != self._places.get(name) or (place is not None and kind != self._kinds.get(name))
        if place is None:
            self._places.pop(name, None)
        else:
            self._places[name] = place
        self._counts[self._kinds.get(name, "")] -= 1
        self._counts[kind] += 1
        self._kinds[name] = kind
        if danger(record) <= TO_RETUNE or name == self.pinned:
            self.rows[name], self.keys[name], self._ranks[name] = dict(row), key, worst_first(record)
        elif name in self.rows:
            del self.rows[name], self.keys[name], self._ranks[name]
        else:
            return
        self._ranked = None

    def counts(self) -> dict[str, int]:
        """Loops by kind."""
        return {kind: n for kind, n in self._counts.items() if n > 0}

    def flagged(self) -> list[Row]:
        """Rows of the loops that need somebody, the most dangerous first."""
        return [self.rows[name] for name in self._order()]

    def fleet(self) -> Fleet:
        """Return the loops that have a place in the picture of the fleet, the most dangerous first."""
        first = [name for name in self._order() if name in self._places]
        needing = set(first)
        names = [*first, *(name for name in self._places if name not in needing)]
        ci, ms = np.array([self._places[name] for name in names], dtype=np.float64).reshape(-1, 2).T
        return Fleet(names, [self._kinds[name] for name in names], ci, ms)

    def _order(self) -> list[str]:
        """Return the loops that need somebody, the most dangerous first."""
        if self._ranked is None:
            needing = (name for name, rank in self._ranks.items() if rank[0] <= TO_RETUNE)
            self._ranked = sorted(needing, key=self._ranks.__getitem__)
        return self._ranked

    def choose(self) -> bool:
        """Choose the loops to show; True where the choice has changed.

        A loop that is shown stays until it needs nobody any more, or another one is clearly worse.
        """
        ranked = self._order()
        known = set(ranked)
        stay = [name for name in self.shown if name in known or name == self.pinned]
        if self.pinned in self.rows and self.pinned not in stay:
            stay.insert(0, str(self.pinned))
        for name in ranked:
            if name in stay:
                continue
            if len(stay) < self._most:
                stay.append(name)
                continue
            mildest = max((n for n in stay if n != self.pinned), key=self._ranks.__getitem__, default=None)
            if mildest is None or not _clearly_worse(self._ranks[name], self._ranks[mildest]):
                break
            stay[stay.index(mildest)] = name
        stay.sort(key=lambda n: (n != self.pinned, self._ranks[n]))
        changed = set(stay) != set(self.shown)
        self.shown = stay
        return changed


def _clearly_worse(one: Rank, other: Rank) -> bool:
    return one[0] < other[0] or (one[0] == other[0] and one[1] < SWAP_SHARE * other[1])


def as_row(assessment: Row) -> Row:
    """Build a loop's row of one event alone, for an event whose loop has none."""
    index = "ci_load" if assessment.get("kind") == "load" else "ci_setpoint"
    return {**assessment, index: assessment.get("ci")}
