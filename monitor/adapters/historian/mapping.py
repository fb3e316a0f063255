"""How an export is to be read, as a user says it: ``mapping.toml``, which ``loopsight import`` writes."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from monitor.contract.quality import QUALITY_SCALES

from .layout import LONG, PER_LOOP, ROLES, TAGS, TALL, WIDE
from .table_head import HeadHints
from .time_formats import order_of_format

KINDS = (LONG, PER_LOOP, WIDE, TALL, TAGS)
MODE_WORDS = ("AUTO", "MAN")
KEYS = (
    *("kind", "time", "time_format", "separator", "decimal", "encoding", "header_row", "data_row"),
    *("loop", "tag", "value", "quality", "quality_scale", "columns", "modes"),
)


@dataclass(frozen=True, slots=True)
class ExportMapping:
    """What a user says of an export; what is empty is told by the data."""

    kind: str = ""
    time: tuple[str, ...] = ()
    """Heading of the time, or of date and time of day."""
    time_format: str = ""
    separator: str = ""
    decimal: str = ""
    encoding: str = ""
    header_row: int | None = None
    """Line of the headings, from 1; 0: there is none."""
    data_row: int | None = None
    """First line of data, from 1."""
    loop: str = ""
    tags: tuple[str, ...] = ()
    value: str = ""
    quality: str = ""
    quality_scale: str = ""
    columns: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Heading or tag to loop and role."""
    modes: dict[str, int] = field(default_factory=dict)
    """Text of a mode, lower case, to 1 (automatic) or 0."""

    @property
    def head(self) -> HeadHints:
        """Where the table begins."""
        header = None if self.header_row is None else self.header_row - 1
        data = None if self.data_row is None else self.data_row - 1
        return HeadHints(self.separator or None, header, data)


NO_MAPPING = ExportMapping()


def read_mapping(path: Path) -> ExportMapping:
    """Read a mapping.

    Raises
    ------
    ValueError
        In one line, what is wrong with it.
    OSError
        It cannot be read.
    """
    try:
        facts = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None
    for key in facts:
        if key not in KEYS:
            raise ValueError(f"{path}: {key}: expected one of {', '.join(KEYS)}")
    kind = _text(path, facts, "kind")
    if kind and kind not in KINDS:
        raise ValueError(f"{path}: kind: {kind!r}, expected one of {', '.join(KINDS)}")
    columns = {}
    for name, said in _table(path, facts, "columns").items():
        loop, role = (said.get("loop"), said.get("role")) if isinstance(said, dict) else (None, None)
        if not isinstance(loop, str) or role not in ROLES:
            raise ValueError(
                f'{path}: columns: {name}: {said!r}, expected {{ loop = "LIC-101", role = one of {", ".join(ROLES)} }}'
            )
        columns[name] = (loop, str(role))
    modes = {}
    for name, said in _table(path, facts, "modes").items():
        if said not in MODE_WORDS:
            raise ValueError(f"{path}: modes: {name}: {said!r}, expected AUTO or MAN")
        modes[name.strip().lower()] = int(said == "AUTO")
    return ExportMapping(
        kind=kind,
        time=_texts(path, facts, "time"),
        time_format=_text(path, facts, "time_format"),
        separator=_text(path, facts, "separator"),
        decimal=_text(path, facts, "decimal"),
        encoding=_text(path, facts, "encoding"),
        header_row=_row(path, facts, "header_row"),
        data_row=_row(path, facts, "data_row"),
        loop=_text(path, facts, "loop"),
        tags=_texts(path, facts, "tag"),
        value=_text(path, facts, "value"),
        quality=_text(path, facts, "quality"),
        quality_scale=_scale(path, facts),
        columns=columns,
        modes=modes,
    )


def given_mapping(path: str | Path | None, time_format: str | None) -> ExportMapping:
    """Return what options say of how exports are to be read.

    Parameters
    ----------
    path
        File of the mapping.
    time_format
        Order of day, month and year; goes before the mapping's.

    Raises
    ------
    ValueError
        In one line, what is wrong with them.
    OSError
        The file cannot be read.
    """
    given = NO_MAPPING if path is None else read_mapping(Path(path))
    if time_format is None:
        return given
    order_of_format(time_format)
    return replace(given, time_format=time_format)


def _scale(path: Path, facts: Mapping[str, Any]) -> str:
    scale = _text(path, facts, "quality_scale")
    if scale and scale not in QUALITY_SCALES:
        raise ValueError(f"{path}: quality_scale: {scale!r}, expected one of {', '.join(QUALITY_SCALES)}")
    return scale


def _text(path: Path, facts: Mapping[str, Any], key: str) -> str:
    value = facts.get(key, "")
    if not isinstance(value, str):
        raise ValueError(f"{path}: {key}: {value!r}, expected a text")  # noqa: TRY004 (of a file, not of a program)
    return value


def _texts(path: Path, facts: Mapping[str, Any], key: str) -> tuple[str, ...]:
    value = facts.get(key, [])
    value = [value] if isinstance(value, str) else value
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value) or len(value) > 2:
        raise ValueError(f"{path}: {key}: {value!r}, expected a heading, or a list of two")
    return tuple(value)


def _row(path: Path, facts: Mapping[str, Any], key: str) -> int | None:
    value = facts.get(key)
    if value is not None and (not isinstance(value, int) or isinstance(value, bool) or value < 0):
        raise ValueError(f"{path}: {key}: {value!r}, expected the number of a line, from 1; 0 for none")
    return value


def _table(path: Path, facts: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = facts.get(key, {})
    if not isinstance(value, dict):
        raise ValueError(f"{path}: {key}: {value!r}, expected a table [{key}]")  # noqa: TRY004 (of a file)
    return value


def mapping_text(mapping: ExportMapping, about: str) -> str:
    """Return a mapping as TOML, to be corrected by hand.

    Parameters
    ----------
    about
        Said at its head, as comments.
    """
    lines = [f"# {line}" for line in about.splitlines()]
    facts: list[tuple[str, Any]] = [
        ("kind", mapping.kind),
        ("time", list(mapping.time)),
        ("time_format", mapping.time_format),
        ("separator", mapping.separator),
        ("decimal", mapping.decimal),
        ("encoding", mapping.encoding),
        ("header_row", mapping.header_row),
        ("data_row", mapping.data_row),
        ("loop", mapping.loop),
        ("tag", list(mapping.tags)),
        ("value", mapping.value),
        ("quality", mapping.quality),
        ("quality_scale", mapping.quality_scale),
    ]
    lines += [f"{key} = {_toml(value)}" for key, value in facts if value not in ("", None, [])]
    if mapping.columns:
        lines += ["", "[columns]"]
        for name, (loop, role) in mapping.columns.items():
            lines.append(f"{_toml(name)} = {{ loop = {_toml(loop)}, role = {_toml(role)} }}")
    if mapping.modes:
        lines += ["", "[modes]"]
        lines += [f"{_toml(name)} = {_toml(MODE_WORDS[1 - auto])}" for name, auto in mapping.modes.items()]
    return "\n".join(lines) + "\n"


def _toml(value: str | int | list[str]) -> str:
    """Write a value as TOML: a JSON text is one (but for DEL, which it escapes not)."""
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
