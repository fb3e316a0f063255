"""Single tags to samples, as live tags are joined: one at each PV's time, set point, output and mode held.

A value that is bad (text, a quality that is not good) is none: of SP, OP and mode the last good one holds, a PV's
sample is bad. Rows of the loops asked for are held in memory, 21 bytes each, and twice that while they are sorted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.entries import MODE_UNKNOWN
from monitor.contract.samples import QUALITY_GOOD, QUALITY_UNCERTAIN

from .cells import codes_of, is_text, modes, numbers, plain, qualities
from .clock import MissingHourError, to_utc
from .columns import Taker
from .layout import NEEDED, TALL
from .reader import counted_batches, unusable
from .rows import Rows, Tally, UnusableError
from .source import ZONED, Source, headings_of

SERIES = (*NEEDED, "auto")
"""Roles of tags that are joined."""
MOST_NAMED = 100
ROLES = len(SERIES)


@dataclass(eq=False, slots=True)
class Series:
    """N values of single tags, in the file's order."""

    tag: NDArray[np.int32]
    """(N,) loop's code times `ROLES`, plus the role's."""
    time: NDArray[np.int64]
    """(N,) [ns], local or UTC."""
    value: NDArray[np.float64]
    """(N,) of a mode 1, 0 or NaN."""
    quality: NDArray[np.uint8]
    row: NDArray[np.int64]
    """(N,) number of the row in its file."""


def joined_rows(
    sources: Sequence[Source], wanted: Mapping[str, int], zones: Mapping[str, Any], tally: Tally
) -> Iterator[Rows]:
    """Join the tags of these loops over all files: a batch for each loop, sorted, times UTC.

    Parameters
    ----------
    wanted
        Loop name to its code.
    zones
        Zone of each file whose times are local, by its name.

    Raises
    ------
    UnusableError
        A file is damaged, or holds a local time that does not exist.
    """
    parts = []
    for source in sources:
        found = list(series_of(source, wanted, tally))
        if found:
            parts.append((source, whole(found)))
    yield from joined_series(parts, wanted, zones, tally)


def joined_series(
    parts: list[tuple[Source, Series]], wanted: Mapping[str, int], zones: Mapping[str, Any], tally: Tally
) -> Iterator[Rows]:
    """Join the tags of these loops, read already, as `joined_rows`; empties ``parts``."""
    if not parts:
        return
    for source, series in parts:
        if source.name in zones:
            _localise(source, series, zones[source.name])
    everything = whole([series for _, series in parts])
    parts.clear()
    order = np.argsort(everything.time, kind="stable")
    order = order[np.argsort(everything.tag[order], kind="stable")]
    tag, time, value, quality = (
        a[order] for a in (everything.tag, everything.time, everything.value, everything.quality)
    )
    del everything, order
    edges = np.searchsorted(tag, np.arange(ROLES * (max(wanted.values(), default=-1) + 1) + 1))
    for code in sorted(wanted.values()):
        own = [slice(edges[code * ROLES + r], edges[code * ROLES + r + 1]) for r in range(ROLES)]
        if own[1].stop > own[1].start:
            tally.rows += int(own[1].stop - own[1].start)
            yield _join(code, [(time[s], value[s], quality[s]) for s in own])


def _join(code: int, tags: Sequence[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]) -> Rows:
    """Join one loop's tags."""
    time, pv, quality = tags[1]
    held = [_held(time, *tags[r]) for r in (0, 2, 3)]
    n = len(time)
    auto = np.full(n, 1 if not len(tags[3][0]) else MODE_UNKNOWN, np.int8)
    known = np.isfinite(held[2])
    auto[known] = held[2][known].astype(np.int8)
    return Rows(np.full(n, code, np.int32), time, held[0], pv, held[1], auto, quality, np.zeros(n, np.uint8))


