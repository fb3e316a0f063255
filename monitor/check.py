"""``loopsight check``: every problem of a configuration, loop table or data file, before it is used.

Arrow, and what is compiled, is imported only for a file that needs it.
"""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from monitor.adapters.historian.clock import zone_of
from monitor.adapters.historian.layout import TAGS, is_loop_table
from monitor.adapters.historian.mapping import NO_MAPPING, ExportMapping
from monitor.adapters.historian.rows import Tally, UnusableError
from monitor.adapters.historian.tag_roles import read_tag
from monitor.adapters.loop_table import read_loop_table, unknown_columns
from monitor.check_controller import Sample, looked_at
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable, LoopTableError
from monitor.contract.samples import Samples
from monitor.contract.table_words import is_mistaken
from monitor.contract.text import short
from monitor.contract.times import iso
from monitor.contract.unit_mismatch import unit_mismatch
from monitor.service.config import problems

if TYPE_CHECKING:
    from monitor.adapters.historian.source import Source

MOST_PROBLEMS = 50
"""Problems of one kind in one file that are named; the rest is counted."""


@dataclass(slots=True)
class Finding:
    """What a file is, and what is wrong with it."""

    what: str = ""
    """In one line, what was found; empty where nothing could be read."""
    problems: list[str] = field(default_factory=list)
    """``file:row: field: value, expected ...``."""
    notes: list[str] = field(default_factory=list)
    """What is worth knowing, and no fault."""
    loops: dict[str, Loop] = field(default_factory=dict)
    """Of a loop table, by name."""
    names: list[str] = field(default_factory=list)
    """Of the loops of a data file, by their samples' numbers."""
    sample: Sample | None = None
    """Of a data file's samples."""


def check_file(
    path: Path, tz: str | None = None, time_unit: str | None = None, given: ExportMapping = NO_MAPPING
) -> Finding:
    """Check a configuration (``.toml``; Zenoh's own: ``.json5``), a loop table or a data file.

    Parameters
    ----------
    tz
        Zone of times that name none; default UTC.
    time_unit
        Unit of numeric times: ``s``, ``ms``, ``us``, ``ns`` or ``excel``.
    given
        What the user says of data files.

    Raises
    ------
    ValueError
        There is no zone of that name.
    """
    if not path.is_file():
        return Finding(problems=[f"{path}: no such file"])
    try:
        if path.suffix == ".json5":
            return _zenoh(path)
        if path.suffix == ".toml":
            text = path.read_text(encoding="utf-8")
            return _table(path) if isinstance(tomllib.loads(text).get("loop"), list) else _config(path)
        return _table(path) if _has_names(path) else _data(path, tz, time_unit, given)
    except tomllib.TOMLDecodeError as error:
        return Finding(problems=[f"{path}: {error}"])
    except (OSError, UnicodeDecodeError) as error:
        return Finding(problems=[f"{path}: {error}"])


def check_controllers(found: Sequence[tuple[Path, Finding]]) -> Iterator[tuple[Path, Finding]]:
    """Hold the settings of loop tables against a sample of the data that are given with them, or lie beside them.

    Parameters
    ----------
    found
        What was found of each file.
    """
    loops = {name: loop for _, finding in found for name, loop in finding.loops.items()}
    for path, finding in found:
        if finding.sample is None:
            continue
        table = loops or _beside(path)
        wrong, notes = looked_at(finding.names, finding.sample, table)
        wrong += _units(finding, table)
        yield (
            path,
            Finding(
                problems=[f"{path}: {line}" for line in wrong[:MOST_PROBLEMS]],
                notes=[f"{path}: {line}" for line in notes[:MOST_PROBLEMS]],
            ),
        )


def _units(finding: Finding, table: dict[str, Loop]) -> Iterator[str]:
    """Name the loops whose SP and PV look like different units."""
    for code, name in enumerate(finding.names):
        for window, _ in finding.sample.windows(code)[:1] if finding.sample is not None else []:
            if said := unit_mismatch(table.get(name) or Loop(name=name), window.sp, window.pv):
                yield f"loop {name}: {said}"


def _beside(path: Path) -> dict[str, Loop]:
    """Return the loops of a loop table that lies beside a data file, by name."""
    for suffix in (".csv", ".toml", ".parquet"):
        beside = path.with_name(f"loops{suffix}")
        if beside.is_file() and beside != path:
            try:
                return {loop.name: loop for loop in read_loop_table(beside)}
            except (LoopTableError, OSError):
                return {}
    return {}


