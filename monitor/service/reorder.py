"""Arrivals into order: late ones within a window are sorted in, and tags are put together to samples.

The window runs in the samples' own time, loop by loop, so that a replay at any speed gives what the live stream
would have given. Of a loop's entries those older than its newest good one by more than the window are
released; what comes later than that is counted and dropped. Only a set point, output or mode that comes later
still holds from then on, if it is the newest of its kind: one that changes once a day must not be missed. Of
samples at equal times the first is kept, good or bad, as in the audit.

A loop of which nothing but late samples comes for a while has a source whose clock was set back: it begins anew
at the earlier time, rather than to be dropped until its clock has caught up. A batch that is replayed does not
last that long, or comes between samples of today.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit
from monitor.contract.entries import ENTRY, MODE_UNKNOWN, SAMPLE, TAG_AUTO, TAG_OP, TAG_SP
from monitor.contract.samples import QUALITY_UNCERTAIN, Samples

HELD_ENTRIES = 64
"""Entries held for each loop (3 kB): 32 a second, 4 to a sample of tags."""
WIDE_ENTRIES = 4096
"""Entries held for a loop that needs more (200 kB)."""
WIDE_LOOPS = 1000
"""Such loops; of more the window is shorter than it should be, which is counted."""
STEP_SAMPLES, STEP_S = 5, 30.0
"""Good samples of a loop, one after the other and over this wall time [s], that are late: its clock was set back."""

NEVER = np.iinfo(np.int64).min // 2
"""Before any time, and far enough from the end of the numbers to subtract a window."""
DONE, NEEDS_ROOM, STEPPED = range(3)
LATE, DUPLICATE, CONFLICT, OVERFLOW, STEPS = range(5)
"""What is counted: ``DUPLICATE`` includes ``CONFLICT``; ``OVERFLOW`` are entries that had to go before their time."""

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
        # where it holds more than fits; -1: nowhere
        ("wide", np.int64),
        # the last sample that went out
        ("out_at", np.int64),
        ("out_sp", np.float64),
        ("out_pv", np.float64),
        ("out_op", np.float64),
        # late ones in a row: how many, since when, the first one's time
        ("run", np.int64),
        ("run_since", np.float64),
        ("run_first", np.int64),
    ]
)


_TAGS = ("sp", "op", "auto", "sp_at", "op_at", "auto_at")
"""What holds until another one comes, and may do so for days."""


class Reorder:
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
        self.held = np.zeros((0, HELD_ENTRIES + 1), ENTRY)
        self.wide = np.zeros((0, WIDE_ENTRIES + 1), ENTRY)
        self._wide_used = 0
        self._counts = np.zeros(5, np.int64)
        self.waiting = 0
        """Entries held."""
        self.stepped: list[tuple[int, int, int]] = []
        """Clocks set back that the last `push` found: (place in its samples, loop, time of the first late one)."""
        self.grow(loops)

    @property
    def late(self) -> int:
        """Entries that came later than the window allows."""
        return int(self._counts[LATE])

    @property
    def duplicate(self) -> int:
        """Samples at a time that had had one; the first was kept."""
        return int(self._counts[DUPLICATE])

    @property
    def conflict(self) -> int:
        """Of those, the ones whose values differed."""
        return int(self._counts[CONFLICT])

    @property
    def overflow(self) -> int:
        """Entries let go before the window's end, for want of room."""
        return int(self._counts[OVERFLOW])

    @property
    def steps(self) -> int:
        """Clocks that were set back."""
        return int(self._counts[STEPS])

    def grow(self, loops: int) -> None:
        """Make room for more loops."""
        if loops <= len(self.state):
            return
        state = _new(loops)
        held = np.zeros((loops, HELD_ENTRIES + 1), ENTRY)
        state[: len(self.state)], held[: len(self.held)] = self.state, self.held
        self.state, self.held = state, held

    def forget(self, loop: int) -> None:
        """Make a loop's row as new; room that it has needed stays its own."""
        self.waiting -= int(self.state["count"][loop])
        wide = self.state["wide"][loop]
        self.state[loop] = _new(1)[0]
        self.state["wide"][loop] = wide

    def tags(self, loop: int) -> dict[str, float | int]:
        """Return the set point, output and mode that hold for a loop, and since when."""
        return {name: self.state[name][loop].item() for name in _TAGS}

    def hold(self, loop: int, tags: dict[str, float | int], arrival: float) -> None:
        """Let these hold for a loop, as somebody knew them; nothing has come since ``arrival`` [s, monotonic]."""
        for name in _TAGS:
            self.state[name][loop] = tags[name]
        self.state["arrival"][loop] = arrival

    def push(self, entries: NDArray[np.void], arrival: float) -> Samples:
        """Take in entries (dtype `ENTRY`) at wall time ``arrival`` [s]; return the samples that are due."""
        out = np.empty(len(entries) + self.waiting, ENTRY)
        self.stepped = []
        at = n = 0
        while at < len(entries):
            at, n, more, why = _push(
                self.state, self.held, self.wide, entries, at, self.window, arrival, out, n,
                self._counts, self._wide_used < WIDE_LOOPS,
            )  # fmt: skip
            self.waiting += more
            if why == NEEDS_ROOM:
                self._widen(int(entries[at]["loop"]))
            elif why == STEPPED:
                loop = int(entries[at]["loop"])
                self.stepped.append((n, loop, int(self.state[loop]["run_first"])))
        return _samples(out[:n])

    def _widen(self, loop: int) -> None:
        """Give a loop that sends fast more room."""
        slot = self._wide_used
        if slot == len(self.wide):
            self.wide = np.concatenate([self.wide, np.zeros((max(slot, 1), WIDE_ENTRIES + 1), ENTRY)])
        self.wide[slot, : HELD_ENTRIES + 1] = self.held[loop]
        self.state[loop]["wide"] = slot
        self._wide_used += 1

    def release(self, before: float) -> Samples:
        """Let go of what loops hold that had nothing newer since wall time ``before`` [s]."""
        rows = np.flatnonzero((self.state["count"] > 0) & (self.state["arrival"] <= before))
        n = int(self.state["count"][rows].sum())
        self.waiting -= n
        out = np.empty(n, ENTRY)
        return _samples(out[: _release(self.state, self.held, self.wide, rows, out, self._counts)])


