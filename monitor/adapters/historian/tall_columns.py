"""Which columns of a tall export are the tag, the value, its quality."""

from __future__ import annotations

from collections.abc import Sequence

from .cell_kinds import NUMBER, WORD
from .layout import LOOP_WORDS, NEEDED, heading_key
from .look import HELP, Look
from .tag_roles import read_tag, role_of

TAG_WORDS = frozenset(
    "tag tagname name path tagpath point pointname pointid id item itemid itemname series seriesname metric "
    "variable signal signalname source sensor address tagid measurement channel fullname kks nodeid "
    "messstelle bezeichnung".split()
)
VALUE_WORDS = tuple(
    "value val v wert messwert iptrendvalue floatvalue reading data tagvalue numericvalue avgvalue samplevalue "
    "valuedouble doublevalue vvalue intvalue".split()
)
"""Headings of the column of values in a tall table, the first goes before the others."""
QUALITY_WORDS = tuple(
    "opcquality quality qualitycode qual q status confidence dataintegrity iptrendqstatus qstatus qualitaet "
    "qualität statuscode sts good isgood qualitydetail valid".split()
)
"""Headings of qualities, likewise: a code of OPC goes before a vendor's."""
LEAST_TAGS_SHARE = 0.2
"""Share of a column's different texts that must read as tags."""


def tag_name(cells: Sequence[str]) -> str:
    """Return a tag's full name: its cells with a dot between them."""
    return ".".join(cell.strip() for cell in cells)


def tag_columns(look: Look, rest: Sequence[str]) -> tuple[str, ...]:
    """Return the headings of the tags: one column, or the loop's and the role's; none where there are none.

    Parameters
    ----------
    rest
        Headings that are no time.

    Raises
    ------
    ValueError
        Several columns may be the tag.
    """
    words = [h for h in rest if look.kinds[h] == WORD]
    tags = [h for h in words if _reads_as_tags(look.cells[h])]
    if len(tags) > 1:
        best = [h for h in tags if heading_key(h) in TAG_WORDS]
        tags = best or tags
        said = {tuple(_role(cell) for cell in look.cells[h]) for h in tags}
        tags = tags[:1] if len(said) == 1 else tags  # a name and its path say the same
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


def _role(cell: str) -> str:
    tag = read_tag(cell)
    return "" if tag is None else tag.role


def _reads_as_tags(cells: Sequence[str]) -> bool:
    different = {c for c in cells if c.strip()}
    read = [tag for c in different if (tag := read_tag(c)) is not None]
    return any(tag.role in NEEDED for tag in read) and len(read) >= LEAST_TAGS_SHARE * len(different)


def _roles_alone(cells: Sequence[str]) -> bool:
    different = {c for c in cells if c.strip()}
    roles = {role_of(c) for c in different}
    return {"sp", "pv"} <= roles or {"pv", "op"} <= roles


def value_and_quality(look: Look, rest: Sequence[str]) -> tuple[str, str]:
    """Return the headings of the values and of their qualities, empty where there are none.

    Parameters
    ----------
    rest
        Headings that are neither time nor tag.

    Raises
    ------
    ValueError
        Several columns may be the values, or none.
    """
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
