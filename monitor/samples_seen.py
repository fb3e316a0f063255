"""What became of all loops' samples, and how each loop's ended."""

from __future__ import annotations

from collections import Counter

import numpy as np

from monitor.detect.detector import Detector
from monitor.detect.state import COUNTS
from monitor.reporting.stage import Reporting
from monitor.verdict.stale import LastSample, LastSamples


class SamplesSeen:
    """Reads it from the state of the two stages that samples go through.

    Parameters
    ----------
    detector, reporting
        The stages; not copied.
    """

    def __init__(self, detector: Detector, reporting: Reporting) -> None:
        self._detector, self._reporting = detector, reporting
        self._others: Counter[str] = Counter()
        """Of loops that are watched no more; less what another process counted of those that are."""

    def counts(self) -> dict[str, int]:
        """Return what became of all samples, by cause."""
        counts = {n: int(self._detector.state["counts"][n].sum()) + self._others[n] for n in COUNTS}
        return {**counts, "ok": counts["ok"] - int(self._reporting.added.sum())}

    def keep(self, row: int) -> None:
        """Go on counting a loop's samples when its row becomes another's."""
        self._count(row, 1)

    def take_off(self, row: int) -> None:
        """Leave out those that a loop's row comes with: another process counted them."""
        self._count(row, -1)

    def _count(self, row: int, sign: int) -> None:
        for name in COUNTS:
            self._others[name] += sign * int(self._detector.state["counts"][name][row])
        self._others["ok"] -= sign * int(self._reporting.added[row])

    def all_last(self) -> LastSamples:
        """Return how all loops' samples ended, as of now."""
        state, reporting = self._detector.state, self._reporting
        clock, counts, waiting = state["clock"], state["counts"], reporting.waiting
        return LastSamples(
            time=np.where(waiting > 0, reporting.state["time"], state["last"]["time"]),
            # of rows on change, the longest silence that is none
            period=np.maximum(clock["period"], reporting.quiet),
            good=counts["ok"] - reporting.added + waiting,
            bad_value=counts["bad_value"],
            bad_quality=counts["bad_quality"],
            bad_run=clock["bad_run"],
        )

    def last(self, row: int) -> LastSample:
        """Return how a loop's samples ended."""
        return LastSample(*(column[row].item() for column in self.all_last()))