def _config(path: Path) -> Finding:
    return Finding("configuration", problems(path))


def _zenoh(path: Path) -> Finding:
    from monitor.adapters.zenoh_bus import read_config  # noqa: PLC0415 (the library takes its time)

    try:
        read_config(str(path))
    except OSError as error:
        return Finding("configuration of Zenoh", str(error).splitlines())
    return Finding("configuration of Zenoh")


def _has_names(path: Path) -> bool:
    """Whether the file is a loop table: a column ``name``, and no time."""
    from monitor.adapters.historian.reader import headings  # noqa: PLC0415 (pyarrow)

    return path.suffix.lower() != ".xlsx" and is_loop_table([h.lower() for h in headings(path)])


def _table(path: Path) -> Finding:
    try:
        table = read_loop_table(path)
    except LoopTableError as error:
        return Finding("loop table", error.problems)
    known = sum(loop.kp is not None for loop in table)
    what = f"loop table: {counted(len(table), 'loop')}, {known} with settings"
    columns = unknown_columns(path)
    wrong = [line for line in columns if is_mistaken(line)]
    notes = [line for line in columns if line not in wrong]
    return Finding(what, [*_unused(path, table), *wrong], notes, loops={loop.name: loop for loop in table})


def _unused(path: Path, table: LoopTable) -> list[str]:
    """Name the tuning rules that suggestions will not use, as far as the table tells."""
    ruled = [loop for loop in table if loop.rule]
    if not ruled:
        return []
    from monitor.advise.candidates import rule_mismatch  # noqa: PLC0415 (compiles: only where a rule is named)

    wrong = [(loop, why) for loop in ruled if (why := rule_mismatch(loop, loop.process))]
    return [f"{path}: loop {loop.name}: rule: {loop.rule!r} is not used: {why}" for loop, why in wrong]


def _data(path: Path, tz: str | None, time_unit: str | None, given: ExportMapping) -> Finding:
    """Read all of a data file as the audit would."""
    from monitor.adapters.historian.merge import OutOfOrderError, Span, in_order, sorted_samples  # noqa: PLC0415
    from monitor.adapters.historian.reader import inspect, scan  # noqa: PLC0415 (pyarrow)
    from monitor.adapters.historian.reading import reading_of, settled, unused_of  # noqa: PLC0415 (pyarrow)

    span = Span(zone=zone_of(tz or "UTC"))
    try:
        [source] = settled([inspect(path, unit=time_unit, given=given)])
        if alone := _alone(source):
            return Finding(alone)
        names = sorted(set().union(*scan(source))) if source.layout.loop else source.loops
        wanted = {name: k for k, name in enumerate(names)}
        tally, order, sample = Tally(), "in order", Sample()
        try:
            facts = _facts(sample.watched(in_order([source], wanted, span, tally)), len(names))
        except OutOfOrderError:
            tally, sample = Tally(), Sample()
            order = "local times" if span.zone is not None else "out of order (will be sorted)"
            facts = _facts(sample.watched(sorted_samples([source], wanted, span, tally)), len(names))
    except UnusableError as error:
        return Finding(problems=[str(error)])
    out = Finding(
        f"{source.layout.kind}, {counted(len(names), 'loop')}, {facts}, {order}{_notes(source, tally, tz)}",
        names=names,
        sample=sample,
    )
    if source.recognised:
        out.notes.append(f"{path}: read as {reading_of(source)}")
    if source.layout.unused:
        out.notes.append(f"{path}: {unused_of(source.layout)}")
    out.problems += _names_wrong(path, names)
    for name, reason in source.layout.incomplete.items():
        out.problems.append(f"{path}: loop {name}: {reason}")
    out.problems += [f"{path}:{n}: {reason}" for n, reason in sorted(tally.lines.get(str(path), {}).items())]
    out.problems += _places(source, tally)
    if not tally.loop_rows:
        out.problems.append(f"{path}: no sample in it, expected rows with time, sp, pv and op")
    return out


def _alone(source: Source) -> str:
    """Say of a file that is a single tag's that its loop's others stand elsewhere; empty for any other file."""
    layout = source.layout
    if layout.kind != TAGS or len(layout.incomplete) != 1 or len(layout.stems) != 1 or layout.columns:
        return ""
    name = next(iter(layout.incomplete))
    tag = read_tag(source.path.stem)
    return (
        ""
        if tag is None
        else f"per tag, {tag.role.upper()} of loop {name}; its other tags are in other files"
    )


