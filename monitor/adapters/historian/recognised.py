"""A file by its documented layout, or by what is in it: which of the two it is, and the source that comes of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .cell_kinds import NUMBER, TIME, WORD, column_kind, kind_of, stands_for_value
from .cells import MODES, is_text, plain
from .clock import Clock
from .layout import TALL, WIDE, BoundsError, Layout, LoopTableFoundError, NotUnderstoodError
from .look import HELP, DoubtError, Look
from .mapping import NO_MAPPING, ExportMapping
from .quality_scales import quality_scale
from .recognise import recognise
from .source import Source, headings_of, with_clock
from .tall_columns import tag_name

MOST_DIFFERENT = 200_000
"""Different tags of a file; more are values, not tags."""


def documented_or_recognised(
    documented: Callable[[], Source], by_content: Callable[[], Source], given: ExportMapping
) -> Source:
    """Return a file's source: by its documented layout where that reads all columns, else by what is in it.

    Raises
    ------
    ValueError
        It is neither.
    """
    if given is not NO_MAPPING:
        return by_content()
    first: ValueError | None = None
    source: Source | None = None
    try:
        source = _with_unused(documented())
        layout = source.layout
        if not (layout.unused or layout.incomplete or _pathed(layout)):
            return source
    except (LoopTableFoundError, BoundsError):
        raise
    except ValueError as error:
        first = error
    try:
        found = by_content()
    except (DoubtError, BoundsError):
        raise
    except ValueError as error:
        if source is None:
            raise (first if first is not None and isinstance(error, NotUnderstoodError) else error) from None
        return source
    return found if source is None or _better(found, source) else source


def _with_unused(source: Source) -> Source:
    """Name the columns that a documented layout does not use."""
    used = set(headings_of(source.layout, None))
    unused = tuple(h for h in source.headings if h not in used)
    return replace(source, layout=replace(source.layout, unused=unused))


def _pathed(layout: Layout) -> bool:
    """Whether a wide table's names are paths of a server or provider, with the tag at their end."""
    names = layout.columns
    return layout.kind == WIDE and bool(names) and all(set(name) & set("[\\:") for name in names)


def _better(found: Source, source: Source) -> bool:
    """Whether what is in a file says more than its documented layout: more columns, or names without their path."""
    if not source.layout.columns:  # no loop is whole: other files may have the rest
        return True
    return _used(found.layout) > _used(source.layout) or _pathed(source.layout)


def _used(layout: Layout) -> int:
    """Count the columns that a layout uses, the tags' own times left out."""
    return len(headings_of(replace(layout, times={}), None))


def unread(path: Path, name: str, stat: Any, given: ExportMapping) -> Source:
    """Return the source of a file that is to be recognised, nothing of it read yet: a format and all else are to come.

    Parameters
    ----------
    stat
        Of the file: its size and time of change.
    """
    return Source(
        path, name, stat.st_size, stat.st_mtime_ns, "", Layout("", "", {}), Clock("text"),
        modes=tuple(given.modes.items()), recognised=True,
    )  # fmt: skip


def recognised(
    source: Source,
    kinds: Mapping[str, str],
    cells: Mapping[str, Sequence[str]],
    batches: Callable[[list[str]], Iterator[Any]],
    names: Collection[str],
    unit: str | None,
    given: ExportMapping,
) -> Source:
    """Return the source of a file that is read by what is in it.

    Parameters
    ----------
    kinds, cells
        Of its columns, by heading: the kind, and the first cells.
    batches
        Reads these columns of the whole file, in batches.
    names
        Names of the loop table.
    unit
        Of numeric times, where the user names it.
    given
        What the user says of the file.

    Raises
    ------
    ValueError
        It is not understood, or may be read in two ways.
    """

    def different(columns: tuple[str, ...]) -> list[tuple[str, ...]]:
        return different_rows(batches(list(columns)), columns)

    look = Look(source.path, source.headings, kinds, cells, different, names, given)
    source = replace(source, layout=recognise(look))
    source = replace(source, quality_scale=given.quality_scale or _scale(source.layout, look))
    _refuse_unknown_modes(source, look)
    return with_clock(source, batches, unit, given.time_format)


