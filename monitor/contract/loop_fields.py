"""One row of a loop table to a Loop: what each column takes."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any

from tuners.blocks import BLOCKS
from tuners.rules import RULES
from tuners.settings import FORMS

from .loops import CONTROLLERS, MOST_NAME_BYTES, OBJECTIVES, PROCESSES, Loop

# ---------------------------------------------------------------------------------------------------
# one row of a table to a Loop

_RESERVED = {"sp", "pv", "op", "auto", "settings", "frame"}
_CHOICES = {"process": PROCESSES, "objective": OBJECTIVES, "controller": CONTROLLERS}
_BOUNDS: dict[str, tuple[float, float, str]] = {
    "ti": (0.0, math.inf, "seconds above 0; empty or inf = no integral action"),
    "td": (-1e-300, 1e9, "seconds, 0 or more"),
    "tf": (-1e-300, 1e9, "seconds, 0 or more"),
    "pv_filter": (-1e-300, 1e9, "seconds, 0 or more"),
    "scan": (0.0, 1e9, "seconds above 0"),
    "closed_loop_time": (0.0, 1e9, "seconds above 0"),
    "period": (0.0, 1e9, "seconds above 0"),
    "ms_max": (1.0, 10.0, "a number from 1 to 10, e.g. 2.2"),
    "ci_min": (0.0, 1.0, "a number above 0 and at most 1, e.g. 0.6"),
    "op_noise_max": (0.0, 100.0, "% of the OP span, above 0"),
    "max_load": (0.0, math.inf, "a change of OP above 0"),
    "max_deviation": (0.0, math.inf, "a deviation of PV above 0"),
}
_NUMBERS = {"b", "c", "kp", "ki", "kd", "pv_low", "pv_high", "op_low", "op_high", *_BOUNDS}
TABLE_COLUMNS = (*Loop.__struct_fields__, "ki", "kd")


def parse_row(row: Mapping[str, Any], forms: Sequence[str] = FORMS) -> tuple[Loop | None, list[str]]:
    """Turn one row of a loop table into a Loop.

    Returns the loop, or None, and what is wrong with the row: ``field: value, expected …``.
    ``forms`` names what the column ``form`` may hold. Unknown columns are left alone.

    Examples
    --------
    >>> loop, wrong = parse_row({"name": "LIC-101", "kp": "2,5", "ti": "80"})
    >>> loop.kp, loop.ti, wrong
    (2.5, 80.0, [])
    >>> parse_row({"name": "LIC-101", "kp": "0"})[1]
    ["kp: '0', expected a number other than 0, signed: op = kp (sp - pv) + ..."]
    """
    wrong: list[str] = []
    facts: dict[str, Any] = {}
    for field in TABLE_COLUMNS:
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
    if field == "name" and len(text.encode()) > MOST_NAME_BYTES:
        raise ValueError(f"at most {MOST_NAME_BYTES} bytes")
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


def known_forms() -> tuple[str, ...]:
    """Return the forms and the ids of the vendor blocks."""
    return (*FORMS, *BLOCKS)


def known_rules() -> tuple[str, ...]:
    """Return the names of the tuning rules."""
    return tuple(RULES)
