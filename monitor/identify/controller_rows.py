"""An event's window laid out for the search for its controller: which rows tell something of its law."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import median, quantile
from monitor.contract.loops import Loop
from monitor.contract.samples import Array
from monitor.detect.event import EventWindow

LEAST_ROWS = 24
"""Rows below which nothing is said of a controller."""
LEAST_FLOATS = 1e6
"""Spacings of a float over which PV and OP must move: what is left of a simulated response is rounding."""
WIDE_PERIODS = 1.5
"""Periods from one row to the next from which a sample is missing between them: the integral has a gap."""
RESTS_ROWS = 3
"""Rows for which OP must stay at its extreme, to the last digit, to be at a limit."""
FAR_OUT_SHARE = 0.05
"""Share of its range by which OP may go beyond a limit of the table that it has."""
SAME_STEP_SHARE = 0.9
"""Share of OP's moves that must be whole multiples of the least one for OP to be rounded."""
LEAST_MOVES = 6
"""Moves of OP below which nothing is said of a controller, nor of how often it runs."""
MOST_SCAN_ROWS = 64
"""Rows between two runs of a controller that are looked for."""
LEAST_PACE_ROWS, MOST_UNEVEN_ROWS = 1.2, 1.5
"""Rows between two runs from which a pace is a slow one; rows by which the moves may stray from an even pace."""
OFF_SCAN_SHARE = 0.02
"""Share of OP's moves that may come beside the controller's own pace."""
LEAST_GAP_SHARE = 0.1
"""Share of the gaps between OP's moves that may be shorter than the longest pace that is looked for."""


