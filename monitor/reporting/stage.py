"""The stage before detection: rows that come by exception, on change only, become samples of held values.

A historian, an OPC UA subscription or a telegraf that reports by exception sends a row when a value has changed by
more than a dead band, and otherwise once in a while. Such rows are no samples at a rate: what lies between two of them
is known, for the value held. Their stamps tell the rate behind them; at that rate the last row's values are put out
again until the next row comes. A silence longer than those of a loop that has nothing to report stays a gap. A loop
whose rows come at a rate is untouched.

Rows kept by a swinging door have irregular stamps too, but between two of them PV moved in a straight line. They are
told apart by the sizes of PV's changes: by exception they are the dead band, or less.

One row of one loop at a time, in bounded memory a loop: nothing depends on how rows were batched.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Columns, Samples

from . import kernel
from .state import HOLDING, MOST_HELD_ROWS, REPORTING, RING_ROWS, ROW, SEEN_ROWS, WATCHING

OUT_ROWS = 1 << 16
"""Rows put out at a time: 3 MB."""
LEAST_JUDGED_ROWS = 12
"""Rows that wait when the data end from which on it is told how they came."""


class Reporting:
    """How all loops' rows come, and the way from rows to samples.

    Parameters
    ----------
    loops
        Their nominal periods are taken from the table; more are added with `add`.
    """

    def __init__(self, loops: list[Loop]) -> None:
        self.state = np.zeros(0, REPORTING)
        self.ring = np.zeros((0, RING_ROWS), ROW)
        self._out: Columns | None = None
        self.add(loops)

    def add(self, loops: list[Loop]) -> None:
        """Add rows for these loops, others untouched."""
        known = len(self.state)
        state, ring = np.zeros(known + len(loops), REPORTING), np.zeros((known + len(loops), RING_ROWS), ROW)
        state[:known], ring[:known] = self.state, self.ring
        self.state, self.ring = state, ring
        for row, loop in enumerate(loops, known):
            self.set_period(row, loop)

    def set_period(self, row: int, loop: Loop) -> None:
        """Take over a loop's nominal period, as its table has it now."""
        self.state["given"][row] = 0 if loop.period is None else round(loop.period * 1e9)

    def forget(self, row: int) -> None:
        """Make a loop's row as new, for the same loop at another time or for another one; none of its rows wait."""
        given = self.state["given"][row]
        self.state[row] = np.zeros((), REPORTING)
        self.state["given"][row] = given

    def run(self, samples: Samples) -> Iterator[Samples]:
        """Take in rows; return samples in pieces, to be used before the next: in each, what is known of loops holds."""
        batch = samples.columns()
        at = kernel.passes(self.state, batch, 0)
        if at > 0:
            yield samples if at == len(samples) else samples.take(slice(0, at))
        while at < len(samples):
            at, n, changed = kernel.take(self.state, self.ring, batch, at, self._room())
            yield from self._piece(n)
            if changed >= 0:
                yield from self._let_go(changed)

    def flush(self, rows: Iterable[int] | None = None) -> Iterator[Samples]:
        """Let go of the rows of these loops (default: all) that wait."""
        waiting = self.state["mode"] == WATCHING
        for row in np.flatnonzero(waiting) if rows is None else [r for r in rows if waiting[r]]:
            state, ring = self.state[row], self.ring[row]
            n = int(state["n"])
            seen = ring[max(n - SEEN_ROWS, 0) : n]
            if n < LEAST_JUDGED_ROWS or not kernel.judge(state, ring, seen):
                kernel.pass_on(state)
            yield from self._let_go(int(row))

    def _let_go(self, row: int) -> Iterator[Samples]:
        done = False
        while not done:
            n, done = kernel.let_go(self.state[row], self.ring[row], row, self._room())
            yield from self._piece(n)

    def _room(self) -> Columns:
        """Return the columns that rows are put out to; made when the first loop needs them."""
        if self._out is None:
            empty = Samples.of(loop=0, time=np.zeros(OUT_ROWS, np.int64), sp=0.0, pv=0.0, op=0.0)
            self._out = empty.columns()
        return self._out

    def _piece(self, n: int) -> Iterator[Samples]:
        if n > 0:
            yield Samples(**{name: column[:n] for name, column in self._room()._asdict().items()})

    # -- what is known ------------------------------------------------------------------------------

    def dead_band(self, row: int) -> float | None:
        """Return the change of PV from which on a loop's rows come, about [PV]; None where they come at a rate."""
        s = self.state[row]
        return float(s["band"]) if s["mode"] == HOLDING else None

    @property
    def added(self) -> NDArray[np.int64]:
        """(L,) samples of held values that were made up."""
        return np.asarray(self.state["added"])

    @property
    def waiting(self) -> NDArray[np.int64]:
        """(L,) good rows that wait until it is known how they come."""
        return np.where(self.state["mode"] == WATCHING, self.state["n"] - self.state["next"], 0)

    @property
    def quiet(self) -> NDArray[np.float64]:
        """(L,) for how long a loop may have nothing to report [s]; 0 where its rows come at a rate."""
        s = self.state
        longest = np.where(s["beat"] > 0, s["beat"], MOST_HELD_ROWS * s["period"])
        return np.where(s["mode"] == HOLDING, longest * 1e-9, 0.0)

    def known(self, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
        """Copy all that is known of loops: for each name an array with a row for each."""
        return {"reporting": self.state[rows], "reported": self.ring[rows]}

    def adopt(self, row: int, known: dict[str, Any]) -> None:
        """Go on with a loop of another stage: its row of each array of `known`."""
        self.state[row], self.ring[row] = known["reporting"], known["reported"]
