"""The loop table: what is known of each loop, checked once, at the door."""

from __future__ import annotations

import csv
import math
import re
import tomllib
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

NAME_BYTES = 200
PROCESSES = ("auto", "integrating", "self-regulating")
OBJECTIVES = ("both", "setpoint", "load", "averaging")
CONTROLLERS = ("p", "pi", "pd", "pid")
FORMS = ("standard", "series", "parallel")


class LoopTableError(ValueError):
    """A loop table that cannot be used; ``problems`` holds one line each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)


class Loop(msgspec.Struct, frozen=True, kw_only=True):
    """One loop. Names, units and defaults are those of the loop table's columns; None = not known."""

    name: str
    key: str = ""
    process: str = "auto"
    objective: str = "both"
    controller: str = ""
    allow_pd: bool = False
    form: str = "standard"
    b: float = 1.0
    c: float = 1.0
    kp: float | None = None
    ti: float = math.inf
    td: float = 0.0
    tf: float | None = None
    pv_low: float | None = None
    pv_high: float | None = None
    op_low: float | None = None
    op_high: float | None = None
    closed_loop_time: float | None = None
    op_noise_max: float = 1.0
    max_load: float | None = None
    max_deviation: float | None = None
    master: str = ""
    period: float | None = None
    ci_min: float = 0.6
    ms_max: float = 2.2
    rule: str = ""
    """Tuning rule for suggestions; empty = the reference rule of the loop's structure."""

    @property
    def structure(self) -> str:
        """What a suggestion may use: as declared, else what the settings have; without settings ``pi``."""
        if self.controller:
            return self.controller
        if self.kp is None:
            return "pi"
        return {(True, False): "pi", (True, True): "pid", (False, False): "p", (False, True): "pd"}[
            (math.isfinite(self.ti), self.td > 0)
        ]

    @property
    def canonical_form(self) -> str:
        """The form that the loop's block computes."""
        if self.form in FORMS:
            return self.form
        from tuners.blocks import BLOCKS  # noqa: PLC0415 (reads a file: only where a block is named)

        return BLOCKS[self.form].form

    @property
    def filter_time(self) -> float:
        """Derivative filter time [s]: as given, else td/10."""
        return (self.td / 10 if self.tf is None else self.tf) if self.td > 0 else 0.0

    @property
    def op_span(self) -> float | None:
        """Span of the output [OP], where both limits are known."""
        if self.op_low is None or self.op_high is None:
            return None
        return self.op_high - self.op_low


def lives_with_offset(loop: Loop) -> bool:
    """Whether an offset is meant: a surge vessel, or a controller declared without integral action."""
    return loop.objective == "averaging" or loop.controller in {"p", "pd"}


class LoopTable:
    """All loops, found by row, name or key."""

    def __init__(self, loops: Iterable[Loop]) -> None:
        self.loops: list[Loop] = []
        self.by_name: dict[str, int] = {}
        self.by_key: dict[str, int] = {}
        self.empty: list[int] = []
        """Rows of loops that were removed, to be taken by the next that are added."""
        for loop in loops:
            self.add(loop)

    def add(self, loop: Loop) -> int:
        """Add a loop and return its row: an empty one, or a new one at the end.

        Raises
        ------
        ValueError
            Its name or key is taken.
        """
        if not loop.key:
            loop = msgspec.structs.replace(loop, key=default_key(loop.name))
        for taken, what in ((self.by_name, loop.name), (self.by_key, loop.key)):
            if what in taken:
                raise ValueError(f"loop {loop.name!r}: {what!r} is already taken by another loop")
        row = self.empty.pop() if self.empty else len(self.loops)
        self.by_name[loop.name] = self.by_key[loop.key] = row
        self.loops[row : row + 1] = [loop]
        return row

    def remove(self, row: int) -> None:
        """Forget a loop: its row stays where it is, empty, found by no name and no key."""
        loop = self.loops[row]
        del self.by_name[loop.name], self.by_key[loop.key]
        self.empty.append(row)

    def replace(self, row: int, loop: Loop) -> None:
        """Put new facts (settings) in place of a loop's; name and key stay."""
        old = self.loops[row]
        self.loops[row] = msgspec.structs.replace(loop, name=old.name, key=old.key)

    def __len__(self) -> int:
        return len(self.loops)

    def __getitem__(self, row: int) -> Loop:
        return self.loops[row]

    def __iter__(self) -> Iterator[Loop]:
        return iter(self.loops)


