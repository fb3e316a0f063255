"""The shapes of a historian export: which column holds what. Names only, no data."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

NEEDED = ("sp", "pv", "op")
ROLES = (*NEEDED, "auto", "quality")
TIME_HEADINGS = ("time", "timestamp", "datetime", "date_time")
"""Accepted headings of the time column, the contract's first."""
_TIME_WORDS = frozenset(
    "time timestamp datetime dateandtime date zeit zeitstempel datum datumzeit datumuhrzeit uhrzeit tstamp eventts ts "
    "eventtime eventtimestamp localtime utctime utc timeutc timestamputc timelocal sampletime sourcetimestamp "
    "recordtime logtime datetimestamp iptrendtime t epoch unixtime timems epochms zeitpunkt dt stamp readtime when "
    "messzeit horodatage".split()
)
"""Headings of a time column as systems write them, lower case, without separators."""
LOOP_WORDS = frozenset(
    "loop asset loopname looptag controller controllername equipment regler kreis regelkreis name unit device block "
    "instrument loopid assetname element module tag tagname".split()
)
"""Headings of the column of loops' names, likewise."""
LONG, PER_LOOP, WIDE, TALL, TAGS = "long", "per loop", "wide", "tall", "per tag"
EXPECTED = (
    "columns `loop, time, sp, pv, op` (long), `time, sp, pv, op` (one file per loop) "
    "or `time, <name>.SP, <name>.PV, <name>.OP` (wide)"
)


@dataclass(frozen=True, slots=True)
class Layout:
    """Where a file keeps its loops."""

    kind: str
    """``long``, ``per loop``, ``wide``, ``tall`` (a row per tag and time) or ``per tag`` (columns with times of
    their own, joined over files)."""
    time: str
    """Heading of the time column."""
    columns: dict[str, dict[str, str]]
    """Loop name to role (``sp, pv, op, auto, quality``) to heading, in a tall file to the tag; a long file has the one
    name ``""``."""
    loop: str = ""
    """Heading of the column of names (long)."""
    incomplete: dict[str, str] = field(default_factory=dict)
    """Loops that cannot be read, and what they lack."""
    clock: str = ""
    """Heading of the time of day, where ``time`` is the date."""
    tags: tuple[str, ...] = ()
    """Headings whose cells together are the tag (tall): one, or the loop's and the role's."""
    value: str = ""
    """Heading of the values (tall)."""
    quality: str = ""
    """Heading of their qualities (tall, per tag); empty: none."""
    stems: dict[str, str] = field(default_factory=dict)
    """Loop name to the path by which its tags are called (tall, per tag)."""
    times: dict[str, str] = field(default_factory=dict)
    """Heading of a value to that of its own time (per tag), where not all have ``time``."""
    unused: tuple[str, ...] = ()
    """Columns, or tags, that are not used."""

    @property
    def joins(self) -> bool:
        """Whether samples are joined from series of single tags."""
        return self.kind in {TALL, TAGS}


class LoopTableFoundError(ValueError):
    """A file that is no data, but the table of its loops."""


class BoundsError(ValueError):
    """A file beyond the bounds, or with a heading that stands in it twice: it is not looked at further."""


class NotUnderstoodError(ValueError):
    """A file in which no export is recognised."""


def heading_key(heading: str) -> str:
    """Return a heading's letters and digits, lower case."""
    return re.sub(r"[^a-z0-9äöüß]", "", re.sub(r"[\[(].*?[\])]", "", heading).lower())


def is_time_heading(heading: str) -> bool:
    """Whether a heading is one of a time column.

    Examples
    --------
    >>> is_time_heading("Date-Time"), is_time_heading("t_stamp"), is_time_heading("LIC-101.PV")
    (True, True, False)
    """
    return heading_key(heading) in _TIME_WORDS


def is_loop_table(headings: Collection[str]) -> bool:
    """Whether headings are a loop table's: names, and neither times nor values."""
    return "name" in headings and "value" not in headings and not any(map(is_time_heading, headings))


