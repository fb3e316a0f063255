"""A batch of a file's columns to rows of loops: which cell is a time, a value, a mode, a quality of whom.

Works on Arrow batches through their own methods, without the library.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.entries import MODE_UNKNOWN
from monitor.contract.samples import QUALITY_GOOD

from .cells import codes_of, is_text, modes, numbers, order_of, plain, qualities, stamps, text_times
from .clock import OLDEST_S, Clock, clock_of_numbers, numbers_to_ns, plausible
from .layout import LONG, NEEDED, PER_LOOP, Layout, normal_name
from .rows import HOLD_OP, HOLD_SP, Rows, Tally, join_rows
from .time_formats import TextTimes, day_only, joined_texts, read_text_times


def clock_of(first: Any, unit: str | None, zoned: Any, *, comma: bool) -> Clock:
    """Tell the clock by the file's first times; ``zoned`` is the Arrow type of a time with zone.

    Raises
    ------
    ValueError
        They are no times, or their unit is ambiguous.
    """
    if first is None or not len(first):
        raise ValueError("no rows")
    first = plain(first)
    kind = str(first.type)
    if kind.startswith("timestamp"):
        ns, good = stamps(first)
        return Clock("timestamp", naive="tz=" not in kind, epoch=_of_day(ns[good]))
    if not is_text(first):
        return clock_of_numbers(numbers(first, Tally()), unit)
    values = numbers(first, Tally(), comma=comma)
    if np.isfinite(values).sum() * 2 >= len(values):
        return clock_of_numbers(values, unit)
    order = order_of(first)
    ns, good, aware = text_times(first, zoned, order)
    if not good.any():
        shown = next((t for t in first.to_pylist() if t), "")
        raise ValueError(f"time: {shown[:40]!r}, expected ISO text, e.g. 2026-11-22T10:00:00, or seconds")
    return Clock("text", naive=not aware[good][0], order=order, epoch=_of_day(ns[good]))


def clock_of_texts(
    first: Any, unit: str | None, zoned: Any, order: str, *, comma: bool, decided: bool = False
) -> Clock | None:
    """Tell the clock of a recognised file by its first times; None where day and month need more than these.

    Parameters
    ----------
    order
        Of day and month, where it is known.
    decided
        Whether ``order`` is final: empty then says that no date needs one.

    Raises
    ------
    ValueError
        They are no times, or their unit is ambiguous.
    """
    first = plain(first)
    if not is_text(first):
        return clock_of(first, unit, zoned, comma=comma)
    values = numbers(first, Tally(), comma=comma)
    times = TextTimes(first)
    if np.isfinite(values).sum() * 2 >= len(values) and not times.year.any():
        return clock_of_numbers(values, unit)
    if times.open.any() and not order and not decided:
        allowed = times.orders()
        if len(allowed) != 1:
            return None
        order = allowed.pop()
    ns, good, aware = read_text_times(first, order)
    if not good.any():
        shown = next((t for t in first.to_pylist() if t), "")
        raise ValueError(
            f"time: {shown[:40]!r}, expected a date and a time, e.g. 2026-11-22T10:00:00, or seconds"
        )
    naive = not aware[good][0]
    plainly, fine, _ = text_times(first, zoned)
    same = bool((fine == good).all() and (plainly == ns)[good].all() and not times.open.any())
    return Clock("text", naive=naive, order=order, fields=not same, epoch=_of_day(ns[good]))


def times_of(column: Any, layout: Layout) -> Any:
    """Return a batch's times; date and time of day are put together where they stand apart.

    Parameters
    ----------
    column
        A batch, or columns by heading.
    """
    time = column[layout.time]
    if not layout.clock:
        return time
    return joined_texts(day_only(plain(time)), plain(column[layout.clock]))


def sparse_of(head: Any, layout: Layout) -> frozenset[str]:
    """Tell by a file's first rows which set points and outputs are written only where they change.

    Such a column is empty in more than half of the rows that have a PV; its last value holds.
    """
    out: set[str] = set()
    column = dict(zip(head.schema.names, head.columns, strict=True))
    for roles in layout.columns.values():
        there = ~_empty(column[roles["pv"]])
        for role in ("sp", "op"):
            empty = _empty(column[roles[role]]) & there
            if 2 * empty.sum() > there.sum() and not empty.all():
                out.add(roles[role])
    return frozenset(out)


def _of_day(ns: NDArray[np.int64]) -> bool:
    """Whether times are times of day, not counted from some start."""
    return len(ns) > 0 and bool(np.median(ns) >= OLDEST_S * 1e9)


@dataclass(frozen=True, slots=True)
class Meanings:
    """What words and numbers of modes and qualities mean in a file."""

    modes: Mapping[str, int] = field(default_factory=dict)
    """What the user says of a mode, lower case: 1 automatic, 0 not."""
    strange: int = MODE_UNKNOWN
    """What a mode is whose word nobody knows."""
    quality_scale: str = ""
    """A name of `QUALITY_SCALES`; empty: OPC's."""


