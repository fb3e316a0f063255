"""What a tag's name says: whose it is, and which of set point, PV, output, mode, quality. Names only, no data.

A tag is cut at its separators. Its last words (``LIC-101/PID1/OUT.CV``), or its first ones (``PV_LIC101``), are
its role; what is left is its stem, by which the tags of one loop are found together.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

ROLE_WORDS: dict[str, str] = {
    "sp": "sp sv spt setpoint setpointvalue setpunkt sollwert soll wsp csp spv spactual spout spread spint w "
    "fuehrungsgroesse führungsgröße fuhrungsgrosse consigne targetvalue",
    "pv": "pv pvin meas measurement measuredvalue measured processvalue processvariable process istwert ist messwert "
    "regelgroesse regelgröße mess x pvact pvactual pvout pvread mesure",
    "op": "op out mv co cv lmn output outp outputvalue controlleroutput controloutput opout outvalue stellwert "
    "stellgroesse stellgröße stellgrosse manipulatedvariable manipulatedvalue ctrlout ctrloutput controllerout "
    "controlout y cout cveu cvout outactual opact opactual",
    "auto": "mode auto am automan automanual automode modeactual modact actualmode actmode md modus betriebsart "
    "modblkactual modeact controlmode controllermode isauto inauto autostate modest opmode operationmode loopmode "
    "automatic automatik reglerbetriebsart regelart amstatus ma",
    "quality": "quality qual status opcquality opcqual qualitaet qualität dataquality statuscode q confidence sts",
    "": "modetarget targetmode modenormal normalmode modepermitted",
    "?": "man manual hand manmode inman ismanual manuell",
}
"""Words of each role, lower case, without separators. ``""``: known, and not wanted (what mode is asked for is not what
is); ``?``: says something of the mode, the wrong way about, so that it is not to be passed over."""
_ROLE = {word.casefold(): role for role, words in ROLE_WORDS.items() for word in words.split()}
ALONE_ONLY = frozenset("w x y q process mess ist soll hand am ma man auto status sts".split())
"""Words that count as a role only behind a separator, and as nothing at a name's beginning."""
VALUE_WORDS = frozenset(
    "cv value val fcv f_cv current wert aktuell rawvalue displayvalue presentvalue readvalue".split()
)
"""What a system adds to each tag for "the value of it"."""
_SEPARATORS = r"[./:\\|_\-\s]+"
_UNIT = re.compile(r"\s*[\[(][^\[\]()]*[\])]\s*$")
_GLUED = re.compile(r"^(.*\d[A-Za-z]?)(SP|PV|OP|SV|MV|CV|OUT|CO)$", re.IGNORECASE)
MOST_ROLE_WORDS = 3
"""Words that a role has at most: ``set point value``."""


@dataclass(frozen=True, slots=True)
class Tag:
    """A tag's name, read."""

    stem: str
    """What is left of the name without its role: the loop's."""
    role: str
    """``sp``, ``pv``, ``op``, ``auto``, ``quality``; ``""`` or ``?`` as in `ROLE_WORDS`."""
    rank: int = 0
    """The lower the surer, where a loop has two tags of one role."""


@dataclass(slots=True)
class Tags:
    """The loops that tags make up."""

    loops: dict[str, dict[str, str]] = field(default_factory=dict)
    """Stem to role to the tag's full name."""
    unused: list[str] = field(default_factory=list)
    """Names that are no loop's."""
    doubtful: dict[str, str] = field(default_factory=dict)
    """Names that say something of a loop's mode, or are one of two of a role, and why they cannot be used."""


def role_of(words: str) -> str | None:
    """Return the role that words are by themselves, in any spelling; None where they are none.

    Examples
    --------
    >>> role_of("Process_Value"), role_of("A/M"), role_of("flow")
    ('pv', 'auto', None)
    """
    return _ROLE.get(re.sub(_SEPARATORS, "", _UNIT.sub("", words.strip())).casefold())


def read_tag(name: str) -> Tag | None:
    """Read a tag's name: role behind the stem, or before it; None where it says no role.

    Examples
    --------
    >>> read_tag("[default]Area1/LIC-101/PV")
    Tag(stem='[default]Area1/LIC-101', role='pv', rank=1)
    >>> read_tag("LIC-101/PID1/OUT.CV").role, read_tag("LIC-101.CV").role
    ('op', 'op')
    >>> read_tag("PV_LIC101").stem
    'LIC101'
    """
    text = _UNIT.sub("", name.strip())
    parts = [(m.start(), m.end()) for m in re.finditer(r"[^./:\\|_\-\s]+", text)]
    words = [text[a:b].casefold() for a, b in parts]
    if len(words) > 1:
        last = len(words)
        while last > 2 and words[last - 1] in VALUE_WORDS | {"f"} and _role_at(words, last - 1):
            last -= 1
        if last > 3 and words[last - 2 : last] == ["f", "cv"] and _role_at(words, last - 2):
            last -= 2
        found = _role_at(words, last)
        if found is None and last == len(words):  # SP of LIC-101, then the system's word for "value"
            found = _role_at(words, last - 1) if words[-1] in VALUE_WORDS else None
        if found is not None:
            count, role, end = found
            if end - count >= 1:
                return Tag(text[: parts[end - count - 1][1]], role, _rank(words[end - count : end]))
        for count in range(min(MOST_ROLE_WORDS, len(words) - 1), 0, -1):
            word = "".join(words[:count])
            if word in _ROLE and word not in ALONE_ONLY:
                return Tag(text[parts[count][0] :], _ROLE[word], 2)
    glued = _GLUED.match(text)
    if glued and not text[:1].isspace():
        return Tag(glued.group(1), _ROLE[glued.group(2).lower()], 2)
    return None