def _new(loops: int) -> NDArray[np.void]:
    """Return the state of loops of which nothing has come."""
    state = np.zeros(loops, LOOP)
    state["sp"] = state["op"] = np.nan
    state["auto"], state["wide"] = 1, -1
    for name in ("newest", "released", "sp_at", "op_at", "auto_at", "out_at"):
        state[name] = NEVER
    return state


def _samples(entries: NDArray[np.void]) -> Samples:
    columns = (entries[n] for n in ("loop", "time", "sp", "pv", "op", "auto", "quality"))
    return Samples.of(*columns)


@jit
def _push(state, held, wide, entries, at, window, arrival, out, n, counts, may_widen):
    """Sort entries in from ``at`` on and release what is due; return (next, samples, how many more are held, why).

    It stops before an entry that needs more room than there is, and before the first one after a clock was set
    back.
    """
    more = 0
    for k in range(at, len(entries)):
        x = entries[k]
        s = state[x.loop]
        rows = held[x.loop] if s.wide < 0 else wide[s.wide]
        if x.time < s.newest - window or x.time < s.released:
            if x.kind != SAMPLE and x.kind <= TAG_AUTO:
                if not _take_over(s, x):
                    counts[LATE] += 1
                continue
            if _set_back(s, x, arrival):
                more -= s.count
                n = _let_go(s, rows, np.iinfo(np.int64).max, out, n, counts)
                s.newest = s.released = s.out_at = NEVER
                s.sp_at = s.op_at = s.auto_at = NEVER
                s.run = 0
                counts[STEPS] += 1
                return k, n, more, STEPPED
            counts[LATE] += 1
            continue
        if s.count >= HELD_ENTRIES and s.wide < 0 and may_widen and _moves(rows[s.count - 1]):
            return k, n, more, NEEDS_ROOM
        more -= s.count
        n = _take_in(s, rows, x, window, arrival, out, n, counts)
        more += s.count
    return len(entries), n, more, DONE


