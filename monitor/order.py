"""Arrivals into order: late ones within a window are sorted in, and tags are put together to samples.

The window runs in the samples' own time, loop by loop, so that a replay at any speed gives what the live stream
would have given. Of a loop's entries those older than its newest good one by more than the window are
released; what comes later than that is counted and dropped. Only a set point, output or mode that comes later
still holds from then on, if it is the newest of its kind: one that changes once a day must not be missed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .samples import UNCERTAIN, Samples
from .state import jit
from .wire import ENTRY, SAMPLE, TAG_AUTO, TAG_OP, TAG_SP, UNKNOWN

HELD = 64
"""Entries held for each loop; where more than 32 come in a second (4 to a sample of tags) the window is shorter."""

LOOP = np.dtype(
    [
        ("count", np.int64),
        ("newest", np.int64),
        ("released", np.int64),
        ("arrival", np.float64),
        ("sp", np.float64),
        ("op", np.float64),
        ("auto", np.int64),
        # times of the tags that hold
        ("sp_at", np.int64),
        ("op_at", np.int64),
        ("auto_at", np.int64),
    ]
)


class Order:
    """Holds back arrivals of all loops for the length of the window.

    Parameters
    ----------
    loops
        Number of loops; grow it with `grow`.
    window
        [s]
    """

    def __init__(self, loops: int, window: float = 2.0) -> None:
        self.window = round(window * 1e9)
        self.state = np.zeros(0, LOOP)
        self.held = np.zeros((0, HELD + 1), ENTRY)
        self.late = 0
        """Entries that came later than the window allows."""
        self.waiting = 0
        """Entries held."""
        self.grow(loops)

    def grow(self, loops: int) -> None:
        """Make room for more loops."""
        if loops <= len(self.state):
            return
        state = np.zeros(loops, LOOP)
        state["sp"] = state["op"] = np.nan
        state["auto"] = 1
        for name in ("newest", "released", "sp_at", "op_at", "auto_at"):
            state[name] = np.iinfo(np.int64).min // 2
        held = np.zeros((loops, HELD + 1), ENTRY)
        state[: len(self.state)], held[: len(self.held)] = self.state, self.held
        self.state, self.held = state, held

    def push(self, entries: NDArray[Any], arrival: float) -> Samples:
        """Take in entries (dtype `ENTRY`) at wall time ``arrival`` [s]; return the samples that are due."""
        out = np.empty(len(entries) + self.waiting, ENTRY)
        n, late, more = _push(self.state, self.held, entries, self.window, arrival, out)
        self.late += late
        self.waiting += more
        return _samples(out[:n])

    def release(self, before: float) -> Samples:
        """Let go of what loops hold that had nothing newer since wall time ``before`` [s]."""
        rows = np.flatnonzero((self.state["count"] > 0) & (self.state["arrival"] <= before))
        n = int(self.state["count"][rows].sum())
        self.waiting -= n
        out = np.empty(n, ENTRY)
        return _samples(out[: _release(self.state, self.held, rows, out)])


def _samples(entries: NDArray[Any]) -> Samples:
    columns = (entries[n] for n in ("loop", "time", "sp", "pv", "op", "auto", "quality"))
    return Samples.of(*columns)


@jit
def _push(state, held, entries, window, arrival, out):
    """Sort entries in and release what is due; return (samples, late entries, how many more are held)."""
    n = late = more = 0
    for k in range(len(entries)):
        x = entries[k]
        s = state[x.loop]
        if x.time < s.newest - window or x.time < s.released:
            if x.kind == SAMPLE or x.kind > TAG_AUTO or not _take_over(s, x):
                late += 1
            continue
        more -= s.count
        j = s.count
        while j > 0 and _after(held[x.loop, j - 1], x):
            held[x.loop, j] = held[x.loop, j - 1]
            j -= 1
        held[x.loop, j] = x
        s.count += 1
        if s.count > HELD:
            n = _make_room(s, held, x.loop, out, n)
        # a rejected or bad sample never moves the window
        if x.time > s.newest and _moves(x):
            s.newest = x.time
            s.arrival = arrival
            n = _let_go(s, held, x.loop, s.newest - window - 1, out, n)
        more += s.count
    return n, late, more


@jit
def _make_room(s, held, i, out, n):
    """Let go of the newest entry if it is a bad one, which no order can save or spoil, else of the oldest."""
    last = s.count - 1
    if _moves(held[i, last]):
        return _let_go(s, held, i, held[i, 0].time, out, n)
    s.count = last
    if held[i, last].kind == SAMPLE or held[i, last].kind > TAG_AUTO:
        out[n] = held[i, last]
        n += 1
    return n


@jit
def _release(state, held, rows, out):
    n = 0
    for i in rows:
        s = state[i]
        n = _let_go(s, held, i, held[i, s.count - 1].time, out, n)
    return n


@jit
def _after(a, b):
    """Whether a held entry belongs behind a new one; of equals the first to come stays first."""
    return a.time > b.time or (a.time == b.time and a.kind > b.kind)


@jit
def _moves(x):
    """Whether an entry is good enough to say how far the loop's time has come."""
    if x.quality < UNCERTAIN:
        return False
    if x.kind == TAG_AUTO:
        return x.auto != UNKNOWN
    if x.kind == SAMPLE:
        return np.isfinite(x.sp) and np.isfinite(x.pv) and np.isfinite(x.op)
    return np.isfinite(x.pv) or np.isfinite(x.sp) or np.isfinite(x.op)  # the one that the tag brings


@jit
def _take_over(s, x):
    """Make a set point, output or mode the one that holds, if it is good and newer than the last one."""
    if not _moves(x):
        return False
    if x.kind == TAG_SP and x.time > s.sp_at:
        s.sp, s.sp_at = x.sp, x.time
    elif x.kind == TAG_OP and x.time > s.op_at:
        s.op, s.op_at = x.op, x.time
    elif x.kind == TAG_AUTO and x.time > s.auto_at:
        s.auto, s.auto_at = x.auto, x.time
    else:
        return False
    return True


@jit
def _let_go(s, held, i, until, out, n):
    """Release entries up to a time, composing tags to samples; return the number of samples in ``out``."""
    k = 0
    while k < s.count and held[i, k].time <= until:
        x = held[i, k]
        if _moves(x):
            s.released = x.time
        if x.kind == SAMPLE:
            out[n] = x
            n += 1
        elif x.kind <= TAG_AUTO:
            _take_over(s, x)  # a bad one is left out: the last good one holds
        else:
            out[n] = x
            out[n].sp, out[n].op, out[n].auto = s.sp, s.op, s.auto
            n += 1
        k += 1
    for j in range(k, s.count):
        held[i, j - k] = held[i, j]
    s.count -= k
    return n
