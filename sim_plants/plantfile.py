"""Plant files: loops described in TOML.

Each table `[[loop]]` holds the fields of `Plant`, `Controller` and `LoopSpec` side by side; a schedule is a
table of its own::

    [[loop]]
    name = "LIC-101"
    process = "integrating"
    gain = -0.02
    dead_time = 4.5
    lags = [3.0, 1.0]
    kp = -2.5
    ti = 60.0
    setpoint = { times = [100.0, 700.0], sizes = [2.0, -2.0], repeat = 1200.0 }
"""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from sim_plants.controllers import Controller
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec, Steps

_SCHEDULES = ("setpoint", "load", "modes", "output")
_TEXTS = ("name", "process", "form", "anti_windup", "objective", "unit", "tuning")
_LISTS = ("lags", "inverse", "times", "sizes")
_FLAGS = ("auto", "allow_pd")
_PARALLEL = ("ki", "kd")


class PlantFileError(ValueError):
    """A plant file that cannot be used; `problems` holds one line each."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = list(problems)
        super().__init__("\n".join(self.problems))


def load_plant_file(path: Path | str) -> list[LoopSpec]:
    """Read loops from a TOML file.

    Raises
    ------
    PlantFileError
        With every problem of the file: file, loop, field, value, what is expected.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PlantFileError([f"{path}: {error}"]) from None
    tables = content.get("loop")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise PlantFileError([f"{path}: loop: expected at least one table [[loop]]"])
    loops: list[LoopSpec] = []
    problems = [f"{path}: {key}: expected tables [[loop]] only" for key in content if key != "loop"]
    for number, table in enumerate(tables, 1):
        where = f"{path}: loop {number} ({table.get('name', 'no name')})"
        loop, wrong = _loop(table)
        problems += [f"{where}: {what}" for what in wrong]
        if loop is None:
            continue
        if any(loop.name == other.name for other in loops):
            problems.append(f"{where}: name: {loop.name!r}, expected a name that no other loop has")
        loops.append(loop)
    if problems:
        raise PlantFileError(problems)
    return loops


def _loop(table: Mapping[str, Any]) -> tuple[LoopSpec | None, list[str]]:
    """Return a loop, or None, and what is wrong with its table."""
    wrong: list[str] = []
    values = {key: _value(key, value, wrong) for key, value in table.items()}
    _convert_parallel(values, wrong)
    parts: dict[str, Any] = {}
    for name, kind in (("plant", Plant), ("controller", Controller)):
        own = {key: values.pop(key) for key in _names(kind) if key in values}
        parts[name] = _make(kind, own, "", wrong)
    for key in _SCHEDULES:
        if key in values:
            values[key] = _make(Steps, values[key] or {}, f"{key}.", wrong)
    if wrong:
        return None, wrong
    loop = _make(LoopSpec, values | parts, "", wrong)
    return loop, wrong


def _names(kind: type) -> list[str]:
    return [field.name for field in fields(kind)]


def _make(kind: type, values: Mapping[str, Any], prefix: str, wrong: list[str]) -> Any:
    """Return an object of a dataclass, or None and say in `wrong` what it did not like."""
    known = _names(kind)
    unknown = [key for key in values if key not in known]
    missing = [
        field.name
        for field in fields(kind)
        if field.default is MISSING and field.default_factory is MISSING and field.name not in values
    ]
    wrong += [f"{prefix}{key}: unknown, expected one of {', '.join(_accepted(kind))}" for key in unknown]
    wrong += [f"{prefix}{key}: missing, expected a value" for key in missing]
    if unknown or missing or any(value is None for value in values.values()):
        return None
    try:
        return kind(**values)
    except ValueError as error:
        # Loops name themselves in their own message; here the place says it already.
        wrong.append(prefix + str(error).removeprefix(f"loop {values.get('name')!r}: "))
    return None


def _accepted(kind: type) -> list[str]:
    if kind is not LoopSpec:
        return _names(kind)
    parts = [name for name in _names(LoopSpec) if name not in {"plant", "controller"}]
    return [*parts, *_names(Plant), *_names(Controller), *_PARALLEL]


def _value(key: str, value: Any, wrong: list[str]) -> Any:
    """Return a value of the right kind, or None and say in `wrong` what is expected."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    expected, ok, result = "a number", number, value
    if key in _TEXTS:
        expected, ok = "text", isinstance(value, str)
    elif key in _FLAGS:
        expected, ok = "true or false", isinstance(value, bool)
    elif key == "seed":
        expected, ok = "a whole number, 0 or more", isinstance(value, int) and number and value >= 0
    elif key in _SCHEDULES:
        expected, ok = "a table with times, sizes and, if it shall repeat, repeat", isinstance(value, dict)
        if ok:
            result = {name: _value(name, part, wrong) for name, part in value.items()}
    elif key in _LISTS:
        expected = "a list of numbers"
        ok = isinstance(value, list) and all(isinstance(v, int | float) for v in value)
        result = tuple(float(v) for v in value) if ok else None
    elif ok:
        result = float(value)
    if not ok:
        wrong.append(f"{key}: {value!r}, expected {expected}")
        return None
    return result


def _convert_parallel(values: dict[str, Any], wrong: list[str]) -> None:
    """Replace `ki` and `kd` of the parallel form by `ti = kp/ki` and `td = kd/kp`, in place."""
    gains = {key: values.pop(key) for key in _PARALLEL if key in values}
    kp = values.get("kp")
    for key, value in gains.items():
        if values.get("form") != "parallel":
            wrong.append(f'{key}: {value!r}, expected only with form = "parallel"')
        elif value and kp and value * kp < 0:
            wrong.append(f"{key}: {value!r}, expected the sign of kp ({kp!r})")
        elif value and kp:
            values |= {"ti": kp / value} if key == "ki" else {"td": value / kp}