@jit
def _set_back(s, x, arrival):
    """Count late samples in a row; True where they have gone on for so long that the clock must have been set back."""
    if not _moves(x):
        return False
    if s.run == 0:
        s.run_since, s.run_first = arrival, x.time
    s.run += 1
    return s.run >= STEP_SAMPLES and arrival - s.run_since >= STEP_S


@jit
def _take_in(s, rows, x, window, arrival, out, n, counts):
    """Put an entry in its place, and release what it makes due; return the number of samples in ``out``."""
    j = s.count
    while j > 0 and _after(rows[j - 1], x):
        rows[j] = rows[j - 1]
        j -= 1
    rows[j] = x
    s.count += 1
    if s.count >= len(rows):
        counts[OVERFLOW] += 1
        n = _make_room(s, rows, out, n, counts)
    # a rejected or bad sample never moves the window
    if _moves(x):
        s.run = 0
        if x.time > s.newest:
            s.newest = x.time
            s.arrival = arrival
            n = _let_go(s, rows, s.newest - window - 1, out, n, counts)
    return n


@jit
def _make_room(s, rows, out, n, counts):
    """Let go of the newest entry if it is a bad one, which no order can save or spoil, else of the oldest."""
    last = s.count - 1
    if _moves(rows[last]):
        return _let_go(s, rows, rows[0].time, out, n, counts)
    s.count = last
    if rows[last].kind == SAMPLE or rows[last].kind > TAG_AUTO:
        out[n] = rows[last]
        n += 1
    return n


@jit
def _release(state, held, wide, loops, out, counts):
    n = 0
    for i in loops:
        s = state[i]
        rows = held[i] if s.wide < 0 else wide[s.wide]
        n = _let_go(s, rows, rows[s.count - 1].time, out, n, counts)
    return n


@jit
def _after(a, b):
    """Whether a held entry belongs behind a new one; of equals the first to come stays first."""
    return a.time > b.time or (a.time == b.time and a.kind > b.kind)


@jit
def _moves(x):
    """Whether an entry is good enough to say how far the loop's time has come."""
    if x.quality < QUALITY_UNCERTAIN:
        return False
    if x.kind == TAG_AUTO:
        return x.auto != MODE_UNKNOWN
    if x.kind == SAMPLE:
        return np.isfinite(x.pv) and np.isfinite(x.op)  # a set point holds until another comes
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
def _let_go(s, rows, until, out, n, counts):
    """Release entries up to a time, composing tags to samples; return the number of samples in ``out``."""
    k = 0
    while k < s.count and rows[k].time <= until:
        x = rows[k]
        if _moves(x):
            s.released = x.time
        if x.kind == SAMPLE:
            n = _emit(s, x, x.sp, x.op, x.auto, out, n, counts)
        elif x.kind <= TAG_AUTO:
            _take_over(s, x)  # a bad one is left out: the last good one holds
        else:
            n = _emit(s, x, s.sp, s.op, s.auto, out, n, counts)
        k += 1
    for j in range(k, s.count):
        rows[j - k] = rows[j]
    s.count -= k
    return n


@jit
def _emit(s, x, sp, op, auto, out, n, counts):
    """Put a sample out, unless one of its time went out before; return the number of samples in ``out``."""
    if x.time == s.out_at:
        counts[DUPLICATE] += 1
        if _differ(sp, s.out_sp) or _differ(x.pv, s.out_pv) or _differ(op, s.out_op):
            counts[CONFLICT] += 1
        return n
    s.out_at, s.out_sp, s.out_pv, s.out_op = x.time, sp, x.pv, op
    out[n] = x
    out[n].sp, out[n].op, out[n].auto = sp, op, auto
    return n + 1


@jit
def _differ(a, b):
    return a != b and not (np.isnan(a) and np.isnan(b))
