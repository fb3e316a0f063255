"""Which column of an export is what: the time, the tags, the values, their qualities.

Headings and first cells in, a layout out. One reading, or none: where two are possible, or something of a loop's mode
could not be used, one line says so and
what would help.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

from .cell_kinds import EMPTY, NUMBER, TIME, WORD
from .layout import (
    LONG,
    LOOP_WORDS,
    NEEDED,
    PER_LOOP,
    TAGS,
    TALL,
    WIDE,
    Layout,
    NotUnderstoodError,
    heading_key,
    normal_name,
)
from .look import HELP, DoubtError, Look
from .tag_roles import Tags, loop_names, loops_of_tags, read_tag, role_of
from .tall_columns import QUALITY_WORDS, VALUE_WORDS, tag_columns, tag_name, value_and_quality
from .time_columns import own_times, time_columns

LEAST_OWN_SHARE = 0.5
"""Share of a table's columns that must be tags where no loop is whole in it."""
OWN = "loop."
"""Put before a heading that is a role alone, so that it reads as a tag."""


def recognise(look: Look) -> Layout:
    """Tell which column is what.

    Raises
    ------
    ValueError
        In one line, what is not understood, or may be read in two ways.
    """
    time, clock = time_columns(look)
    rest = [
        h for h in look.headings if h not in {time, clock} and (look.kinds[h] != TIME or look.given.columns)
    ]
    times = [h for h in look.headings if h not in {time, clock, *rest}]
    empty = Layout("", time, {}, clock=clock)
    pairs = own_times(look, times) if times and not clock else {}
    if pairs:
        columns, stems = _all_tags(pairs, look.known)
        used = {h for roles in columns.values() for h in roles.values()}
        left = (h for h in rest if h not in used)
        return replace(empty, kind=TAGS, columns=columns, stems=stems, times=pairs, unused=tuple(left))
    for attempt in (_given, _roles, _wide, _tall, _tag_file):
        found = attempt(look, empty, rest)
        if found is not None:
            return replace(found, unused=(*times, *found.unused))
    shown = ", ".join(h[:40] for h in look.headings[:8]) + (", ..." if len(look.headings) > 8 else "")
    raise NotUnderstoodError(
        f"columns {shown}: no set point, PV and output among them, expected e.g. LIC-101.SP, LIC-101.PV, LIC-101.OP as "
        f"columns or as tags in rows; {HELP}"
    )


# ---------------------------------------------------------------------------------------------------
# shapes


def _given(look: Look, empty: Layout, rest: Sequence[str]) -> Layout | None:
    """Read as the mapping says."""
    given = look.given
    if given.kind in {"", LONG, PER_LOOP}:
        return None
    if given.kind == TALL:
        return _tall(look, empty, rest)
    loops: dict[str, dict[str, str]] = {}
    for heading in rest:
        if heading in given.columns:
            loop, role = given.columns[heading]
            loops.setdefault(loop, {})[role] = heading
    if given.kind == TAGS:
        return _tag_file(look, empty, rest) if not loops else replace(empty, kind=TAGS, columns=loops)
    used = {h for roles in loops.values() for h in roles.values()}
    return (
        _complete(replace(empty, kind=WIDE, unused=tuple(h for h in rest if h not in used)), loops)
        if loops
        else None
    )


def _roles(look: Look, empty: Layout, rest: Sequence[str]) -> Layout | None:
    """Read columns that are roles by themselves: one long table, or a loop's own file."""
    plain = [h for h in rest if role_of(h) is not None]
    tags = loops_of_tags([OWN + h for h in plain])
    roles = {role: h.removeprefix(OWN) for found in tags.loops.values() for role, h in found.items()}
    if look.given.kind in {LONG, PER_LOOP} and look.given.columns:
        roles = {role: h for h, (_, role) in look.given.columns.items() if h in rest}
        tags = Tags()
    if not all(role in roles for role in NEEDED):
        return None
    _refuse_doubt(tags)
    loop = look.given.loop or _loop_column(look, [h for h in rest if h not in plain])
    used = {loop, *roles.values()}
    unused = tuple(h for h in rest if h not in used)
    if loop:
        return replace(empty, kind=LONG, columns={"": roles}, loop=loop, unused=unused)
    name = normal_name(look.path.stem)
    name = name if name in look.known else normal_name(unquote(name))
    return replace(empty, kind=PER_LOOP, columns={loop_names([name], look.known)[name]: roles}, unused=unused)


def _loop_column(look: Look, rest: Sequence[str]) -> str:
    """Return the heading of the loops' names; empty where there is none."""
    named = [h for h in rest if heading_key(h) in LOOP_WORDS and look.kinds[h] != EMPTY]
    words = [h for h in named if look.kinds[h] == WORD] or named
    if len(words) > 1:
        best = [h for h in words if heading_key(h).startswith(("loop", "controller", "regel", "kreis"))]
        words = best if len(best) == 1 else words
    if len(words) == 1:
        return words[0]
    if len(words) > 1:
        raise ValueError(f"{' and '.join(words)} may each be the loop's name; {HELP}")
    others = [h for h in rest if look.kinds[h] == WORD and len(set(look.cells[h])) > 1]
    if len(others) == 1 and not any(kind in heading_key(others[0]) for kind in ("comment", "note", "desc")):
        return others[0]
    if len(others) > 1:
        raise ValueError(f"{' and '.join(others)} may each be the loop's name; {HELP}")
    return ""


