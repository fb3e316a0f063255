"""Who has fallen silent, and who is given up: loops that send nothing, or nothing good, for three periods."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import LoopTable
from monitor.verdict.stale import LIVE, LastSamples, is_stale

from .journal import note

NEVER_GOOD_SAMPLES = 30
"""Bad ones of a loop without a single good one after which it counts as stale, too."""
RETIRE_AFTER_S = 30 * 86_400.0
"""Without a good sample, after which a loop that has registered itself is given up: a shutdown is shorter [s]."""
NEVER_HEARD_S = 600.0
"""After the start, when the loops of which nothing has come are named: a slow loop has sent by then [s]."""
NAMED_LOOPS = 20
"""In a line of the log, or a list of the status."""


class Staleness:
    """Looks at how long ago each loop's last good sample was."""

    def __init__(self, loops: LoopTable) -> None:
        self.stale: set[int] = set()
        """Loops that are stale, as of the last look."""
        self.silent = False
        """Whether all loops that were heard have fallen silent: not one of them, but the line to them."""
        self.never_heard: set[int] = set()
        """Loops of which nothing has come, as of the last look."""
        self._loops = loops
        self._name_unheard = NEVER_HEARD_S
        """Time after the first look at which the loops that were never heard are named [s]; inf once they are."""
        self._began: float | None = None
        """The first look [s, monotonic]."""
        self._registered: dict[int, float] = {}

    def look(
        self, last: LastSamples, arrival: NDArray[np.float64], newest: NDArray[np.int64], now: float
    ) -> bool:
        """Look at all loops; say what has changed, in a line, and whether the whole line has.

        Parameters
        ----------
        last
            How the loops' good samples ended.
        arrival, newest
            When each loop's newest sample came [s, monotonic], and its time, be its value usable or not [ns].
        now
            [s, monotonic]
        """
        seen = last.good > 0
        heard = seen | (last.bad_run >= NEVER_GOOD_SAMPLES)
        # what a clock says of the last good sample, and, for values out of range, what the samples' own times say
        behind = is_stale((newest - last.time) * 1e-9, last.period, LIVE)
        quiet = is_stale(now - arrival, last.period, LIVE) | ((last.bad_run > 0) & behind)
        found = set(np.flatnonzero(heard & (quiet | ~seen)).tolist())
        before, self.stale = self.stale, found
        self._look_for_unheard(heard, now)
        silent = bool(found) and len(found) == int(heard.sum())
        if silent != self.silent:  # said once, not for each loop
            self.silent = silent
            note("all_silent" if silent else "samples_back")
            return True
        if not silent:
            new = found - before
            bad = {k for k in new if last.bad_run[k] > 0}
            changes = (("loops_stale", new - bad), ("loops_bad", bad), ("loops_back", before - found))
            for code, rows in changes:
                if rows:
                    note(code, count=len(rows), loops=self._named(rows))
        return False

    def _look_for_unheard(self, heard: NDArray[np.bool_], now: float) -> None:
        """Note of which loops nothing has come; name them once."""
        self._began = now if self._began is None else self._began
        self.never_heard = set(np.flatnonzero(~heard).tolist()) - set(self._loops.empty)
        if now - self._began >= self._name_unheard:
            self._name_unheard = np.inf
            if self.never_heard and heard.any():
                note("loops_never_heard", count=len(self.never_heard), loops=self._named(self.never_heard))

    def register(self, row: int, now: float) -> None:
        """Note a loop that is in no table, first heard at ``now`` [s, monotonic]."""
        self._registered[row] = now

    def is_registered(self, row: int) -> bool:
        """Whether a loop is in no table."""
        return row in self._registered

    @property
    def registered(self) -> int:
        """How many loops of no table there are."""
        return len(self._registered)

    def overdue(self, arrival: NDArray[np.float64], now: float) -> list[int]:
        """Return the loops of no table that have been silent for so long that they are given up.

        Names change, and memory is bounded.

        Parameters
        ----------
        arrival
            When each loop's newest sample came [s, monotonic].
        """
        return [
            row
            for row, since in self._registered.items()
            if now - max(since, float(arrival[row])) > RETIRE_AFTER_S
        ]

    def forget(self, row: int) -> None:
        """Forget a loop that is watched no more."""
        self._registered.pop(row, None)
        self.stale.discard(row)

    def _named(self, rows: Iterable[int]) -> str:
        return named([self._loops[k].name for k in sorted(rows)])


def named(names: Sequence[str]) -> str:
    """Name loops in a line, the first of them."""
    more = f" and {len(names) - NAMED_LOOPS} more" if len(names) > NAMED_LOOPS else ""
    return ", ".join(names[:NAMED_LOOPS]) + more