def layout_of(headings: Sequence[str], path: Path, names: Collection[str] = ()) -> Layout:
    """Tell a file's layout by its headings (any case, any order, further columns allowed).

    Parameters
    ----------
    path
        The file's name is the loop's name in the layout per loop; percent-encoded where a file cannot
        be called like the loop, e.g. ``A%2FB.csv``.
    names
        Names of the loop table, which say whether a percent sign belongs to the name.

    Raises
    ------
    ValueError
        None of the layouts fits, or a heading that is needed stands there twice.

    Examples
    --------
    >>> layout_of(["Time", "LIC-101.SP", "LIC-101.PV", "LIC-101.OP"], Path("export.csv")).kind
    'wide'
    """
    by_key: dict[str, str] = {}
    for heading in headings:
        key = heading.strip().lower()
        if key in by_key and (key in TIME_HEADINGS or key in ROLES or key == "loop" or "." in key):
            twice = f"column {heading!r} stands in it twice"
            # beside each tag there may be a time, or a quality, of its own
            own = key in (*TIME_HEADINGS, "quality") and not _plain(headings)
            raise NotUnderstoodError(twice) if own else BoundsError(twice)
        by_key.setdefault(key, heading)
    time = next((by_key[t] for t in TIME_HEADINGS if t in by_key), None)
    if time is not None:
        for recognise in LAYOUTS:
            found = recognise(by_key, time, path, names)
            if found is not None:
                return found
    shown = ", ".join(h[:40] for h in list(headings)[:8]) + (", ..." if len(headings) > 8 else "")
    raise ValueError(f"columns {shown or '(none)'}, expected {EXPECTED}")


def _plain(headings: Sequence[str]) -> bool:
    """Whether roles stand there as headings by themselves."""
    return set(NEEDED) <= {h.strip().lower() for h in headings}


def normal_name(text: str) -> str:
    """Return a loop's name as the loop table keeps it: NFC, without blanks around it."""
    return unicodedata.normalize("NFC", text.strip())


def _roles(by_key: dict[str, str]) -> dict[str, str]:
    return {role: by_key[role] for role in ROLES if role in by_key}


def _long(by_key: dict[str, str], time: str, _path: Path, _names: Collection[str]) -> Layout | None:
    roles = _roles(by_key)
    if "loop" not in by_key or not all(role in roles for role in NEEDED):
        return None
    return Layout(LONG, time, {"": roles}, loop=by_key["loop"])


def _per_loop(by_key: dict[str, str], time: str, path: Path, names: Collection[str]) -> Layout | None:
    roles = _roles(by_key)
    if "loop" in by_key or not all(role in roles for role in NEEDED):
        return None
    name = normal_name(path.stem)
    return Layout(PER_LOOP, time, {name if name in names else normal_name(unquote(name)): roles})


def _wide(by_key: dict[str, str], time: str, _path: Path, _names: Collection[str]) -> Layout | None:
    loops: dict[str, dict[str, str]] = {}
    for key, heading in by_key.items():
        stem, dot, role = key.rpartition(".")
        if dot and stem and role in ROLES:
            name = normal_name(heading.strip()[: -len(role) - 1])
            loops.setdefault(name, {})[role] = heading
    if not any("pv" in roles for roles in loops.values()):
        return None
    incomplete = {}
    for name, roles in loops.items():
        lacking = [f"{name}.{role.upper()}" for role in NEEDED if role not in roles]
        if lacking:
            incomplete[name] = f"no column {', '.join(lacking)}"
    complete = {name: roles for name, roles in loops.items() if name not in incomplete}
    return Layout(WIDE, time, complete, incomplete=incomplete)


LAYOUTS: tuple[Callable[[dict[str, str], str, Path, Collection[str]], Layout | None], ...] = (
    _long,
    _per_loop,
    _wide,
)
"""Tried in this order; the first that recognises the headings reads the file."""