@dataclass(frozen=True, eq=False, slots=True)
class Rows:
    """Samples at full rate, or those at which the controller ran."""

    time: Array
    sp: Array
    pv: Array
    op: Array
    use: NDArray[np.bool_]
    """OP follows the law here: it is not at a limit."""
    fresh: NDArray[np.bool_]
    """OP may hold another constant from here on."""
    period: float
    """Of the rows [s]."""
    quantum: float
    """Least step of OP, 0 where it is not rounded [OP]."""
    before: int
    """Rows before the onset."""
    scan: int = 1
    """Rows from one run of the controller to the next, as OP's moves show it."""
    phase: int = 0
    """The first row at which it ran."""
    stride: int = 1
    """Samples to a row of a thinned window, whose OP is their mean."""
    pace: float = 0.0
    """Rows from one run of the controller to the next where that is no whole number; 0 where it is [rows]."""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def middle(self) -> float:
        """How far, in rows, the middle of what OP is a mean of lies behind its row."""
        return 0.5 * (self.stride - 1) / self.stride

    def restarted(self, at: NDArray[np.intp]) -> Rows:
        """Return the rows with a free constant at these too."""
        fresh = self.fresh.copy()
        fresh[at] = True
        return replace(self, fresh=fresh)

    def part(self, kept: slice) -> Rows:
        """Return some of the rows, in a row."""
        columns = {n: getattr(self, n)[kept] for n in ("time", "sp", "pv", "op", "use", "fresh")}
        return replace(self, **columns, before=max(self.before - (kept.start or 0), 0))

    def at_scans(self, late: int = 0) -> Rows:
        """Return the rows at which the controller ran, with the inputs of ``late`` rows before."""
        first = self.phase if self.phase >= late else self.phase + self.scan
        at = np.arange(first, len(self), self.scan)
        gaps = np.add.reduceat(self.fresh[first:], at - first) > 0
        return replace(
            self._at(at, late),
            fresh=np.asarray(gaps, bool),
            period=self.scan * self.period,
            before=max((self.before - first) // self.scan, 0),
            scan=1,
            phase=0,
        )

    def at_moves(self, late: int) -> Rows:
        """Return the rows at which OP moves, with the inputs of ``late`` rows before: a run lies between two rows."""
        at = np.flatnonzero(np.diff(self.op)) + 1
        return replace(
            self._at(at, late),
            fresh=np.concatenate([[True], np.diff(at) > WIDE_PERIODS * self.pace]),
            period=self.pace * self.period,
            before=int(np.searchsorted(at, self.before)),
            pace=0.0,
        )

    def _at(self, at: NDArray[np.intp], late: int) -> Rows:
        """Return the samples of some rows, with the inputs of ``late`` rows before."""
        sp, pv = self.sp[at - late], self.pv[at - late]
        return replace(self, time=self.time[at], sp=sp, pv=pv, op=self.op[at], use=self.use[at])


def lay_out(window: EventWindow, period: float, loop: Loop) -> Rows | None:
    """Return the window's rows at full rate; None where there are too few, or OP does not move.

    Parameters
    ----------
    period
        Of the samples [s].
    """
    if not period > 0 or len(window) < LEAST_ROWS:
        return None
    steps = np.diff(window.time)
    wide = np.flatnonzero(steps > 3.0 * median(steps))
    # the far past of a load step is kept in coarse points
    first = int(wide[-1]) + 1 if len(wide) and wide[-1] < len(window) // 2 else 0
    first = first if first < window.before else 0
    time, sp, pv, op = (
        np.ascontiguousarray(c[first:]) for c in (window.time, window.sp, window.pv, window.op)
    )
    if len(time) < LEAST_ROWS:
        return None
    own = median(np.diff(time))
    stride = max(round(own / period), 1)
    moves = np.abs(np.diff(op))
    if np.count_nonzero(moves) < LEAST_MOVES or not (_moves(pv) and _moves(op)):
        return None
    quantum = _quantum(moves)
    fresh = np.concatenate([[True], np.diff(time) > WIDE_PERIODS * own])
    regular = stride == 1 and not fresh[1:].any()
    scan, phase = scan_rows(op) if regular else (1, 0)
    pace = odd_pace(op) if regular and scan == 1 else 0.0
    use = ~_at_limit(op, sp - pv, loop, quantum, max(scan, round(pace)))
    if stride > 1:
        use[-1] = False  # the last mean may not be whole
        use[np.flatnonzero(np.diff(sp))] = False  # nor of one set point
    rows = Rows(time, sp, pv, op, use, fresh, own, quantum, window.before - first, scan, phase, stride, pace)
    return rows if np.count_nonzero(use) >= LEAST_ROWS else None


def scan_rows(op: Array) -> tuple[int, int]:
    """Return how many rows pass from one run of the controller to the next, and the first row at which it ran."""
    at = np.flatnonzero(np.diff(op)) + 1
    gaps = np.diff(at)
    if np.count_nonzero(gaps == 1) > 1.0 + LEAST_GAP_SHARE * (len(gaps) - 1):
        return 1, 0  # the quantile is 1
    # a rounded OP rests between its moves, too, but keeps no time
    for step in range(min(int(quantile(gaps, LEAST_GAP_SHARE)[0]), MOST_SCAN_ROWS), 1, -1):
        phases = np.bincount(at % step, minlength=step)
        best = int(np.argmax(phases))
        if len(at) - phases[best] <= OFF_SCAN_SHARE * len(at):
            return step, best
    return 1, 0


def odd_pace(op: Array) -> float:
    """Return how many rows pass from one run of the controller to the next where that is no whole number; else 0."""
    gaps = np.diff(np.flatnonzero(np.diff(op)))
    if len(gaps) < LEAST_MOVES or np.max(gaps) - np.min(gaps) != 1:
        return 0.0
    pace = float(np.mean(gaps))
    # the runs of a clock are never further from even steps than a row
    steps = np.concatenate([[0], np.cumsum(gaps)]) - pace * np.arange(len(gaps) + 1)
    return pace if pace > LEAST_PACE_ROWS and float(np.ptp(steps)) < MOST_UNEVEN_ROWS else 0.0


def _moves(values: Array) -> bool:
    """Whether values move by far more than their floats are rounded."""
    return float(np.ptp(values)) > LEAST_FLOATS * float(np.finfo(float).eps * np.max(np.abs(values)))


def _quantum(moves: Array) -> float:
    """Return the least step of which OP's moves are whole multiples; 0 where they are not [OP]."""
    moved = moves[moves > 0]
    least = float(np.min(moved))
    if least < 1e-9 * float(np.max(moved)):
        return 0.0
    multiples = moved / least
    whole = np.abs(multiples - np.round(multiples)) < 0.02
    few = np.count_nonzero(multiples < 20.0) >= 0.5 * len(moved)  # of large ones any is nearly whole
    return least if few and np.mean(whole) >= SAME_STEP_SHARE else 0.0


def _at_limit(op: Array, e: Array, loop: Loop, quantum: float, scan: int) -> NDArray[np.bool_]:
    """Where OP lies at a limit of the table, or rests at an extreme of its own while the error moves."""
    out = np.zeros(len(op), bool)
    slack = 0.5 * quantum
    low, high = float(np.min(op)), float(np.max(op))
    # limits that OP leaves are in another unit
    if loop.op_low is not None and low >= loop.op_low - FAR_OUT_SHARE * (high - low):
        out |= op <= loop.op_low + slack
    if loop.op_high is not None and high <= loop.op_high + FAR_OUT_SHARE * (high - low):
        out |= op >= loop.op_high - slack
    scale = (high - low) / max(float(np.ptp(e)), 1e-300)
    least_move = max(4.0 * quantum, 1e-3 * (high - low)) / max(scale, 1e-300)
    for extreme in (low, high):
        rests = np.concatenate([[0], (op == extreme).astype(np.int8), [0]])
        edges = np.flatnonzero(np.diff(rests))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            run = slice(int(begin), int(end))
            if end - begin >= RESTS_ROWS * scan and np.ptp(e[run]) > least_move:
                out[run] = True
    return out
