"""Which column of an export is what: the time, the tags, the values, their qualities. Headings and first cells in, a layout out.

One reading, or none: where two are possible, or something of a loop's mode could not be used, one line says so and
what would help.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from urllib.parse import unquote

from .cell_kinds import CLOCK, EMPTY, NUMBER, TIME, WORD
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
    is_time_heading,
    normal_name,
)
from .mapping import NO_MAPPING, Mapping as Given
from .tag_roles import Tags, loop_names, loops_of_tags, read_tag, role_of

HELP = "say which by a mapping: `loopsight import` writes one, --map takes it"
TAG_WORDS = frozenset(
    "tag tagname name path tagpath point pointname pointid id item itemid itemname series seriesname metric variable signal "
    "signalname source sensor address tagid measurement channel fullname kks nodeid messstelle bezeichnung".split()
)
VALUE_WORDS = (
    *(
        "value",
        "val",
        "v",
        "wert",
        "messwert",
        "iptrendvalue",
        "floatvalue",
        "reading",
        "data",
        "tagvalue",
        "numericvalue",
    ),
    *("avgvalue", "samplevalue", "valuedouble", "doublevalue", "vvalue", "intvalue"),
)
"""Headings of the column of values in a tall table, the first goes before the others."""
QUALITY_WORDS = (
    *(
        "opcquality",
        "quality",
        "qualitycode",
        "qual",
        "q",
        "status",
        "confidence",
        "dataintegrity",
        "iptrendqstatus",
    ),
    *("qstatus", "qualitaet", "qualität", "statuscode", "sts", "good", "isgood", "qualitydetail", "valid"),
)
"""Headings of qualities, likewise: a code of OPC goes before a vendor's."""
LEAST_TAGS_SHARE = 0.2
"""Share of a column's different texts that must read as tags."""
OWN = "loop."
"""Put before a heading that is a role alone, so that it reads as a tag."""


@dataclass(frozen=True, slots=True)
class Look:
    """An export's headings, and what stands beneath them."""

    path: Path
    headings: tuple[str, ...]
    kinds: Mapping[str, str]
    """Kind of each column, by its heading."""
    cells: Mapping[str, Sequence[str]]
    """First cells of each."""
    different: Callable[[tuple[str, ...]], Iterable[tuple[str, ...]]]
    """Every different row of these columns in the whole file."""
    known: Collection[str] = ()
    """Names of the loop table."""
    given: Given = field(default_factory=lambda: NO_MAPPING)
    """What the user says of the file."""


class DoubtError(ValueError):
    """A file that may be read in two ways, or in which something of a loop's mode cannot be used."""


def recognise(look: Look) -> Layout:
    """Tell which column is what.

    Raises
    ------
    ValueError
        In one line, what is not understood, or may be read in two ways.
    """
    time, clock = _time_columns(look)
    rest = [
        h for h in look.headings if h not in {time, clock} and (look.kinds[h] != TIME or look.given.columns)
    ]
    times = [h for h in look.headings if h not in {time, clock, *rest}]
    empty = Layout("", time, {}, clock=clock)
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
# time


