"""Many loops through time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_plants import kernel
from sim_plants.arrays import to_arrays
from sim_plants.specs import NEVER, TICK_NS, LoopSpec, Steps

__all__ = ["DEFAULT_START", "NEVER", "Block", "LoopSpec", "Simulation", "Steps"]

DEFAULT_START = 1_767_225_600.0
"""2026-01-01 00:00 UTC [s since 1970]: a fixed start, so that the same seed gives the same file."""


@dataclass(frozen=True, eq=False)
class Block:
    """Samples of N rows, sorted by time, then loop."""

    loop: NDArray[np.int32]
    """(N,) index of the loop."""
    time_ns: NDArray[np.int64]
    """(N,) [ns] since 1970-01-01 UTC, whole microseconds."""
    sp: NDArray[np.float64]
    """(N,) set point [PV]."""
    pv: NDArray[np.float64]
    """(N,) measured process variable [PV]."""
    op: NDArray[np.float64]
    """(N,) controller output, held until the loop's next sample [OP]."""
    auto: NDArray[np.bool_]
    """(N,) false in manual."""

    def __len__(self) -> int:
        return len(self.loop)

    @property
    def time(self) -> NDArray[np.float64]:
        """(N,) [s] since 1970-01-01 UTC."""
        return np.asarray(self.time_ns * 1e-9, dtype=np.float64)

    def rows(self, which: slice | NDArray[np.bool_] | NDArray[np.intp]) -> "Block":
        """Return some of the rows."""
        columns = (self.loop, self.time_ns, self.sp, self.pv, self.op, self.auto)
        return Block(*(column[which] for column in columns))  # type: ignore[arg-type]


class Simulation:
    """Loops through time; owns their state.

    Parameters
    ----------
    loops : sequence of LoopSpec
        The loops, at least one; `Block.loop` counts them.
    start : float
        Time of the first sample of every loop [s since 1970 UTC].

    Raises
    ------
    ValueError
        Without loops, or with two of the same name.
    """

    def __init__(self, loops: Sequence[LoopSpec], start: float = DEFAULT_START) -> None:
        if not loops:
            raise ValueError("loops: none, expected at least one")
        if len({loop.name for loop in loops}) < len(loops):
            raise ValueError("loops: two have the same name, expected unique names")
        self.loops = tuple(loops)
        self.start_ns = round(start * 1e9 / TICK_NS) * TICK_NS
        self.elapsed_ns = 0
        self._arrays = to_arrays(self.loops)

    @property
    def time_ns(self) -> int:
        """Time up to which, exclusive, samples have been made [ns since 1970 UTC]."""
        return self.start_ns + self.elapsed_ns

    @property
    def rate(self) -> float:
        """Samples per second of simulated time."""
        return float((1 / self._arrays.loops["period"]).sum())

    def advance(self, seconds: float) -> Block:
        """Return the samples of the next `seconds` [s], from the present time on, the end excluded.

        How a stretch is cut into calls makes no difference to its samples.
        """
        until = self.elapsed_ns + round(seconds * 1e9 / TICK_NS) * TICK_NS
        rows = self._arrays.loops
        n = int((-(-np.maximum(until - rows["due_ns"], 0) // rows["period_ns"])).sum())
        sp, pv, op = np.empty((3, n))
        out = kernel.Columns(np.empty(n, np.int32), np.empty(n, np.int64), sp, pv, op, np.empty(n, np.bool_))
        if n:
            kernel.advance(rows, self._arrays.plan, self._arrays.pool, self.start_ns, until, out)
        self.elapsed_ns = max(until, self.elapsed_ns)
        return Block(*out)