def _role_at(words: Sequence[str], end: int) -> tuple[int, str, int] | None:
    """Return the role that ends before ``end``: its words, its name, its end."""
    for count in range(min(MOST_ROLE_WORDS, end - 1), 0, -1):
        word = "".join(words[end - count : end])
        if word in _ROLE:
            return count, _ROLE[word], end
    return None


def _rank(words: Sequence[str]) -> int:
    """Return 0 for what is measured, 1 for what is plain: MODE.ACTUAL goes before MODE."""
    return 0 if any("act" in word for word in words) else 1


def loops_of_tags(names: Iterable[str]) -> Tags:
    """Group tags to loops by their stems.

    Examples
    --------
    >>> found = loops_of_tags(["LIC-1.SV", "LIC-1.PV", "LIC-1.MV", "ambient"])
    >>> found.loops, found.unused
    ({'LIC-1': {'sp': 'LIC-1.SV', 'pv': 'LIC-1.PV', 'op': 'LIC-1.MV'}}, ['ambient'])
    """
    out = Tags()
    read: dict[str, dict[str, list[tuple[int, str]]]] = {}
    spelt: dict[str, str] = {}
    for name in names:
        tag = read_tag(name)
        if tag is None:
            out.unused.append(name)
            continue
        stem = spelt.setdefault(tag.stem.casefold(), tag.stem)
        read.setdefault(stem, {}).setdefault(tag.role, []).append((tag.rank, name))
    _qualities_of_tags(read)
    # many systems call the measured value like the loop: LIC-101, LIC-101.SP, LIC-101.OP
    for name in list(out.unused):
        bare = spelt.get(name.strip().casefold(), "")
        if bare and "pv" not in read[bare] and {"sp", "op"} <= set(read[bare]):
            read[bare]["pv"] = [(0, name)]
            out.unused.remove(name)
    for stem, roles in read.items():
        _take(out, stem, roles)
    return out


def _take(out: Tags, stem: str, roles: Mapping[str, list[tuple[int, str]]]) -> None:
    """Decide which tags of one stem are used (in place)."""
    used: dict[str, str] = {}
    out.unused += [name for _, name in roles.get("", [])]
    for role, found in roles.items():
        if role in {"", "?"}:
            continue
        best = min(rank for rank, _ in found)
        first = [name for rank, name in found if rank == best]
        out.unused += [name for rank, name in found if rank > best]
        if len(first) > 1:
            what = f"{' and '.join(first)} may both be the {role.upper()} of {stem}"
            if role == "quality":
                out.unused += first
            else:
                out.doubtful.update(dict.fromkeys(first, what))
        else:
            used[role] = first[0]
    if "pv" not in used and not {"sp", "op"} <= set(used):
        out.unused += [*used.values(), *(name for _, name in roles.get("?", []))]
        return
    for _, name in roles.get("?", []):
        if "auto" in used:
            out.unused.append(name)
        else:
            out.doubtful[name] = (
                f"{name} may say that {stem} is in manual; say what it is in a mapping (--map)"
            )
    out.loops[stem] = used


def _qualities_of_tags(read: dict[str, dict[str, list[tuple[int, str]]]]) -> None:
    """Give a PV's own quality (``LIC-101.PV.QUALITY``) to its loop; those of SP and OP are left (in place)."""
    for stem in list(read):
        if set(read[stem]) != {"quality"}:
            continue
        tag = read_tag(stem)
        if tag is None:
            continue
        home = next((other for other in read if other.casefold() == tag.stem.casefold()), None)
        if home is not None and home != stem:
            role = "quality" if tag.role == "pv" else ""
            read[home].setdefault(role, []).extend(read.pop(stem)["quality"])


# ---------------------------------------------------------------------------------------------------
# what a loop is called