def _scale(layout: Layout, look: Look) -> str:
    """Return the scale of a file's qualities, of all its columns of them."""
    columns = (
        [layout.quality]
        if layout.quality
        else [r["quality"] for r in layout.columns.values() if "quality" in r]
    )
    cells = [cell for h in columns if h in look.cells for cell in look.cells[h]]
    try:
        return quality_scale(columns[0], cells, look.headings) if columns else ""
    except ValueError as error:
        raise DoubtError(str(error)) from None


def _refuse_unknown_modes(source: Source, look: Look) -> None:
    """Refuse modes that may mean anything: a loop in manual must not be judged for want of a word."""
    said = {text for text, _ in source.modes}
    for name, roles in source.layout.columns.items():
        if "auto" not in roles:
            continue
        cells = {
            c.strip().lower().removesuffix(".0") for c in _mode_cells(source.layout, roles["auto"], look)
        }
        cells = {
            c for c in cells if c and not (stands_for_value(c) and kind_of(c) == WORD and c not in MODES)
        }
        odd = sorted(cells - set(MODES) - said)
        if odd and not (cells - set(odd)):
            raise DoubtError(
                f"{roles['auto']}: mode {odd[0]!r} of {name or 'a loop'}, expected AUTO, MAN, CAS, ..., 1 or 0; say "
                f"what it means under [modes] of a mapping; {HELP}"
            )


def _mode_cells(layout: Layout, tag: str, look: Look) -> list[str]:
    """Return the first values of a mode's column, or tag."""
    if layout.kind != TALL:
        return list(look.cells[tag])
    rows = zip(*(look.cells[h] for h in layout.tags), look.cells[layout.value], strict=True)
    return [value for *cells, value in rows if tag_name(cells) == tag]


def different_rows(batches: Iterable[Any], columns: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return every different row of some columns of text, in the order in which they come.

    Raises
    ------
    ValueError
        They are more than tags can be.
    """
    out: dict[tuple[str, ...], None] = {}
    for batch in batches:
        arrays = [plain(batch.column(h)) for h in columns]
        encoded = [(a if is_text(a) else a.cast("string")).dictionary_encode() for a in arrays]
        texts = [e.dictionary.to_pylist() for e in encoded]
        code = np.zeros(len(batch), np.int64)
        for e, t in zip(encoded, texts, strict=True):
            code = code * (len(t) + 1) + e.indices.fill_null(len(t)).to_numpy(zero_copy_only=False)
        size = int(np.prod([len(t) + 1 for t in texts]))
        found = (
            np.flatnonzero(np.bincount(code, minlength=size))
            if size <= MOST_DIFFERENT * 10
            else np.unique(code)
        )
        for k in found.tolist():
            row: list[str] = []
            for t in texts[::-1]:
                k, at = divmod(k, len(t) + 1)  # noqa: PLW2901 (the digits of one number)
                row += t[at : at + 1]
            if len(row) == len(columns):
                out[tuple(row[::-1])] = None
        if len(out) > MOST_DIFFERENT:
            raise ValueError(f"more than {MOST_DIFFERENT} different tags in {', '.join(columns)}")
    return list(out)


def texts_of(batch: Any) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return a batch's cells as text, and each column's kind, by heading."""
    cells, kinds = {}, {}
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        kind = str(column.type)
        if kind.startswith(("struct", "list", "map", "large_list")):
            continue
        array = plain(column)
        cells[name] = ["" if v is None else str(v) for v in array.to_pylist()]
        if kind.startswith(("timestamp", "date")):
            kinds[name] = TIME
        elif is_text(array):
            kinds[name] = column_kind(cells[name])
        else:
            kinds[name] = NUMBER
    return cells, kinds
