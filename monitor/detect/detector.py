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
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.health.diagnosis import Block
from monitor.health.observe import HEALTH

from . import kernel
from .constants import SLOTS_OF_SAMPLE, TOO_LARGE, WINDOW_POINTS
from .event import BY_END, CAUSES, LOAD_STEP, STATES, ClosedEvent, EventWindow, Opened, Stretch
from .state import BLOCK, BLOCKS, BUFFER, OPENED, OUT, PARAM, RINGS, STATE, STRETCH, Stores

_T = TypeVar("_T", bound=np.generic)
MOST_OUT = 256
"""Rows for what a call of the kernel hands out; with more it is called again."""
Found = list[Opened | ClosedEvent]
"""What opened and closed, in the samples' order."""
_AS_THEY_ARE = tuple(
    f.name for f in fields(ClosedEvent) if f.name not in {"state", "cause", "quiet", "window", "health"}
)
_NUMBERS = [name for name in OUT.names or () if name != "health"]
_PER_LOOP = ("state", "health", "rings")
"""What is known of the loops beyond the table: arrays with a row for each."""


class Detector:
    """The state of all loops, and the way from samples to events.

    Parameters
    ----------
    loops
        The loops' ranges, limits and nominal periods are taken from the table; more are added with `add`.
    """

    def __init__(self, loops: list[Loop]) -> None:
        self.stores = Stores(
            param=np.zeros(0, PARAM),
            state=np.zeros(0, STATE),
            health=np.zeros(0, HEALTH),
            rings=np.zeros(0, RINGS),
            blocks=np.zeros(0, BLOCKS),
            slab=np.zeros((0, WINDOW_POINTS, 4)),
            free=np.zeros(0, np.int64),
            n_free=np.zeros(1, np.int64),
            out=np.zeros(MOST_OUT, OUT),
        )
        self._stretches: list[Stretch] = []
        self._blocks: list[Block] = []
        self.add(loops)

    @property
    def state(self) -> NDArray[np.void]:
        """(L,) the loops' states, of dtype `STATE`."""
        return self.stores.state

    @property
    def health(self) -> NDArray[np.void]:
        """(L,) the loops' health records, of dtype `HEALTH`."""
        return self.stores.health

    @property
    def param(self) -> NDArray[np.void]:
        """(L,) what the table says of the loops, of dtype `PARAM`."""
        return self.stores.param

    def add(self, loops: list[Loop]) -> None:
        """Add rows for these loops, others untouched."""
        known, n = len(self.state), len(self.state) + len(loops)
        grown = {name: _grown(getattr(self.stores, name), n) for name in ("param", "blocks", *_PER_LOOP)}
        self.stores = self.stores._replace(**grown)
        for row, loop in enumerate(loops, known):
            _fill(self.param[row], loop)
        self.state["window"]["slot"][known:] = -1
        self.state["clock"]["period"][known:] = self.param["period"][known:]

    def set_limits(self, row: int, loop: Loop) -> None:
        """Take over a loop's ranges, limits and nominal period, as its table has them now."""
        _fill(self.param[row], loop)

    @property
    def open_rows(self) -> NDArray[np.intp]:
        """Rows of the loops with an open event."""
        return np.flatnonzero(self.state["window"]["slot"] >= 0)

    def set_back(self, row: int, time: int) -> None:
        """Take an earlier ``time`` [ns since 1970] for that of a loop's last sample: its clock was set back."""
        self.state["last"]["time"][row] = time

    def forget(self, row: int) -> None:
        """Make a loop's row as new, for another loop; no event of it is open."""
        for array in (self.state, self.health):
            array[row] = np.zeros((), array.dtype)
        self.state["window"]["slot"][row] = -1
        _fill(self.param[row], Loop(name="-"))

    def known(self, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
        """Copy all that is known of loops with an open event: for each name an array with a row for each loop.

        Among them ``onset``, of its event [ns since 1970].
        """
        arrays = {name: getattr(self.stores, name)[rows] for name in _PER_LOOP}
        state = arrays["state"]
        return {
            **arrays,
            "onset": state["event"]["onset"],
            "window": self.stores.slab[state["window"]["slot"]],
        }

    def adopt(self, row: int, known: dict[str, Any]) -> None:
        """Go on with a loop whose event was open in another detector: its row of each array of `known`."""
        self._make_room()
        slot = self._take_slot()
        for name in _PER_LOOP:
            getattr(self.stores, name)[row] = known[name]
        self.stores.slab[slot] = known["window"]
        self.state["window"]["slot"][row] = slot
        self.state["buffer"][row] = np.zeros((), BUFFER)  # blocks are not handed on: they begin anew

    def recall(self, row: int, known: dict[str, Any]) -> None:
        """Go on with a loop as another detector knew it, as after a gap: an event that was open there is none here."""
        self.state[row], self.health[row] = known["state"], known["health"]
        self.state["buffer"][row] = np.zeros((), BUFFER)
        kernel.begin_anew(self.state[row])

    def run(self, samples: Samples) -> Found:
        """Take in samples; return what opened and closed, in the samples' order."""
        found: Found = []
        batch = samples.columns()
        at = 0
        while at < len(samples):
            self._make_room()
            at, n = kernel.run(self.stores, batch, at)
            found += self._drain(n)
        return found

    def take_stretches(self) -> list[Stretch]:
        """Return the stretches handed out since this was last asked."""
        taken, self._stretches = self._stretches, []
        return taken

    def take_blocks(self) -> list[Block]:
        """Return the blocks handed out since this was last asked."""
        taken, self._blocks = self._blocks, []
        return taken

    def flush(self, loops: Iterable[int] | None = None, cause: int = BY_END) -> Found:
        """Close the open events of these rows (default: all) as interrupted, by default by the end of the data."""
        found: Found = []
        for row in np.flatnonzero(self.state["buffer"]["period"]) if loops is None else loops:
            self._make_room()
            found += self._drain(kernel.flush(self.stores, row, cause))
        return found

    def _make_room(self) -> None:
        """Have the free slots that a sample may need; the slab doubles: an upset of a whole plant costs few copies."""
        if self.stores.n_free[0] >= SLOTS_OF_SAMPLE:
            return
        n = len(self.stores.slab)
        more = min(max(n, 16), max(2 * len(self.state), 16))
        slab = _grown(self.stores.slab, n + more)
        left = int(self.stores.n_free[0])
        free = _grown(np.r_[self.stores.free[:left], n + more - 1 : n - 1 : -1], n + more)
        self.stores = self.stores._replace(slab=slab, free=free)
        self.stores.n_free[0] = left + more

    def _take_slot(self) -> int:
        self.stores.n_free[0] -= 1
        return int(self.stores.free[self.stores.n_free[0]])

    def _free_slot(self, slot: int) -> None:
        self.stores.free[self.stores.n_free[0]] = slot
        self.stores.n_free[0] += 1

    def _drain(self, n: int) -> Found:
        """Copy what the kernel handed out, and free the slots of its windows."""
        found: Found = []
        # all numbers at once: one field of a record by itself costs half a microsecond
        for k, numbers in enumerate(self.stores.out[:n][_NUMBERS].tolist()):
            out = dict(zip(_NUMBERS, numbers, strict=True))
            if out["what"] == OPENED:
                found.append(Opened(*(out[name] for name in ("row", "number", "onset", "amplitude"))))
                continue
            slot = out["slot"]
            if out["what"] == BLOCK:
                self._blocks.append(self._block(out, slot))
                continue
            time, sp, pv, op = self.stores.slab[slot, : out["points"]].T.copy()
            self._free_slot(slot)
            rested = bool(out["quiet"]) or out["what"] == STRETCH or out["kind"] == LOAD_STEP
            window = EventWindow(time, sp, pv, op, int(out["before"]), rested)
            if out["what"] == STRETCH:
                self._stretches.append(Stretch(out["row"], out["onset"], out["end"], out["period"], window))
                continue
            found.append(
                ClosedEvent(
                    **{name: out[name] for name in _AS_THEY_ARE},
                    state=STATES[out["state"]],
                    cause=CAUSES[out["cause"]],
                    quiet=bool(out["quiet"]),
                    window=window,
                    health=self.stores.out["health"][k].copy(),
                )
            )
        return found

    def _block(self, out: dict[str, Any], slot: int) -> Block:
        """Copy a block, and free its slot."""
        sp, pv, op = self.stores.slab[slot, : out["points"], 1:].T.copy()
        self._free_slot(slot)
        return Block(
            row=out["row"],
            level=out["number"],
            start=out["onset"],
            end=out["end"],
            period=out["period"],
            sp=sp,
            pv=pv,
            op=op,
            so_far=bool(out["state"]),
        )


def _fill(row: np.void, loop: Loop) -> None:
    """Write a loop's facts to its row of parameters; PV counts as real within ten spans around its range."""
    row["period"] = 0.0 if loop.period is None else loop.period
    row["pv_min"], row["pv_max"] = -TOO_LARGE, TOO_LARGE
    if loop.pv_low is not None and loop.pv_high is not None:
        span = loop.pv_high - loop.pv_low
        row["pv_min"], row["pv_max"] = loop.pv_low - 10 * span, loop.pv_high + 10 * span
    row["op_low"] = -np.inf if loop.op_low is None else loop.op_low
    row["op_high"] = np.inf if loop.op_high is None else loop.op_high


def _grown(array: NDArray[_T], n: int) -> NDArray[_T]:
    out = np.zeros((n, *array.shape[1:]), array.dtype)
    out[: len(array)] = array
    return out
