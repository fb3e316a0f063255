"""The streaming kernel: one sample of one loop at a time, in O(1) memory and a few additions.

While a loop is quiet its baseline is kept (mean PV and OP, noise of the error). A set-point step opens an
event: its integrals run, its samples go to a window. The event closes when the error lies still again
(`settled`), when something cuts in (`interrupted`), or when it takes too long (`timeout`).

The same compiled function serves a live frame (many loops, one sample each) and an audit (one loop, a
million samples); nothing in it depends on how the samples were batched.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.health.observe import HEALTH

from . import kernel
from .event import BY_END, CAUSES, STATES, ClosedEvent, EventWindow, Opened
from .state import EVENT_OUT, OPENED, PARAM, RING, STATE, TOO_LARGE, WINDOW

OUT = np.dtype([*EVENT_OUT, ("health", HEALTH)])
"""What the kernel hands out; a closed event with the loop's health of that moment."""
Found = list[Opened | ClosedEvent]
"""What opened and closed, in the samples' order."""
_AS_THEY_ARE = tuple(
    f.name for f in fields(ClosedEvent) if f.name not in {"state", "cause", "quiet", "window", "health"}
)


class Detector:
    """The state of all loops, and the way from samples to events.

    Parameters
    ----------
    loops
        The loops' ranges, limits and nominal periods are taken from the table; more are added with `add`.
    """

    def __init__(self, loops: list[Loop]) -> None:
        self.param = np.zeros(0, PARAM)
        self.state = np.zeros(0, STATE)
        self.health = np.zeros(0, HEALTH)
        self.ring = np.zeros((0, RING, 3))
        self.ring_time = np.zeros((0, RING), np.int64)
        self.coarse = np.zeros((0, RING, 3))
        self.coarse_time = np.zeros((0, RING), np.int64)
        self.slab = np.zeros((0, WINDOW, 4))
        self.free = np.zeros(0, np.int64)
        self.n_free = np.zeros(1, np.int64)
        self.out = np.zeros(256, OUT)
        self.add(loops)

    def add(self, loops: list[Loop]) -> None:
        """Add rows for these loops, others untouched."""
        param, state = np.zeros(len(loops), PARAM), np.zeros(len(loops), STATE)
        for row, loop in zip(param, loops, strict=True):
            _fill(row, loop)
        state["slot"] = -1
        state["period"] = param["period"]
        self.param = np.concatenate([self.param, param])
        self.state = np.concatenate([self.state, state])
        n = len(self.state)
        self.health = _grown(self.health, n)
        self.ring = _grown(self.ring, n)
        self.ring_time = _grown(self.ring_time, n)
        self.coarse = _grown(self.coarse, n)
        self.coarse_time = _grown(self.coarse_time, n)

    def set_limits(self, row: int, loop: Loop) -> None:
        """Take over a loop's ranges, limits and nominal period, as its table has them now."""
        _fill(self.param[row], loop)

    @property
    def open_rows(self) -> NDArray[np.intp]:
        """Rows of the loops with an open event."""
        return np.flatnonzero(self.state["slot"] >= 0)

    def forget(self, row: int) -> None:
        """Make a loop's row as new, for another loop; no event of it is open."""
        for array in (self.state, self.health):
            array[row] = 0
        self.state["slot"][row] = -1
        _fill(self.param[row], Loop(name="-"))

    @property
    def _per_loop(self) -> dict[str, NDArray[Any]]:
        """What is known of the loops beyond the table: arrays with a row for each."""
        names = ("state", "health", "ring", "ring_time", "coarse", "coarse_time")
        return {name: getattr(self, name) for name in names}

    def known(self, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
        """Copy all that is known of loops with an open event: for each name an array with a row for each loop.

        Among them ``onset``, of its event [ns since 1970].
        """
        arrays = {name: array[rows] for name, array in self._per_loop.items()}
        return {**arrays, "onset": self.state["onset"][rows], "window": self.slab[self.state["slot"][rows]]}

    def adopt(self, row: int, known: dict[str, Any]) -> None:
        """Go on with a loop whose event was open in another detector: its row of each array of `known`."""
        self._make_room()
        self.n_free[0] -= 1
        slot = self.free[self.n_free[0]]
        for name, array in self._per_loop.items():
            array[row] = known[name]
        self.slab[slot] = known["window"]
        self.state["slot"][row] = slot

    def run(self, samples: Samples) -> Found:
        """Take in samples; return what opened and closed, in the samples' order."""
        found: Found = []
        at = 0
        while at < len(samples):
            self._make_room()
            at, n = kernel.run(
                self.state, self.health, self.param, self.ring, self.ring_time, self.coarse, self.coarse_time,
                self.slab, self.free, self.n_free, self.out,
                samples.loop, samples.time, samples.sp, samples.pv, samples.op, samples.auto, samples.quality, at,
            )  # fmt: skip
            found += self._drain(n)
        return found

    def flush(self, loops: Iterable[int] | None = None, cause: int = BY_END) -> Found:
        """Close the open events of these rows (default: all) as interrupted, by default by the end of the data."""
        found: Found = []
        for row in self.open_rows if loops is None else loops:
            found += self._drain(
                kernel.flush(self.state, self.health, self.free, self.n_free, self.out, row, cause)
            )
        return found

    def _make_room(self) -> None:
        """Have at least one free slot; the slab doubles, so that an upset of the whole plant costs few copies."""
        if self.n_free[0] > 0:
            return
        n = len(self.slab)
        more = min(max(n, 16), max(2 * len(self.state), 16))
        self.slab = _grown(self.slab, n + more)
        self.free = _grown(np.arange(n + more - 1, n - 1, -1), n + more)
        self.n_free[0] = more

    def _drain(self, n: int) -> Found:
        """Copy what the kernel handed out, and free the slots of closed events."""
        found: Found = []
        for out in self.out[:n]:
            if out["what"] == OPENED:
                found.append(Opened(*(out[name].item() for name in ("row", "number", "onset", "amplitude"))))
                continue
            time, sp, pv, op = self.slab[out["slot"], : out["points"]].T.copy()
            window = EventWindow(time, sp, pv, op, int(out["before"]))
            self.free[self.n_free[0]] = out["slot"]
            self.n_free[0] += 1
            found.append(
                ClosedEvent(
                    **{name: out[name].item() for name in _AS_THEY_ARE},
                    state=STATES[out["state"]],
                    cause=CAUSES[out["cause"]],
                    quiet=bool(out["quiet"]),
                    window=window,
                    health=out["health"].copy(),
                )
            )
        return found


def _fill(row: Any, loop: Loop) -> None:
    """Write a loop's facts to its row of parameters; PV counts as real within ten spans around its range."""
    row["period"] = 0.0 if loop.period is None else loop.period
    row["pv_min"], row["pv_max"] = -TOO_LARGE, TOO_LARGE
    if loop.pv_low is not None and loop.pv_high is not None:
        span = loop.pv_high - loop.pv_low
        row["pv_min"], row["pv_max"] = loop.pv_low - 10 * span, loop.pv_high + 10 * span
    row["op_low"] = -np.inf if loop.op_low is None else loop.op_low
    row["op_high"] = np.inf if loop.op_high is None else loop.op_high


def _grown(array: NDArray[Any], n: int) -> NDArray[Any]:
    out = np.zeros((n, *array.shape[1:]), array.dtype)
    out[: len(array)] = array
    return out