def _time_columns(look: Look) -> tuple[str, str]:
    """Return the headings of the time, and of the time of day where it stands apart."""
    given = look.given
    if given.time:
        lacking = [h for h in given.time if h not in look.headings]
        if lacking:
            raise ValueError(f"no column {lacking[0]!r}, which the mapping names as the time")
        return given.time[0], given.time[1] if len(given.time) > 1 else ""
    named = [h for h in look.headings if is_time_heading(h)]
    dates = [h for h in look.headings if look.kinds[h] == TIME]
    clocks = [h for h in look.headings if look.kinds[h] == CLOCK]
    if clocks and dates and not any(":" in cell for cell in look.cells[dates[0]][:1]):
        if len(dates) > 1 or len(clocks) > 1:
            raise ValueError(f"several dates or times of day ({', '.join([*dates, *clocks])}); {HELP}")
        return dates[0], clocks[0]
    best = [h for h in named if h in dates] or dates
    if best:
        source = [h for h in best if "source" in h.lower()]
        return (source or best)[0], ""
    numbers = [h for h in named if look.kinds[h] == NUMBER]
    if numbers:
        return numbers[0], ""
    if look.headings and look.kinds[look.headings[0]] == NUMBER and look.headings[0].startswith("column "):
        return look.headings[0], ""
    raise NotUnderstoodError(
        f"no column of times among {', '.join(h[:40] for h in look.headings[:8])}; expected e.g. `time` with "
        f"2026-11-22T10:00:00; {HELP}"
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
        return None
    _refuse_doubt(tags)
    names = loop_names(list(tags.loops), look.known)
    loops = {names[stem]: roles for stem, roles in tags.loops.items()}
    if any(all(role in roles for role in NEEDED) for roles in loops.values()):
        return _complete(replace(empty, kind=WIDE, unused=tuple(tags.unused)), loops)
    # none is whole here: the other tags may stand in other files
    columns, stems = _all_tags(rest, look.known)
    return replace(empty, kind=TAGS, columns=columns, stems=stems, unused=_roleless(rest))


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
    columns = look.given.tags or _tag_columns(look, rest)
    if not columns:
        return None
    value, quality = _value_and_quality(look, [h for h in rest if h not in columns])
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


def tag_name(cells: Sequence[str]) -> str:
    """Return a tag's full name: its cells with a dot between them."""
    return ".".join(cell.strip() for cell in cells)


def _tag_columns(look: Look, rest: Sequence[str]) -> tuple[str, ...]:
    """Return the headings of the tags: one column, or the loop's and the role's."""
    words = [h for h in rest if look.kinds[h] == WORD]
    tags = [h for h in words if _reads_as_tags(look.cells[h])]
    if len(tags) > 1:
        best = [h for h in tags if heading_key(h) in TAG_WORDS]
        tags = best[:1] if best else tags
    if len(tags) > 1:
        raise ValueError(f"{' and '.join(tags)} may each be the tag; {HELP}")
    if tags:
        return tuple(tags)
    roles = [h for h in words if _roles_alone(look.cells[h])]
    if len(roles) == 1:
        loops = [h for h in rest if h not in roles and heading_key(h) in LOOP_WORDS | TAG_WORDS]
        loops = loops or [h for h in words if h not in roles and heading_key(h) not in QUALITY_WORDS]
        if len(loops) == 1:
            return loops[0], roles[0]
        if len(loops) > 1:
            raise ValueError(f"{' and '.join(loops)} may each be the loop's name; {HELP}")
    return ()


def _reads_as_tags(cells: Sequence[str]) -> bool:
    different = {c for c in cells if c.strip()}
    read = [tag for c in different if (tag := read_tag(c)) is not None]
    return any(tag.role in NEEDED for tag in read) and len(read) >= LEAST_TAGS_SHARE * len(different)


def _roles_alone(cells: Sequence[str]) -> bool:
    different = {c for c in cells if c.strip()}
    roles = {role_of(c) for c in different}
    return {"sp", "pv"} <= roles or {"pv", "op"} <= roles


def _value_and_quality(look: Look, rest: Sequence[str]) -> tuple[str, str]:
    given = look.given
    quality = given.quality or next((h for w in QUALITY_WORDS for h in rest if heading_key(h) == w), "")
    others = [h for h in rest if h != quality and heading_key(h) not in QUALITY_WORDS]
    value = given.value or next((h for w in VALUE_WORDS for h in others if heading_key(h) == w), "")
    if not value:
        numbers = [h for h in others if look.kinds[h] == NUMBER]
        if len(numbers) != 1:
            shown = " and ".join(numbers) or "no column"
            raise ValueError(f"{shown} may be the values of the tags, expected a column `value`; {HELP}")
        value = numbers[0]
    if value not in rest:
        raise ValueError(f"no column {value!r}, which the mapping names as the value")
    return value, quality


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
