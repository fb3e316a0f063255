"""Rows of any number of files to samples: per loop sorted, each time once.

Files whose rows are in order, per loop, stream through in bounded memory (`in_order`). Anything else is
sorted first (`sorted_samples`), some loops at a time. Both give the same samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from zoneinfo import ZoneInfo

import numpy as np

from monitor.compiled import jit_nogil
from monitor.contract.samples import Samples

from .clock import MissingHourError, to_utc
from .layout import LONG, TALL
from .reader import read
from .rows import HOLD_OP, HOLD_SP, Rows, Tally, UnusableError, join_rows
from .source import Source
from .tall import joined_rows, joined_series
from .tall_store import TagStore

MOST_SORTED_ROWS = 16_000_000
"""Rows sorted at a time, unless one loop alone has more: about 1.5 GB."""
MOST_JOINED_VALUES = 10_000_000
"""Values of single tags joined at a time, unless one loop alone has more: about 1 GB."""
BATCH_ROWS = 1 << 18
"""Samples handed on at a time."""


class OutOfOrderError(Exception):
    """The rows are not in order; they have to be sorted."""


@dataclass(frozen=True, slots=True)
class Span:
    """Which samples are wanted, and how local times are to be read."""

    since: int | None = None
    """[ns] First time."""
    until: int | None = None
    """[ns] First time that is not wanted any more."""
    zone: ZoneInfo | None = None
    """Of times without a zone; None = UTC."""


class _Gate:
    """Passes each loop's rows on in order, each time once; holds the mode where a row does not say."""

    def __init__(self, loops: int, span: Span, tally: Tally) -> None:
        self.span, self.tally = span, tally
        self.time = np.full(loops, np.iinfo(np.int64).min)
        self.values = np.full((loops, 3), np.nan)
        self.mode = np.ones(loops, np.int8)
        self.rows = np.zeros(loops, np.int64)
        self.held_time = np.full(loops, np.iinfo(np.int64).min)
        self.held = np.full((loops, 2), np.nan)

    def __call__(self, rows: Rows) -> Samples:
        """Return the samples.

        Raises
        ------
        OutOfOrderError
            A row is older than its loop's last.
        """
        n = len(rows)
        keep, auto = np.empty(n, np.bool_), np.empty(n, np.bool_)
        since = np.iinfo(np.int64).min if self.span.since is None else self.span.since
        until = np.iinfo(np.int64).max if self.span.until is None else self.span.until
        sp, op = rows.sp, rows.op
        if rows.hold.any():
            sp, op = sp.copy(), op.copy()
            _fill(rows.loop, rows.time, rows.hold, sp, op, self.held_time, self.held)
        outside, duplicate, conflict = _pass(
            rows.loop, rows.time, sp, rows.pv, op, rows.auto, since, until,
            self.time, self.values, self.mode, self.rows, keep, auto,
        )  # fmt: skip
        if outside < 0:
            raise OutOfOrderError
        self.tally.outside += outside
        self.tally.duplicate += duplicate
        self.tally.conflict += conflict
        samples = Samples(rows.loop, rows.time, sp, rows.pv, op, auto, rows.quality)
        return samples.take(keep) if outside or duplicate else samples


@jit_nogil  # the reading thread runs beside it
def _pass(loop, time, sp, pv, op, auto, since, until, last, values, mode, rows, keep, out):
    """Mark the rows to keep; return how many are outside, duplicates, conflicts; -1: out of order."""
    outside = duplicate = conflict = 0
    for k in range(len(time)):
        i = loop[k]
        keep[k] = False
        if time[k] < since or time[k] >= until:
            outside += 1
        elif time[k] > last[i]:
            last[i] = time[k]
            values[i, 0], values[i, 1], values[i, 2] = sp[k], pv[k], op[k]
            if auto[k] >= 0:
                mode[i] = auto[k]
            out[k] = mode[i] != 0
            keep[k] = True
            rows[i] += 1
        elif time[k] < last[i]:
            return -1, 0, 0
        else:
            duplicate += 1
            if _differ(sp[k], values[i, 0]) or _differ(pv[k], values[i, 1]) or _differ(op[k], values[i, 2]):
                conflict += 1
    return outside, duplicate, conflict


@jit_nogil  # the reading thread runs beside it
def _fill(loop, time, hold, sp, op, last, held):
    """Put each loop's last set point and output where a row did not write them again (in place)."""
    for k in range(len(time)):
        i = loop[k]
        if time[k] > last[i]:  # a repeated row is left out, and says nothing
            last[i] = time[k]
            if hold[k] & HOLD_SP:
                sp[k] = held[i, 0]
            if hold[k] & HOLD_OP:
                op[k] = held[i, 1]
            held[i, 0], held[i, 1] = sp[k], op[k]


@jit_nogil  # the reading thread runs beside it
def _differ(a, b):
    return a != b and not (np.isnan(a) and np.isnan(b))


def in_order(
    sources: Sequence[Source],
    wanted: Mapping[str, int],
    span: Span,
    tally: Tally,
    groups: Mapping[str, Sequence[int]] | None = None,
) -> Iterator[Samples]:
    """Stream the samples of files whose rows are in order; memory does not grow with them.

    Parameters
    ----------
    wanted
        Loop name to its code: 0, 1, 2, ...
    groups
        Row groups to read of some sources, by their name.

    Raises
    ------
    OutOfOrderError
        They are not in order: begin again with `sorted_samples`, and a new tally.
    UnusableError
        A file is damaged.
    """
    if any(needs_zone(s, span) or s.layout.joins for s in sources):
        raise OutOfOrderError  # the order tells the repeated hour's two passes apart: per file, per loop
    gate = _Gate(len(wanted), span, tally)

    def rows() -> Iterator[Rows]:
        for source in sources:
            yield from read(source, wanted, tally, (groups or {}).get(source.name))

    for batch in _ahead(rows()):
        samples = gate(batch)
        if len(samples):
            yield samples
    _count_loops(gate, wanted)


