"""What the view knows of the loops, and which of them it shows. Pure: neither Zenoh nor Rerun, no clock."""

from __future__ import annotations

from collections import Counter

from .pages import Row, indices, is_number

SHOWN_LOOPS = 12
"""Loops with charts of their own: more tabs than this nobody looks at."""
SWAP_SHARE = 0.8
"""A loop takes another's place only when it is this much worse: tabs must not flicker."""
CI_LIMIT, MS_LIMIT = 0.6, 2.75
"""Where a loop is flagged by the table's defaults."""


class Selection:
    """The loops as the monitor sees them, and which of them are shown."""

    def __init__(self, most: int = SHOWN_LOOPS) -> None:
        self.rows: dict[str, Row] = {}
        """Rows of the flagged loops, and of the pinned one."""
        self.keys: dict[str, str] = {}
        """Their loop keys."""
        self.pinned: str | None = None
        """A loop that is shown whatever its verdict."""
        self.shown: list[str] = []
        self._verdicts: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._ranked: list[Row] | None = None
        self._most = most

    def put(self, row: Row, key: str) -> None:
        """Take over a loop's current row."""
        name, verdict = str(row["loop"]), str(row.get("verdict"))
        self._counts[self._verdicts.get(name, "")] -= 1
        self._counts[verdict] += 1
        self._verdicts[name] = verdict
        if verdict == "retune" or name == self.pinned:
            self.rows[name], self.keys[name] = dict(row), key
        elif name in self.rows:
            del self.rows[name], self.keys[name]
        else:
            return
        self._ranked = None

    def counts(self) -> dict[str, int]:
        """Loops by verdict."""
        return {verdict: n for verdict, n in self._counts.items() if n > 0}

    def flagged(self) -> list[Row]:
        """Rows of the flagged loops, worst first."""
        if self._ranked is None:
            self._ranked = sorted(
                (row for row in self.rows.values() if row.get("verdict") == "retune"), key=severity
            )
        return self._ranked

    def choose(self) -> bool:
        """Choose the loops to show; True where the choice has changed.

        A loop that is shown stays until it is no longer flagged, or another one is clearly worse.
        """
        ranked = self.flagged()
        by_name = {str(row["loop"]): severity(row) for row in ranked}
        stay = [name for name in self.shown if name in by_name or name == self.pinned]
        if self.pinned in self.rows and self.pinned not in stay:
            stay.insert(0, str(self.pinned))
        for name in (str(row["loop"]) for row in ranked if row["loop"] not in stay):
            if len(stay) < self._most:
                stay.append(name)
                continue
            mildest = max((n for n in stay if n != self.pinned), key=lambda n: by_name[n], default=None)
            if mildest is None or by_name[name] >= SWAP_SHARE * by_name[mildest]:
                break
            stay[stay.index(mildest)] = name
        stay.sort(key=lambda n: by_name.get(n, -1.0))
        changed = set(stay) != set(self.shown)
        self.shown = stay
        return changed


def severity(row: Row) -> float:
    """How bad a loop is, 0 the worst: its CI and its Ms against the limits' defaults, whichever is worse."""
    ms = row.get("ms")
    robust = MS_LIMIT / ms if is_number(ms) and ms > 0 else 1.0
    return min([robust, *(max(ci, 0.0) / CI_LIMIT for ci in indices(row))])


def as_row(assessment: Row) -> Row:
    """Build a loop's row of one event alone, for an event whose loop has none."""
    index = "ci_load" if assessment.get("kind") == "load" else "ci_setpoint"
    return {**assessment, index: assessment.get("ci")}
