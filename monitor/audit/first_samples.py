"""Some samples of each loop, kept while an audit passes over them: enough to see in which units they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.contract.samples import Samples

MOST_FIRST = 200
"""Samples of a loop that are kept."""
BLOCKS, BLOCK_SAMPLES = 8, 512
"""Of a batch these are looked at, spread over it: all of them would cost as much as detection."""


class FirstSamples:
    """The first samples in automatic of each loop; bounded, and cheap once they are known.

    Parameters
    ----------
    loops
        How many.
    """

    def __init__(self, loops: int) -> None:
        self._found = np.zeros(loops, np.int64)
        self._full = False
        self._kept = np.full((loops, 2, MOST_FIRST), np.nan)

    def watch(self, samples: Samples) -> None:
        """Take what is still needed."""
        if self._full:
            return
        looked = _blocks(len(samples))
        loop = samples.loop[looked]
        wanted = looked[samples.auto[looked] & (self._found[loop] < MOST_FIRST)]
        if not len(wanted):
            self._full = bool((self._found >= MOST_FIRST).all())
            return
        order = wanted[np.argsort(samples.loop[wanted], kind="stable")]
        codes, starts = np.unique(samples.loop[order], return_index=True)
        for code, new in zip(codes, np.split(order, starts[1:]), strict=True):
            n = int(self._found[code])
            rows = new[: MOST_FIRST - n]
            self._kept[code, 0, n : n + len(rows)] = samples.sp[rows]
            self._kept[code, 1, n : n + len(rows)] = samples.pv[rows]
            self._found[code] += len(rows)

    def of(self, row: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a loop's SP and PV."""
        n = int(self._found[row])
        return self._kept[row, 0, :n], self._kept[row, 1, :n]


def _blocks(n: int) -> NDArray[np.int64]:
    """Return the rows of a batch of ``n`` that are looked at."""
    if n <= BLOCKS * BLOCK_SAMPLES:
        return np.arange(n)
    starts = np.linspace(0, n - BLOCK_SAMPLES, BLOCKS).astype(np.int64)
    return np.asarray((starts[:, None] + np.arange(BLOCK_SAMPLES)).ravel())