def sorted_samples(
    sources: Sequence[Source], wanted: Mapping[str, int], span: Span, tally: Tally
) -> Iterator[Samples]:
    """Sort and stream the samples, some loops at a time.

    Of equal times the first is kept: in the order of the sources, and of the rows in them.

    Raises
    ------
    UnusableError
        A file is damaged, or holds a local time that does not exist.
    """
    names = list(wanted)
    single = [source for source in sources if source.layout.joins]
    rows = sum(rows_of(source, names) for source in sources if not source.layout.joins)
    values = sum(source.size // 40 if source.rows is None else source.rows for source in single)
    parts = max(1, min(len(names), max(-(-rows // MOST_SORTED_ROWS), -(-values // MOST_JOINED_VALUES))))
    cut = [{name: wanted[name] for name in names[k::parts]} for k in range(parts)]
    zones = {s.name: span.zone for s in single if needs_zone(s, span)}
    with TemporaryDirectory(prefix="loopsight-", ignore_cleanup_errors=True) as folder:
        store = TagStore(Path(folder), single, cut, tally) if single and parts > 1 else None
        yield from _sorted_parts(sources, cut, span, tally, _joined(store, single, zones))
    # every pass has seen the others' loops
    tally.unknown -= set(wanted)


def _joined(
    store: TagStore | None, single: Sequence[Source], zones: Mapping[str, ZoneInfo | None]
) -> Callable[[int, Mapping[str, int], Tally], Iterator[Rows]]:
    """Return what joins the single tags of a part of the loops: from disk where they were put there."""

    def joined(k: int, some: Mapping[str, int], tally: Tally) -> Iterator[Rows]:
        if store is not None:
            return joined_series(store.part(k), some, zones, tally)
        return joined_rows(single, some, zones, tally) if single else iter(())

    return joined


def _sorted_parts(
    sources: Sequence[Source],
    cut: Sequence[Mapping[str, int]],
    span: Span,
    tally: Tally,
    joined: Callable[[int, Mapping[str, int], Tally], Iterator[Rows]],
) -> Iterator[Samples]:
    wanted = {name: code for some in cut for name, code in some.items()}
    for k, some in enumerate(cut):
        own = Tally()
        gate = _Gate(len(wanted), span, own)
        batches = [
            b for source in sources if not source.layout.joins for b in _localised(source, some, span, own)
        ]
        batches += joined(k, some, own)
        if batches:
            everything = join_rows(batches)
            del batches
            order = np.argsort(everything.time, kind="stable")
            # stable by a short integer is a counting sort
            code = everything.loop[order].astype(np.uint16 if len(wanted) < 1 << 16 else np.int32)
            everything = everything.take(order[np.argsort(code, kind="stable")])
            for at in range(0, len(everything), BATCH_ROWS):
                samples = gate(everything.take(slice(at, at + BATCH_ROWS)))
                if len(samples):
                    yield samples
        _count_loops(gate, wanted)
        tally.add(own)


def needs_zone(source: Source, span: Span) -> bool:
    """Whether the file's times are local times of the named zone."""
    return span.zone is not None and source.clock.naive


def _localised(source: Source, wanted: Mapping[str, int], span: Span, tally: Tally) -> Iterator[Rows]:
    """Read a whole file's rows of these loops, its times as UTC."""
    rows = _ahead(read(source, wanted, tally))
    if not needs_zone(source, span) or span.zone is None:
        yield from rows
        return
    batches = list(rows)
    if not batches:
        return
    everything = join_rows(batches)
    try:
        everything.time = to_utc(everything.time, everything.loop, span.zone)
    except MissingHourError as error:
        starts = np.cumsum([len(b) for b in batches])
        k = int(np.searchsorted(starts, error.row, side="right"))
        row = batches[k].row + error.row - int(starts[k - 1] if k else 0)
        raise UnusableError(source.name, f"time: {error.reason}", source.line(row)) from None
    yield everything


def rows_of(source: Source, names: Sequence[str]) -> int:
    """Estimate how many rows a file has of these loops; a CSV row takes 40 bytes or more."""
    rows = source.size // 40 if source.rows is None else source.rows
    if source.layout.kind == TALL:  # three rows or more a sample; of the loops asked for, as a share
        return (
            rows
            * sum(name in source.layout.columns for name in names)
            // (3 * max(1, len(source.layout.columns)))
        )
    return rows if source.layout.kind == LONG else rows * sum(name in source.layout.columns for name in names)


def _count_loops(gate: _Gate, wanted: Mapping[str, int]) -> None:
    for name, code in wanted.items():
        if gate.rows[code]:
            rows = gate.tally.loop_rows
            rows[name] = rows.get(name, 0) + int(gate.rows[code])


def _ahead(items: Iterator[Rows]) -> Iterator[Rows]:
    """Run an iterator in a thread, one item ahead: reading and detection each have a core."""
    with ThreadPoolExecutor(1, "historian") as pool:
        item = pool.submit(next, items, None)
        while (now := item.result()) is not None:
            item = pool.submit(next, items, None)
            yield now