def default_key(name: str) -> str:
    """Return ``plant/<name>`` with all that Zenoh gives a meaning percent-encoded."""

    def encode(match: re.Match[str]) -> str:
        return "".join(f"%{byte:02X}" for byte in match.group().encode())

    # cntrl: C0, DEL and C1; a leading @ would make the chunk verbatim
    return "plant/" + re.sub(r"[/*$?#%\x00-\x1f\x7f-\x9f]|^@", encode, name)


# ---------------------------------------------------------------------------------------------------
# one row of a table to a Loop

_RESERVED = {"sp", "pv", "op", "auto", "settings", "frame"}
_CHOICES = {"process": PROCESSES, "objective": OBJECTIVES, "controller": CONTROLLERS}
_BOUNDS: dict[str, tuple[float, float, str]] = {
    "ti": (0.0, math.inf, "seconds above 0; empty or inf = no integral action"),
    "td": (-1e-300, 1e9, "seconds, 0 or more"),
    "tf": (-1e-300, 1e9, "seconds, 0 or more"),
    "closed_loop_time": (0.0, 1e9, "seconds above 0"),
    "period": (0.0, 1e9, "seconds above 0"),
    "ms_max": (1.0, 10.0, "a number from 1 to 10, e.g. 2.2"),
    "ci_min": (0.0, 1.0, "a number above 0 and at most 1, e.g. 0.6"),
    "op_noise_max": (0.0, 100.0, "% of the OP span, above 0"),
    "max_load": (0.0, math.inf, "a change of OP above 0"),
    "max_deviation": (0.0, math.inf, "a deviation of PV above 0"),
}
_NUMBERS = {"b", "c", "kp", "ki", "kd", "pv_low", "pv_high", "op_low", "op_high", *_BOUNDS}
COLUMNS = (*Loop.__struct_fields__, "ki", "kd")


def parse_row(row: Mapping[str, Any], forms: Sequence[str] = FORMS) -> tuple[Loop | None, list[str]]:
    """Turn one row of a loop table into a Loop.

    Returns the loop, or None, and what is wrong with the row: ``field: value, expected …``.
    ``forms`` names what the column ``form`` may hold. Unknown columns are left alone.
    """
    wrong: list[str] = []
    facts: dict[str, Any] = {}
    for field in COLUMNS:
        value = row.get(field)
        if value is None or (isinstance(value, str) and not value.strip()):
            continue
        if isinstance(value, float) and math.isnan(value):
            continue
        try:
            facts[field] = _value(field, value, forms)
        except ValueError as error:
            wrong.append(f"{field}: {value!r}, expected {error}")
    name = facts.get("name", "")
    if not name and not any(problem.startswith("name:") for problem in wrong):
        wrong.append("name: empty, expected the loop's tag, e.g. LIC-101")
    _settings_of_parallel(facts, wrong)
    for low, high in (("pv_low", "pv_high"), ("op_low", "op_high")):
        if low in facts and high in facts and not facts[low] < facts[high]:
            wrong.append(f"{high}: {facts[high]}, expected a number above {low} = {facts[low]}")
    if wrong:
        return None, wrong
    return Loop(**facts), []


def _settings_of_parallel(facts: dict[str, Any], wrong: list[str]) -> None:
    """Replace ki, kd by ti = kp/ki, td = kd/kp (in place)."""
    ki, kd = facts.pop("ki", None), facts.pop("kd", None)
    if ki is None and kd is None:
        return
    kp = facts.get("kp")
    if facts.get("form") != "parallel":
        wrong.append("ki, kd: given, expected only with form = parallel; other forms take ti, td")
    elif not kp:
        wrong.append("kp: empty, expected a number other than 0 beside ki, kd")
    else:
        if ki:
            facts["ti"] = kp / ki
        if kd:
            facts["td"] = kd / kp
        for field, source in (("ti", "ki"), ("td", "kd")):
            if facts.get(field, 0.0) < 0:
                wrong.append(f"{source}: sign differs from kp = {kp}, expected the sign of kp")


def _value(field: str, value: Any, forms: Sequence[str]) -> Any:
    """Read one cell; ValueError says what is accepted."""
    if field in _NUMBERS:
        return _number(field, value)
    if field == "allow_pd":
        text = str(value).strip().lower()
        if text not in {"true", "false", "1", "0", "yes", "no"}:
            raise ValueError("true or false")
        return text in {"true", "1", "yes"}
    text = unicodedata.normalize("NFC", str(value).strip())
    if field == "name" and len(text.encode()) > NAME_BYTES:
        raise ValueError(f"at most {NAME_BYTES} bytes")
    if field == "key":
        return _key(text)
    accepted = _accepted(field, forms)
    text = text.lower() if field in _CHOICES else text
    if accepted is not None and text not in accepted[0]:
        raise ValueError(accepted[1])
    return text