class Taker:
    """Takes a file's batches apart into rows of loops."""

    def __init__(
        self,
        layout: Layout,
        clock: Clock,
        wanted: Mapping[str, int],
        tally: Tally,
        zoned: Any,
        *,
        comma: bool,
        sparse: frozenset[str] = frozenset(),
        meanings: Meanings | None = None,
    ) -> None:
        self.meanings = meanings or Meanings()
        self.layout, self.clock, self.wanted, self.tally = layout, clock, wanted, tally
        self.zoned, self.comma, self.sparse = zoned, comma, sparse
        self.codes: dict[str | None, int] = {}
        if layout.kind != LONG:
            for name in layout.columns:
                if name not in wanted:
                    tally.note_unknown_loop(name)

    def __call__(self, row: int, batch: Any) -> Iterator[Rows]:
        """Yield the batch's rows."""
        layout = self.layout
        column = dict(zip(batch.schema.names, batch.columns, strict=True))
        if layout.kind == LONG:
            code = codes_of(column[layout.loop], self._code)
            if len(code) and code.min() < 0:
                keep = code >= 0
                code, column = code[keep], {h: c.filter(keep) for h, c in column.items()}
            time, good = self.times(column)
            yield self._rows(row, code, time, good, column, layout.columns[""])
            return
        parts = self._loops(row, len(batch), column)
        if parts:
            yield join_rows(parts) if len(parts) > 1 else parts[0]

    def _loops(self, row: int, n: int, column: dict[str, Any]) -> list[Rows]:
        """Take apart a batch whose headings name the loops."""
        layout, parts = self.layout, []
        time, good = self.times(column)
        for name, roles in layout.columns.items():
            if name not in self.wanted:
                continue
            code = np.full(n, self.wanted[name], np.int32)
            absent = np.logical_and.reduce([_empty(column[roles[role]]) for role in NEEDED])
            if layout.kind != PER_LOOP and absent.any():  # a row of other loops: this one has no sample there
                keep = ~absent
                own = {h: column[h].filter(keep) for h in roles.values()}
                parts.append(self._rows(row, code[keep], time[keep], good[keep], own, roles))
            else:
                parts.append(self._rows(row, code, time, good, column, roles))
        return parts

    def _code(self, name: str | None) -> int:
        if name not in self.codes:
            normal = normal_name(name or "")
            code = self.wanted.get(normal, -1)
            if code < 0:
                self.tally.note_unknown_loop(normal)
            if len(self.codes) > 1_000_000:
                self.codes.clear()
            self.codes[name] = code
        return self.codes[name]

    def _rows(
        self,
        row: int,
        code: NDArray[np.int32],
        time: NDArray[np.int64],
        good: NDArray[np.bool_],
        column: dict[str, Any],
        roles: dict[str, str],
    ) -> Rows:
        tally, n = self.tally, len(code)
        sp, pv, op = (self._values(column, roles[role]) for role in NEEDED)
        auto = (
            modes(column[roles["auto"]], tally, self.meanings.modes, self.meanings.strange)
            if "auto" in roles
            else _constant(1, np.int8, n)
        )
        quality = (
            qualities(column[roles["quality"]], tally, self.meanings.quality_scale)
            if "quality" in roles
            else _constant(QUALITY_GOOD, np.uint8, n)
        )
        hold = _constant(0, np.uint8, n)
        for role, bit in (("sp", HOLD_SP), ("op", HOLD_OP)):
            if roles[role] in self.sparse:
                hold = hold | np.where(_empty(column[roles[role]]), bit, 0).astype(np.uint8)
        tally.rows += n
        out = Rows(code, time, sp, pv, op, auto, quality, hold, row=row)
        if not good.all():
            tally.bad_time += n - int(good.sum())
            out = out.take(good)
        return out

    def _values(self, column: dict[str, Any], heading: str) -> NDArray[np.float64]:
        array = column[heading]
        if heading in self.sparse and is_text(plain(array)):  # empty is no bad value there, and not counted
            array = plain(array).fill_null("").to_pandas().replace("", None)
            array = type(column[heading]).from_pandas(array)
        return numbers(array, self.tally, comma=self.comma)

    def times(self, column: Mapping[str, Any]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Read a batch's times: (N,) [ns], local where the clock is naive; (N,) whether each is one."""
        clock, array = self.clock, plain(times_of(column, self.layout))
        if clock.kind == "number":
            ns, good = numbers_to_ns(_time_numbers(array, comma=self.comma), clock)
        else:
            if clock.kind == "text":
                ns, good, aware = (
                    read_text_times(array, clock.order)
                    if clock.fields
                    else text_times(array, self.zoned, clock.order)
                )
                if (aware[good] == clock.naive).any():
                    raise ValueError("time: with and without zone mixed, expected one kind")
            else:
                ns, good = stamps(array)
            good = good & plausible(ns, clock)
        if not good.all():
            for value in array.filter(~good)[:1000].unique().to_pylist():
                self.tally.note_bad_time("" if value is None else value)
        return ns, good


def _time_numbers(array: Any, *, comma: bool) -> NDArray[Any]:
    """Numeric times without loss: whole numbers stay whole, for a double cannot hold today's nanoseconds."""
    whole = "int" in str(array.type) or (is_text(array) and len(array) > 0 and str(array[0]).isdigit())
    if whole and not array.null_count:
        try:
            return np.asarray(array.cast("int64").to_numpy(zero_copy_only=False))
        except ValueError:
            pass
    return numbers(array, Tally(), comma=comma)


def _empty(array: Any) -> NDArray[np.bool_]:
    """Mark cells with nothing in them."""
    array = plain(array)
    if is_text(array):
        array = array.fill_null("")
        return np.asarray(array.cast("binary").to_pandas() == b"", dtype=np.bool_)
    return np.asarray(array.is_null(nan_is_null=True).to_numpy(zero_copy_only=False), dtype=np.bool_)


_CONSTANTS: dict[Any, NDArray[Any]] = {}


def _constant(value: int, dtype: Any, n: int) -> NDArray[Any]:
    """Return n equal values without filling them each time; not to be written to."""
    kept = _CONSTANTS.get((value, dtype))
    if kept is None or len(kept) < n:
        kept = _CONSTANTS[value, dtype] = np.full(max(n, 1 << 18), value, dtype)
    return kept[:n]