_COMPONENT = r"[^/\\:|.\[\];=]+"
"""Of a path; OPC UA writes ``ns=2;s=LIC-101``."""
_BLOCK_WORDS = r"(?:PID\w{0,4}|DACA|PIDA|CTL\w?|CTRL\w?|REGCTL\w?|BLOCK\d*|FB\d*|PIDCTL\w?|LOOP)"
_BLOCK = re.compile(rf"^{_BLOCK_WORDS}$", re.IGNORECASE)
_CONTROLLER = re.compile(
    r"(?<![A-Za-z0-9])(?:[AFLPTSDWXZ][A-Z]{0,3}C[A-Z]?[-_ ]?\d{1,6}[A-Z]{0,2}(?:[-_]\d{1,3})?)(?![A-Za-z0-9])",
    re.IGNORECASE,
)
"""A controller's tag by ISA-5.1: LIC-101, FC12A, PDIC-7."""


def loop_names(stems: Sequence[str], known: Collection[str] = ()) -> dict[str, str]:
    """Return what each stem's loop is called: as the loop table does, else without the path around it.

    Parameters
    ----------
    stems
        All loops of a file or folder; only what tells them apart is kept.
    known
        Names of the loop table.

    Examples
    --------
    >>> loop_names(["[default]Area1/LIC-101", "[default]Area1/FIC-2"])
    {'[default]Area1/LIC-101': 'LIC-101', '[default]Area1/FIC-2': 'FIC-2'}
    >>> loop_names(["A/LIC-1", "B/LIC-1"])
    {'A/LIC-1': 'A/LIC-1', 'B/LIC-1': 'B/LIC-1'}
    """
    out: dict[str, str] = {}
    if known:
        exact, loose = set(known), _loose(known)
        for stem in stems:
            named = next((part for part in _runs(stem) if part in exact), None)
            named = named or next(
                (loose[_plain(part)] for part in _runs(stem) if _plain(part) in loose), None
            )
            if named is not None:
                out[stem] = named
    rest = [stem for stem in stems if stem not in out]
    for shorten in (_isa_name, _tail, _varying(rest), _without_provider):
        short = {stem: shorten(stem) for stem in rest}
        every = [*out.values(), *short.values()]
        if all(short.values()) and len({name.casefold() for name in every}) == len(every):
            return {stem: out.get(stem) or short[stem] for stem in stems}
    return {stem: out.get(stem, stem) for stem in stems}


def _plain(name: str) -> str:
    return re.sub(_SEPARATORS, "", name).casefold()


def _loose(known: Collection[str]) -> dict[str, str]:
    """Return names by their letters and digits alone, where that is one name."""
    plain: dict[str, list[str]] = {}
    for name in known:
        plain.setdefault(_plain(name), []).append(name)
    return {key: names[0] for key, names in plain.items() if len(names) == 1}


def _components(stem: str) -> list[str]:
    return re.findall(_COMPONENT, stem)


def _runs(stem: str) -> Iterable[str]:
    """Yield the stem, then each run of its components, longest first."""
    yield stem
    spans = [(m.start(), m.end()) for m in re.finditer(_COMPONENT, stem)]
    for n in range(len(spans), 0, -1):
        for k in range(len(spans) - n + 1):
            yield stem[spans[k][0] : spans[k + n - 1][1]]
    found = _CONTROLLER.findall(stem)
    yield from found


def _isa_name(stem: str) -> str:
    """Return the one component that is a controller's tag; empty where there is none, or two."""
    found = [part for part in _components(stem) if _CONTROLLER.fullmatch(part)]
    if len(found) == 1:
        return found[0]
    found = [m.group() for part in _components(stem) for m in [_prefixed(part)] if m]
    return found[0] if len(found) == 1 else ""


def _prefixed(part: str) -> re.Match[str] | None:
    """Find a controller's tag behind a word (``SITE1_LIC101``), not behind a number that belongs to it."""
    found = re.match(r"^[A-Za-z]\w*?[_ -](?=[A-Za-z])", part)
    while found:
        rest = _CONTROLLER.fullmatch(part, found.end())
        if rest:
            return rest
        found = re.match(rf"^.{{{found.end()}}}\w*?[_ -](?=[A-Za-z])", part)
    return None


def _tail(stem: str) -> str:
    """Return the last component that is no block's name."""
    parts = _components(stem)
    while len(parts) > 1 and _BLOCK.match(parts[-1]):
        parts.pop()
    return parts[-1] if parts else ""


def _varying(stems: Sequence[str]) -> Callable[[str], str]:
    """Return what cuts off the components that all stems begin with, and blocks' names at their end."""
    lists = [_components(stem) for stem in stems]
    n = min(map(len, lists), default=1)
    first = next((k for k in range(n) if len({parts[k] for parts in lists}) > 1), 0)

    def cut(stem: str) -> str:
        spans = [(m.start(), m.end()) for m in re.finditer(_COMPONENT, stem)]
        last = len(spans)
        while last > first + 1 and _BLOCK.match(stem[slice(*spans[last - 1])]):
            last -= 1
        return stem[spans[first][0] : spans[last - 1][1]]

    return cut


def _without_provider(stem: str) -> str:
    return re.sub(r"^\[[^\]]*\]", "", stem).lstrip("/\\")