def _accepted(field: str, forms: Sequence[str]) -> tuple[Sequence[str], str] | None:
    """Return what a column of fixed words takes, and how that is said; None for free text."""
    if field == "form":
        return forms, f"one of {', '.join(FORMS)} or a vendor block's id"
    if field == "rule":
        return known_rules(), "a rule of `loopsight tune --list`, e.g. tyreus-luyben"
    if field in _CHOICES:
        return _CHOICES[field], "one of " + ", ".join(_CHOICES[field])
    return None


def _number(field: str, value: Any) -> float:
    try:
        number = float(str(value).strip().replace(",", "."))
    except ValueError:
        raise ValueError("a number") from None
    low, high, accepted = _BOUNDS.get(field, (-math.inf, math.inf, "a finite number"))
    if math.isnan(number) or not low < number <= high or (math.isinf(number) and field != "ti"):
        raise ValueError(accepted)
    if field == "kp" and number == 0:
        raise ValueError("a number other than 0, signed: op = kp (sp - pv) + ...")
    return number


def _key(text: str) -> str:
    chunks = text.split("/")
    if not all(chunks) or re.search(r"[*$?#]", text):
        raise ValueError("a Zenoh key without wildcards and empty chunks, e.g. plant/area1/LIC-101")
    if chunks[-1] in _RESERVED:
        raise ValueError("a key whose last chunk is none of " + ", ".join(sorted(_RESERVED)))
    return text


# ---------------------------------------------------------------------------------------------------
# files


def read_loop_table(path: Path | str) -> LoopTable:
    """Read ``.csv``, ``.toml`` (tables ``[[loop]]``) or ``.parquet``.

    Raises
    ------
    LoopTableError
        With every problem of the file: ``file:row: field: value, expected …``.
    OSError
        The file cannot be read.
    """
    path = Path(path)
    table, problems = LoopTable([]), []
    try:
        rows = _rows(path)
    except (UnicodeDecodeError, csv.Error, tomllib.TOMLDecodeError, ValueError) as error:
        raise LoopTableError([f"{path}: {error}"]) from None
    forms = known_forms()
    for number, row in rows:
        loop, wrong = parse_row(row, forms)
        problems += [f"{path}:{number}: {what}" for what in wrong]
        if loop is None:
            continue
        try:
            table.add(loop)
        except ValueError as error:
            problems.append(f"{path}:{number}: name: {error}, expected a unique name and key")
    if problems:
        raise LoopTableError(problems)
    if not len(table):
        raise LoopTableError([f"{path}: no loop in it, expected a row per loop with a column `name`"])
    return table


def known_forms() -> tuple[str, ...]:
    """Return the forms and the ids of the vendor blocks."""
    from tuners.blocks import BLOCKS  # noqa: PLC0415 (reads a file: only where a table is read)

    return (*FORMS, *BLOCKS)


def known_rules() -> tuple[str, ...]:
    """Return the names of the tuning rules."""
    from tuners.rules import RULES  # noqa: PLC0415 (half of the tuners: only where a rule is named)

    return tuple(RULES)


def _rows(path: Path) -> list[tuple[int, dict[str, Any]]]:
    """Read the rows with the line (CSV) or running number by which a user finds them."""
    if path.suffix == ".toml":
        tables = tomllib.loads(path.read_text(encoding="utf-8")).get("loop", [])
        if not isinstance(tables, list):
            raise ValueError("loop: expected tables [[loop]]")
        return list(enumerate(tables, 1))
    if path.suffix == ".parquet":
        import pandas as pd  # noqa: PLC0415 (half a second, only for this format)

        records = pd.read_parquet(path).to_dict("records")
        return [(n, {str(k): v for k, v in r.items()}) for n, r in enumerate(records, 1)]
    with path.open(encoding="utf-8-sig", newline="") as file:
        head = file.readline()
        file.seek(0)
        reader = csv.DictReader(file, delimiter=";" if head.count(";") > head.count(",") else ",")
        if reader.fieldnames is None or "name" not in [f.strip() for f in reader.fieldnames]:
            raise ValueError(f"no column `name` in its header, expected some of {', '.join(COLUMNS)}")
        reader.fieldnames = [f.strip() for f in reader.fieldnames]
        return [(reader.line_num, row) for row in reader]
