"""What an audit keeps for the eye: some windows of each loop that is flagged, thinned, and its answers to steps.

Memory stays bounded, whatever the length of the record: a few events of a few hundred points for each loop.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import msgspec
import numpy as np

from monitor.compiled import jit
from monitor.contract.evidence import Answers, Window
from monitor.contract.records import DISTURBANCE, GOOD, NOT_ASSESSED, LoopRow
from monitor.contract.samples import Array, Samples

MOST_WITH_MODEL, MOST_WITHOUT = 3, 1
"""Newest events that are kept of a loop: those that a model was found for, which carry the verdict, and others."""
MOST_POINTS = 300
"""Of a window: as many as its picture has pixels, or nearly."""
TREND_SAMPLES = 1200
"""Newest samples of a loop that are kept: 20 kB, and an hour or two as most loops are sampled."""
QUIET_FLAGS = {"idle", "cascade_slave", "stale"}
"""Of a loop that these alone are said of there is nothing to see."""


class Kept(msgspec.Struct, frozen=True):
    """One event for the eye: columns as little-endian float32, which a part stores as they are."""

    loop: str
    id: str
    onset: int
    """[ns since 1970]."""
    time: bytes
    """From the onset on [s]."""
    sp: bytes
    pv: bytes
    op: bytes
    model: bytes
    """NaN where there is none."""


class Curves(msgspec.Struct, frozen=True):
    """A loop's answers to one kind of step: columns as in `Kept`, each of the responses with its band (3, n)."""

    loop: str
    kind: str
    time: bytes
    today: bytes
    new: bytes


def packed(values: Array) -> bytes:
    """Return numbers as little-endian float32."""
    return np.ascontiguousarray(values, dtype="<f4").tobytes()


def unpacked(data: bytes) -> Array:
    """Return numbers that `packed` has packed."""
    return np.frombuffer(data, dtype="<f4").astype(np.float64)


def flagged(row: LoopRow) -> bool:
    """Whether there is something to be looked at: a loop that is not good, and not merely without a step."""
    if row.verdict == NOT_ASSESSED:
        return bool(set(row.flags) - QUIET_FLAGS)
    return row.verdict != GOOD or bool(set(row.flags) - QUIET_FLAGS)


class Keeper:
    """Takes windows as they come, and keeps the newest few of each loop."""

    def __init__(self) -> None:
        self._modelled: dict[str, list[Kept]] = {}
        self._others: dict[str, list[Kept]] = {}

    def take(self, window: Window, kind: str) -> None:
        """Keep a window, and forget the oldest of its loop where there are too many."""
        with_model = bool(np.isfinite(window.model).any()) and kind != DISTURBANCE
        kept, most = (self._modelled, MOST_WITH_MODEL) if with_model else (self._others, MOST_WITHOUT)
        of_loop = kept.setdefault(window.loop, [])
        of_loop.append(thinned(window))
        del of_loop[:-most]

    def of(self, names: Iterable[str]) -> list[Kept]:
        """Return what is kept of these loops, by name, then by time."""
        found = [k for n in names for k in (*self._modelled.get(n, ()), *self._others.get(n, ()))]
        return sorted(found, key=lambda k: (k.loop, k.onset, k.id))


class Trends:
    """Takes samples as they come, and keeps the newest of each loop: what is seen of one that has no event.

    Parameters
    ----------
    names
        Of the loops, by row.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self._n = np.zeros(len(names), np.int64)
        """(L,) samples that went through a loop's ring."""
        self._time = np.zeros((len(names), TREND_SAMPLES), np.int64)
        self._levels = np.zeros((len(names), TREND_SAMPLES, 3), np.float32)
        """(L, `TREND_SAMPLES`, 3) SP, PV, OP."""

    def take(self, samples: Samples) -> None:
        """Keep the newest `TREND_SAMPLES` of each loop, each loop's times increasing."""
        _keep_newest(samples.columns(), self._n, self._time, self._levels)

    def of(self, names: Iterable[str]) -> list[Kept]:
        """Return the trends of these loops, thinned: windows without an id, that begin where they begin."""
        wanted, found = set(names), []
        for row in np.flatnonzero(self._n).tolist():
            if self.names[row] in wanted:
                first = max(int(self._n[row]) - TREND_SAMPLES, 0)
                at = np.arange(first, self._n[row]) % TREND_SAMPLES
                time, levels = self._time[row, at], self._levels[row, at].astype(np.float64)
                sp, pv, op = levels.T
                nothing = np.full(len(time), np.nan)
                found.append(thinned(Window("", self.names[row], int(time[0]), time, sp, pv, op, nothing)))
        return found


@jit
def _keep_newest(columns, n, ring_time, ring):
    """Write samples into their loops' rings; ``n``: samples that went through each (compiled)."""
    for k in range(len(columns.time)):
        i = columns.loop[k]
        at = n[i] % TREND_SAMPLES
        n[i] += 1
        ring_time[i, at] = columns.time[k]
        ring[i, at, 0], ring[i, at, 1], ring[i, at, 2] = columns.sp[k], columns.pv[k], columns.op[k]


def thinned(window: Window) -> Kept:
    """Return a window with at most `MOST_POINTS` points: of each run of samples the least and the largest PV stay.

    So neither a spike nor the swing of a fast oscillation is lost, which every tenth sample would make another one.
    """
    rows = _rows(window.pv, window.sp)
    seconds = (window.time - window.onset)[rows] * 1e-9
    columns = (packed(c[rows]) for c in (window.sp, window.pv, window.op, window.model))
    return Kept(window.loop, window.id, window.onset, packed(seconds), *columns)


def _rows(pv: Array, sp: Array) -> np.ndarray:
    """Return which points are kept, in order; the first and the last are, and those before and at a move of SP."""
    n = len(pv)
    if n <= MOST_POINTS:
        return np.arange(n)
    runs = (MOST_POINTS - 2) // 2
    edges = np.linspace(0, n, runs + 1).astype(np.int64)
    seen = np.where(np.isfinite(pv), pv, 0.0)
    extremes = [a + k for a, b in pairwise(edges) for k in (seen[a:b].argmin(), seen[a:b].argmax())]
    moves = np.flatnonzero(np.diff(sp) != 0)[:2]
    return np.unique([0, n - 1, *extremes, *moves, *(moves + 1)])


def curves_of(answers: Iterable[Answers]) -> list[Curves]:
    """Return answers as a part stores them."""
    return [Curves(a.loop, a.kind, packed(a.time), packed(a.today), packed(a.new)) for a in answers]


def windows_of(kept: Iterable[Kept]) -> list[Window]:
    """Return what a part has stored as the windows that they are."""
    return [
        Window(
            id=k.id,
            loop=k.loop,
            onset=k.onset,
            time=k.onset + np.round(unpacked(k.time) * 1e9).astype(np.int64),
            sp=unpacked(k.sp),
            pv=unpacked(k.pv),
            op=unpacked(k.op),
            model=unpacked(k.model),
        )
        for k in kept
    ]


def answers_of(curves: Iterable[Curves]) -> list[Answers]:
    """Return what a part has stored as the answers that they are."""
    return [
        Answers(
            loop=c.loop,
            kind=c.kind,
            time=unpacked(c.time),
            today=unpacked(c.today).reshape(3, -1),
            new=unpacked(c.new).reshape(3, -1),
        )
        for c in curves
    ]