def _held(
    at: NDArray[np.int64], time: NDArray[np.int64], value: NDArray[np.float64], quality: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Return a tag's latest good value at or before these times; NaN before its first."""
    good = np.isfinite(value) & (quality >= QUALITY_UNCERTAIN)
    time, value = time[good], value[good]
    if not len(time):
        return np.full(len(at), np.nan)
    first = np.concatenate([[True], np.diff(time) > 0])  # of equal times the first is kept
    time, value = time[first], value[first]
    k = np.searchsorted(time, at, side="right") - 1
    return np.where(k >= 0, value[np.maximum(k, 0)], np.nan)


def _localise(source: Source, series: Series, zone: Any) -> None:
    """Read a file's local times as UTC, each tag's in its own order (in place)."""
    try:
        series.time = to_utc(series.time, series.tag, zone)
    except MissingHourError as error:
        line = source.line(int(series.row[error.row]))
        raise UnusableError(source.name, f"time: {error.reason}", line) from None


def whole(parts: Sequence[Series]) -> Series:
    """Put series one behind the other."""
    if len(parts) == 1:
        return parts[0]
    return Series(*(np.concatenate([getattr(p, name) for p in parts]) for name in Series.__slots__))


# ---------------------------------------------------------------------------------------------------
# reading


def series_of(source: Source, wanted: Mapping[str, int], tally: Tally) -> Iterator[Series]:
    """Read a file's tags of these loops, in the file's order; times local where its are.

    Parameters
    ----------
    wanted
        Loop name to its code.

    Raises
    ------
    UnusableError
        The file is damaged.
    """
    try:
        yield from _series(source, wanted, tally)
    except (ValueError, OSError, NotImplementedError) as error:
        raise unusable(source.name, error) from None


def _series(source: Source, wanted: Mapping[str, int], tally: Tally) -> Iterator[Series]:
    layout = source.layout
    for name in layout.columns:
        if name not in wanted:
            tally.note_unknown_loop(name)
    codes = {
        heading: (wanted[name] * ROLES + SERIES.index(role), role)
        for name, roles in layout.columns.items()
        if name in wanted
        for role, heading in roles.items()
        if role in SERIES
    }
    if not codes:
        return
    read = _tall_batch if layout.kind == TALL else _tag_batch
    take = Taker(layout, source.clock, wanted, tally, ZONED, comma=source.comma)
    for row, batch in counted_batches(source, headings_of(layout, wanted), tally):
        yield from read(source, take, codes, row, batch)


def _tall_batch(
    source: Source, take: Taker, codes: Mapping[str, tuple[int, str]], row: int, batch: Any
) -> Iterator[Series]:
    layout, tally = source.layout, take.tally
    tag = tag_codes(batch, layout.tags, {name: code for name, (code, _) in codes.items()})
    keep = tag >= 0
    if not keep.any():
        return
    column = {h: batch.column(h).filter(keep) for h in headings_of(layout, None)}
    tag = tag[keep]
    time, good = take.times(column)
    tally.bad_time += len(good) - int(good.sum())
    cells = plain(column[layout.value])
    mode = tag % ROLES == SERIES.index("auto")
    value = np.empty(len(tag))
    if mode.any():
        value[~mode] = numbers(cells.filter(~mode), tally, comma=source.comma)
        value[mode] = mode_values(cells.filter(mode), tally, dict(source.modes))
    else:
        value[:] = numbers(cells, tally, comma=source.comma)
    quality = (
        qualities(column[layout.quality], tally, source.quality_scale)
        if layout.quality
        else np.full(len(tag), QUALITY_GOOD, np.uint8)
    )
    rows = row + np.flatnonzero(keep)
    yield Series(tag[good], time[good], value[good], quality[good], rows[good])


def tag_codes(batch: Any, tags: Sequence[str], codes: Mapping[str, int]) -> NDArray[np.int32]:
    """Return each row's code by its tag, -1 where it is not asked for; (N,).

    Parameters
    ----------
    tags
        Headings whose cells together are the tag.
    codes
        By the tag's full name.
    """
    if len(tags) == 1:
        return codes_of(batch.column(tags[0]), lambda name: codes.get((name or "").strip(), -1))
    first: dict[str, int] = {}
    second: dict[str, int] = {}
    a = codes_of(batch.column(tags[0]), lambda name: first.setdefault((name or "").strip(), len(first)))
    b = codes_of(batch.column(tags[1]), lambda name: second.setdefault((name or "").strip(), len(second)))
    table = np.array([[codes.get(f"{x}.{y}", -1) for y in second] for x in first], np.int32)
    return np.asarray(table.reshape(len(first), len(second))[a, b])


def mode_values(cells: Any, tally: Tally, said: Mapping[str, int]) -> NDArray[np.float64]:
    """Read modes: 1, 0, NaN where the cell does not say."""
    found = modes(cells if is_text(cells) or not said else cells.cast("string"), tally, said, 0)
    return np.where(found == MODE_UNKNOWN, np.nan, found.astype(np.float64))


def _tag_batch(
    source: Source, take: Taker, codes: Mapping[str, tuple[int, str]], row: int, batch: Any
) -> Iterator[Series]:
    layout, tally = source.layout, take.tally
    column = dict(zip(batch.schema.names, batch.columns, strict=True))
    time, good = take.times(column)
    n = len(time)
    if not layout.times:
        tally.bad_time += n - int(good.sum())
    quality = (
        qualities(column[layout.quality], tally, source.quality_scale)
        if layout.quality
        else np.full(n, QUALITY_GOOD, np.uint8)
    )
    for heading, (code, role) in codes.items():
        cells = plain(column[heading])
        if layout.times.get(heading, layout.time) != layout.time:
            time, good = take.times({layout.time: column[layout.times[heading]]})
        if role == "auto":
            value = mode_values(cells, tally, dict(source.modes))
        else:
            value = numbers(cells, tally, comma=source.comma)
        there = good & ~_nothing(cells)
        tag = np.full(int(there.sum()), code, np.int32)
        yield Series(tag, time[there], value[there], quality[there], row + np.flatnonzero(there))


def _nothing(cells: Any) -> NDArray[np.bool_]:
    """Mark empty cells of a table of several tags: no row of that tag."""
    if is_text(cells):
        cells = cells.fill_null("").cast("binary")
        return np.asarray(cells.to_pandas() == b"", dtype=np.bool_)
    return np.asarray(cells.is_null().to_numpy(zero_copy_only=False), dtype=np.bool_)