def _wide(look: Look, empty: Layout, rest: Sequence[str]) -> Layout | None:
    """Read columns that are tags."""
    tags = loops_of_tags(rest)
    if not tags.loops:
        own = [h for h in rest if (tag := read_tag(h)) is not None and tag.role in (*NEEDED, "auto")]
        if not own or len(own) < LEAST_OWN_SHARE * len(rest):
            return None
        columns, stems = _all_tags(
            own, look.known
        )  # the tags of one role: those of the others stand in other files
        return replace(empty, kind=TAGS, columns=columns, stems=stems, unused=_roleless(rest))
    _refuse_doubt(tags)
    _qualities_beside(look, tags)
    names = loop_names(list(tags.loops), look.known)
    loops = {names[stem]: roles for stem, roles in tags.loops.items()}
    if any(all(role in roles for role in NEEDED) for roles in loops.values()):
        return _complete(replace(empty, kind=WIDE, unused=tuple(tags.unused)), loops)
    # none is whole here: the other tags may stand in other files
    columns, stems = _all_tags(rest, look.known)
    return replace(empty, kind=TAGS, columns=columns, stems=stems, unused=_roleless(rest))


def _qualities_beside(look: Look, tags: Tags) -> None:
    """Give each PV the quality that stands behind it, under a heading that is nobody's (in place)."""
    after = dict(zip(look.headings, look.headings[1:], strict=False))
    for roles in tags.loops.values():
        beside = after.get(roles.get("pv", ""), "")
        if "quality" not in roles and beside and heading_key(beside).rstrip("0123456789") in QUALITY_WORDS:
            roles["quality"] = beside
            if beside in tags.unused:
                tags.unused.remove(beside)


def _all_tags(
    names: Iterable[str], known: Collection[str]
) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Return tags by loop and role, whether or not their loops are whole; and each loop's stem."""
    found = [
        (tag, name) for name in names if (tag := read_tag(name)) is not None and tag.role in (*NEEDED, "auto")
    ]
    short = loop_names(sorted({tag.stem for tag, _ in found}), known)
    out: dict[str, dict[str, str]] = {}
    for tag, name in sorted(found, key=lambda item: item[0].rank):
        out.setdefault(short[tag.stem], {}).setdefault(tag.role, name)
    return out, {name: stem for stem, name in short.items()}


def _roleless(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(n for n in names if (tag := read_tag(n)) is None or tag.role not in (*NEEDED, "auto"))


def _complete(layout: Layout, loops: Mapping[str, Mapping[str, str]]) -> Layout:
    """Leave out the loops that lack a role, and say what they lack."""
    incomplete = {}
    for name, roles in loops.items():
        lacking = [role.upper() for role in NEEDED if role not in roles]
        if lacking:
            incomplete[name] = f"no column or tag of its {' and '.join(lacking)}"
    whole = {name: dict(roles) for name, roles in loops.items() if name not in incomplete}
    return replace(layout, columns=whole, incomplete=incomplete)


def _tall(look: Look, empty: Layout, rest: Sequence[str]) -> Layout | None:
    """Read a row for each tag and time."""
    columns = look.given.tags or tag_columns(look, rest)
    if not columns:
        return None
    value, quality = value_and_quality(look, [h for h in rest if h not in columns])
    rows = [tuple(row) for row in look.different(tuple(columns))]
    whole = {tag_name(row): row for row in rows}
    stems: dict[str, str] = {}
    if look.given.columns:
        loops: dict[str, dict[str, str]] = {}
        for name in whole:
            if name in look.given.columns:
                loop, role = look.given.columns[name]
                loops.setdefault(loop, {})[role] = name
        tags = Tags(unused=[n for n in whole if n not in look.given.columns])
    else:
        tags = loops_of_tags(sorted(whole))
        _refuse_doubt(tags)
        names = loop_names(list(tags.loops), look.known)
        loops = {names[stem]: roles for stem, roles in tags.loops.items()}
        stems = {name: stem for stem, name in names.items()}
    if not loops:
        return None
    unused = [h for h in rest if h not in {*columns, value, quality}]
    layout = replace(
        empty, kind=TALL, tags=tuple(columns), value=value, quality=quality, unused=(*unused, *tags.unused)
    )
    return replace(layout, columns=loops, stems=stems)


def file_tag(path: Path) -> str:
    """Return the tag that a file's name is: with its folder's name before it where it is a role alone."""
    own = unquote(path.stem)
    return own if role_of(own) is None else f"{path.parent.name}.{own}"


def _tag_file(look: Look, empty: Layout, rest: Sequence[str]) -> Layout | None:
    """Read a file that is one tag's, called like it."""
    if not [h for h in rest if look.kinds[h] in {NUMBER, WORD}]:
        return None
    name = file_tag(look.path)
    if name in look.given.columns:
        loop, role = look.given.columns[name]
        stem = loop
    else:
        tag = read_tag(name)
        if tag is None:
            return None
        if tag.role not in (*NEEDED, "auto"):
            raise ValueError(f"{name}: not a tag that is used")
        loop, role, stem = loop_names([tag.stem], look.known)[tag.stem], tag.role, tag.stem
    filled = [h for h in rest if look.kinds[h] != EMPTY]
    quality = look.given.quality or next(
        (h for w in QUALITY_WORDS for h in filled if heading_key(h) == w), ""
    )
    values = [h for h in filled if h != quality and heading_key(h) not in QUALITY_WORDS]
    named = [h for w in VALUE_WORDS for h in values if heading_key(h) == w]
    value = look.given.value or (named or values or [""])[0]
    if not named and len(values) != 1 and not look.given.value:
        raise ValueError(f"{' and '.join(values) or 'no column'} may be the values of {name}; {HELP}")
    unused = tuple(h for h in rest if h not in {value, quality})
    loop = normal_name(loop)
    return replace(
        empty, kind=TAGS, columns={loop: {role: value}}, quality=quality, stems={loop: stem}, unused=unused
    )


def _refuse_doubt(tags: Tags) -> None:
    for why in tags.doubtful.values():
        raise DoubtError(f"{why}; {HELP}")
