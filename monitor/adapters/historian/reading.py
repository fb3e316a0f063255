"""How an export was understood, in words: what a user checks before believing the verdicts. Sources in, lines out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .layout import LONG, NEEDED, TAGS, TALL, Layout
from .recognise import file_tag
from .source import Source
from .tag_roles import read_tag

MOST_NAMED = 12
"""Columns or tags that are named in a line; the others are counted."""
_SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar"}


def reading_of(source: Source) -> str:
    """Say in one line how a file is read."""
    layout, clock = source.layout, source.clock
    time = f"{layout.time!r} + {layout.clock!r}" if layout.clock else repr(layout.time)
    how = f"number [{clock.unit}]" if clock.kind == "number" else clock.kind
    parts = [
        f"{layout.kind}{f', sheet {source.sheet!r}' if source.sheet else ''}",
        f"time {time} ({how}{f', {clock.order}' if clock.order else ''}{', local' if clock.naive else ''})",
    ]
    if layout.kind == LONG:
        parts.append(f"loop {layout.loop!r}")
    if layout.kind == TALL:
        parts.append(f"tag {' + '.join(map(repr, layout.tags))}, value {layout.value!r}")
    if layout.quality:
        parts.append(f"quality {layout.quality!r}")
    if source.format == "csv":
        parts.append(f"{_SEPARATORS.get(source.delimiter, repr(source.delimiter))}-separated")
    if source.decimal == ",":
        parts.append("decimal comma")
    if source.skip > 1:
        parts.append(f"data from row {source.skip + 1}")
    return "; ".join([*parts, _loops(layout)])


def _loops(layout: Layout) -> str:
    """Say which columns or tags are whose, by one loop as an example."""
    if not layout.columns:
        return "no loop"
    name, roles = next(iter(layout.columns.items()))
    shown = ", ".join(f"{role.upper()} = {heading}" for role, heading in roles.items())
    if layout.kind == LONG:
        return shown
    more = len(layout.columns) - 1
    return f"loop {name}: {shown}" + (f"; {more} more" if more else "")


def tag_of(source: Source, heading: str) -> str:
    """Return a tag's name as a mapping names it: its heading, or its file's name where the heading says nothing."""
    stems = source.layout.stems
    if source.layout.kind != TAGS or read_tag(heading) is not None or len(stems) != 1:
        return heading
    return file_tag(source.path)


def unused_of(layout: Layout) -> str:
    """Name the columns or tags that are not used; empty where there is none."""
    if not layout.unused:
        return ""
    more = len(layout.unused) - MOST_NAMED
    named = ", ".join(name[:60] for name in layout.unused[:MOST_NAMED])
    return f"not used: {named}" + (f" and {more} more" if more > 0 else "")


def settled(sources: Sequence[Source]) -> list[Source]:
    """Put the tags of several files together: a loop is whole where each of its roles stands in any of them.

    What lacks a role is left out, and said of the first file that has something of it. Loops of one name and of
    different paths keep their paths.
    """
    single = [s for s in sources if s.layout.joins]
    if not single:
        return list(sources)
    stems: dict[str, set[str]] = {}
    for source in single:
        for name, stem in source.layout.stems.items():
            stems.setdefault(name, set()).add(stem.casefold())
    twice = {name for name, found in stems.items() if len(found) > 1}
    named = {s.name: _with_paths(s.layout, twice) for s in single}
    roles: dict[str, set[str]] = {}
    for layout in named.values():
        for name, found in layout.columns.items():
            roles.setdefault(name, set()).update(found)
    lacking = {
        name: f"no column or tag of its {' and '.join(r.upper() for r in NEEDED if r not in found)}"
        for name, found in roles.items()
        if not set(NEEDED) <= found
    }
    out = []
    for source in sources:
        if not source.layout.joins:
            out.append(source)
            continue
        layout = named[source.name]
        own = {name: lacking.pop(name) for name in list(layout.columns) if name in lacking}
        columns = {n: r for n, r in layout.columns.items() if set(NEEDED) <= roles[n]}
        unused = (
            *layout.unused,
            *(h for n, r in layout.columns.items() if n not in columns for h in r.values()),
        )
        out.append(
            replace(
                source,
                layout=replace(
                    layout, columns=columns, incomplete={**layout.incomplete, **own}, unused=unused
                ),
            )
        )
    return out


def _with_paths(layout: Layout, names: set[str]) -> Layout:
    """Call these loops by their whole path."""
    columns = {layout.stems.get(n, n) if n in names else n: roles for n, roles in layout.columns.items()}
    return replace(layout, columns=columns)


def same_readings(sources: Sequence[Source]) -> list[str]:
    """Say how recognised files are read, one line for those that are read alike."""
    said: dict[str, list[Source]] = {}
    for source in sources:
        if source.recognised:
            layout = source.layout
            key = repr(
                (layout.kind, layout.time, layout.clock, source.clock, source.delimiter, source.decimal)
            )
            said.setdefault(key if layout.kind == TAGS else source.name, []).append(source)
    lines = []
    for alike in said.values():
        more = f" and {len(alike) - 1} more files" if len(alike) > 1 else ""
        lines.append(f"{alike[0].name}{more}: read as {reading_of(alike[0])}")
    return lines