def _facts(batches: Iterator[Samples], loops: int) -> str:
    """Count samples; say their span and their period, by the first steps of each loop."""
    n, first, last = 0, np.iinfo(np.int64).max, np.iinfo(np.int64).min
    periods = np.full(loops, np.nan)
    for samples in batches:
        n += len(samples)
        first, last = min(first, samples.time.min()), max(last, samples.time.max())
        if np.isnan(periods).any():
            order = np.argsort(samples.loop, kind="stable")
            loop, steps = samples.loop[order], np.diff(samples.time[order]) * 1e-9
            for code in np.unique(loop[np.isnan(periods[loop])]):
                own = steps[(loop[1:] == code) & (loop[:-1] == code)]
                periods[code] = np.median(own) if len(own) else np.nan
    if not n:
        return "no samples"
    known = np.unique(np.round(periods[~np.isnan(periods)], 6))
    period = (
        "" if not len(known) else f", period {known[0]:g}" + (f" to {known[-1]:g}" if len(known) > 1 else "")
    )
    begin, end = (iso(int(t), "ms") for t in (first, last))
    if abs(first) < 10**17:  # seconds from a start rather than times of day
        begin, end = f"{first * 1e-9:g} s", f"{last * 1e-9:g} s"
    return f"{n} rows, {begin} to {end}{period}{' s' if period else ''}"


def _notes(source: Source, tally: Tally, tz: str | None) -> str:
    """Say what is worth knowing and no fault of the file."""
    roles = set().union(*source.layout.columns.values())
    notes = [
        "" if not source.clock.naive else f"times without zone, read as {tz or 'UTC'}",
        "" if "quality" in roles else "quality unknown",
        counted(tally.duplicate, "repeated row") if tally.duplicate else "",
        f"{tally.conflict} of them with other values (the first is kept)" if tally.conflict else "",
    ]
    return "".join(f", {note}" for note in notes if note)


def _names_wrong(path: Path, names: list[str]) -> list[str]:

    wrong = []
    for name in names:
        wrong += [f"{path}: loop: {short(what)}" for what in parse_row({"name": name})[1]]
    return wrong[:MOST_PROBLEMS]


def _places(source: Source, tally: Tally) -> list[str]:
    """Find where cells stand that are no values or no times: the first ones by line, the others counted."""
    if not tally.texts and not tally.times:
        return []
    if source.format != "csv":
        times = [
            f"{source.name}: {source.layout.time}: {text!r}, expected a time" for text in sorted(tally.times)
        ]
        texts = [
            f"{source.name}: {text!r} in {counted(n, 'cell')}, expected numbers"
            for text, n in sorted(tally.texts.items())
        ]
        return times[:MOST_PROBLEMS] + texts[:MOST_PROBLEMS]
    out = _lines(source, _accepted(source, tally))
    more = tally.bad_texts + tally.bad_time - len(out)
    return out + ([f"{source.name}: {more} more cells that cannot be read"] if more > 0 else [])


def _accepted(source: Source, tally: Tally) -> dict[tuple[str, str], str]:
    """Return what would be accepted: by heading, and by the text that stands there instead."""
    out = {(source.layout.time, text): "a time, e.g. 2026-11-22T10:00:00Z" for text in tally.times}
    if source.layout.value:
        out |= {(source.layout.value, text): "a number" for text in tally.texts}
    for roles in source.layout.columns.values():
        for role, heading in roles.items():
            if role != "quality":  # any text says something of quality
                what = "AUTO, MAN, true, false, 1 or 0" if role == "auto" else "a number"
                out |= {(heading, text): what for text in tally.texts}
    return out


def _lines(source: Source, accepted: dict[tuple[str, str], str]) -> list[str]:
    out: list[str] = []
    encoding = "utf-8-sig" if source.encoding == "utf8" else source.encoding
    with source.path.open(encoding=encoding, errors="replace", newline="") as file:
        reader = csv.reader(file, delimiter=source.delimiter)
        for _ in range(source.skip):
            next(reader, None)
        for row in reader:
            for heading, cell in zip(source.headings, row, strict=False):
                expected = accepted.get((heading, cell.strip()[:40]))
                if expected:
                    out.append(
                        f"{source.name}:{reader.line_num}: {heading}: {cell[:40]!r}, expected {expected}"
                    )
            if len(out) >= MOST_PROBLEMS:
                break
    return out


def counted(n: int, what: str) -> str:
    """Say how many of something: ``1 loop``, ``2 loops``."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
