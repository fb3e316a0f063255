"""``loopsight import``: how an export is understood, to be looked at and corrected before anything is judged.

Writes ``mapping.toml``, which ``audit`` and ``check`` take by ``--map``, and a loop table to be completed. What is
guessed or seen stands there as a remark: until someone who knows has confirmed it, the audit goes by the data.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from monitor.adapters.files import write_text
from monitor.adapters.historian.clock import DAY_FIRST, MONTH_FIRST, YEAR_FIRST, zone_of
from monitor.adapters.historian.layout import ROLES, TAGS
from monitor.adapters.historian.mapping import NO_MAPPING, ExportMapping, mapping_text
from monitor.adapters.historian.merge import OutOfOrderError, Span, in_order, sorted_samples
from monitor.adapters.historian.reading import reading_of, tag_of, unused_of
from monitor.adapters.historian.rows import Tally, UnusableError
from monitor.adapters.historian.source import Source
from monitor.audit.inputs import Inputs, find
from monitor.check_controller import Sample, controller_in
from monitor.contract.loops import Loop
from monitor.contract.samples import QUALITY_UNCERTAIN, Samples
from monitor.contract.text import inert, visible
from monitor.contract.times import iso

FORMATS = {DAY_FIRST: "%d/%m/%Y %H:%M:%S", MONTH_FIRST: "%m/%d/%Y %H:%M:%S", YEAR_FIRST: "%Y/%m/%d %H:%M:%S"}
MOST_SHOWN_FILES = 3
"""Files read alike of which the reading is printed."""
OP_PERCENT = (0.0, 100.0)
"""[OP] Range that is guessed where all outputs lie within it and more than one of them is above 1.5."""
LEAST_PERCENT = 1.5
"""[OP] Below it an output may be a share from 0 to 1."""
INTEGRATING_LETTERS = ("L",)
"""First letters of tags by ISA-5.1 whose process is guessed to be integrating: level."""
MOST_CONTROLLERS = 200
"""Loops whose settings are looked for: a tenth of a second each. The audit finds those of all."""
COLUMNS = ("name", "process", "op_low", "op_high", "kp", "ti", "td")
REMARKS = (
    *("#process_guess", "#op_range_guess", "#kp_seen", "#ti_seen", "#td_seen"),
    *("#pv_seen", "#op_seen", "#period_s", "#samples"),
)
HOW_TO_COMPLETE = (
    "loops.csv: what is guessed or seen stands in columns that begin with #, and is not used; put what is right into "
    "process, op_low, op_high, kp [OP/PV], ti [s], td [s]"
)


@dataclass(slots=True)
class Seen:
    """What the data show of a loop."""

    n: int = 0
    pv: tuple[float, float] = (np.inf, -np.inf)
    op: tuple[float, float] = (np.inf, -np.inf)
    period: float = np.nan
    """[s]"""
    sample: tuple[int, float, float, float, bool] | None = None
    """Time [ns since 1970], SP, PV, OP, automatic: its first good one."""
    settings: tuple[float, float, float] | None = None
    """kp [OP/PV], ti, td [s] of the controller as OP shows it."""

    def take(self, samples: Samples) -> None:
        """Take in samples of this loop, good and bad."""
        good = np.isfinite(samples.sp) & np.isfinite(samples.pv) & np.isfinite(samples.op)
        good &= samples.quality >= QUALITY_UNCERTAIN
        self.n += len(samples)
        if not good.any():
            return
        pv, op = samples.pv[good], samples.op[good]
        self.pv = (min(self.pv[0], float(pv.min())), max(self.pv[1], float(pv.max())))
        self.op = (min(self.op[0], float(op.min())), max(self.op[1], float(op.max())))
        if np.isnan(self.period) and len(samples) > 1:
            self.period = float(np.median(np.diff(samples.time))) * 1e-9
        if self.sample is None:
            k = int(np.argmax(good))
            self.sample = (
                int(samples.time[k]), float(samples.sp[k]), float(samples.pv[k]), float(samples.op[k]),
                bool(samples.auto[k]),
            )  # fmt: skip


@dataclass(slots=True)
class Imported:
    """What was understood, and where it is written."""

    exit_code: int
    lines: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)


def run_import(
    paths: Sequence[str | Path],
    out: Path,
    tz: str | None = None,
    time_unit: str | None = None,
    given: ExportMapping = NO_MAPPING,
) -> Imported:
    """Read exports, say how they are understood, and write ``mapping.toml`` and ``loops.csv``.

    Parameters
    ----------
    paths
        Files, folders, globs.
    out
        Folder; is made where it does not exist.
    tz
        Zone of times that name none; None: UTC.
    time_unit
        Unit of numeric times, where the user names it.
    given
        What the user says of the files.

    Raises
    ------
    ValueError
        There is no zone of that name.
    OSError
        ``out`` cannot be written to.
    """
    span = Span(zone=zone_of(tz or "UTC"))
    inputs = find(paths, None, out, time_unit, given)
    problems = [*inputs.problems, *map(str, inputs.files_left)]
    for source in inputs.sources:
        problems += [
            f"{source.name}: loop {visible(n)}: {why}" for n, why in source.layout.incomplete.items()
        ]
    if not inputs.sources or not len(inputs.loops):
        return Imported(2, problems=problems or ["no loop found"])
    tally = Tally()
    try:
        seen = _seen(inputs, span, tally)
    except UnusableError as error:
        return Imported(2, problems=[*problems, str(error)])
    lines = _lines(inputs, seen, tz)
    out.mkdir(parents=True, exist_ok=True)
    about = "\n".join(
        ["How these exports are read; correct it and give it to audit and check by --map.", *lines]
    )
    write_text(out / "mapping.toml", mapping_text(mapping_of(inputs.sources), visible_lines(about)))
    write_text(out / "loops.csv", loop_table_text(seen))
    lines.append(HOW_TO_COMPLETE)
    if len(seen) > MOST_CONTROLLERS:
        lines.append(
            f"settings were looked for in {MOST_CONTROLLERS} of {len(seen)} loops; the audit finds those of all"
        )
    return Imported(0, lines, problems, [out / "mapping.toml", out / "loops.csv"])


def visible_lines(text: str) -> str:
    """Return text of several lines for a file: what does not print, as an escape."""
    return "\n".join(visible(line) for line in text.splitlines())


def _seen(inputs: Inputs, span: Span, tally: Tally) -> dict[str, Seen]:
    """Read all samples, and keep what they show of each loop."""
    names = [loop.name for loop in inputs.loops]
    wanted = {name: k for k, name in enumerate(names)}
    try:
        return _kept(in_order(inputs.sources, wanted, span, tally), names)
    except OutOfOrderError:
        return _kept(sorted_samples(inputs.sources, wanted, span, Tally()), names)


def _kept(batches: Iterable[Samples], names: list[str]) -> dict[str, Seen]:
    seen = {name: Seen() for name in names}
    sample = Sample()
    for samples in batches:
        for code, own in samples.by_loop():
            seen[names[code]].take(own)
            if code < MOST_CONTROLLERS:
                sample.add(code, own)
    for code, name in enumerate(names[:MOST_CONTROLLERS]):
        found = controller_in(sample, code, Loop(name=name))
        if found is not None and found.settings is not None:
            seen[name].settings = (found.kp.value, found.ti.value, found.td.value)
    return seen


def _lines(inputs: Inputs, seen: dict[str, Seen], tz: str | None) -> list[str]:
    """Say how each file is read, and each loop by its first good sample."""
    lines = []
    for source in inputs.sources[:MOST_SHOWN_FILES]:
        lines.append(f"{source.name}: {reading_of(source)}")
        if unused_of(source.layout):
            lines.append(f"{source.name}: {unused_of(source.layout)}")
    if len(inputs.sources) > MOST_SHOWN_FILES:
        lines.append(f"... and {len(inputs.sources) - MOST_SHOWN_FILES} more files")
    if any(source.clock.naive for source in inputs.sources):
        lines.append(f"times without zone are read as {tz or 'UTC (name another by --tz)'}")
    for name, found in seen.items():
        if found.sample is None:
            lines.append(f"loop {name}: no good sample")
            continue
        time, sp, pv, op, auto = found.sample
        lines.append(
            f"loop {name}: {found.n} samples; at {iso(time, 'ms')} SP {sp:g}, PV {pv:g}, OP {op:g}, "
            f"{'automatic' if auto else 'manual'}"
        )
    return lines


def mapping_of(sources: Sequence[Source]) -> ExportMapping:
    """Return the mapping by which these files are read again as they were; what differs between them is left open."""
    layouts = [s.layout for s in sources]
    first = sources[0]
    kinds = {layout.kind for layout in layouts}
    columns = {}
    for source in sources:
        for name, roles in source.layout.columns.items():
            for role, heading in roles.items():
                if role in ROLES:
                    columns[tag_of(source, heading)] = (name, role)
    alike = len({(s.skip, s.delimiter, s.encoding, s.decimal, s.format) for s in sources}) == 1
    times = {(layout.time, layout.clock) for layout in layouts}
    orders = {s.clock.order for s in sources}
    said = first.format == "csv" and alike
    return ExportMapping(
        kind=next(iter(kinds)) if len(kinds) == 1 else "",
        time=tuple(h for h in next(iter(times)) if h) if len(times) == 1 else (),
        time_format=FORMATS.get(next(iter(orders)), "") if len(orders) == 1 else "",
        separator=first.delimiter if said else "",
        decimal=("," if first.comma else ".") if said else "",
        data_row=first.skip + 1 if alike and first.format != "parquet" else None,
        loop=layouts[0].loop if len(kinds) == 1 else "",
        tags=layouts[0].tags if len(kinds) == 1 else (),
        value=layouts[0].value if len(kinds) == 1 and layouts[0].kind != TAGS else "",
        quality=layouts[0].quality if len({layout.quality for layout in layouts}) == 1 else "",
        quality_scale=first.quality_scale,
        columns=columns,
        modes=dict(first.modes),
    )


def loop_table_text(seen: dict[str, Seen]) -> str:
    """Return a loop table of names to be completed, with what is guessed and seen as remarks.

    Columns that begin with ``#`` are remarks, and not read.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, (*COLUMNS, *REMARKS), restval="", lineterminator="\n")
    writer.writeheader()
    for name, found in seen.items():
        writer.writerow({"name": inert(name), "process": "auto", **_remarks(name, found)})
    return text.getvalue()


def _remarks(name: str, found: Seen) -> dict[str, object]:
    level = name.upper().startswith(INTEGRATING_LETTERS) and any(c.isdigit() for c in name)
    low, high = found.op
    percent = OP_PERCENT[0] <= low and high <= OP_PERCENT[1] and high > LEAST_PERCENT
    settings = found.settings or ()
    return {
        "#process_guess": "integrating (the tag's first letter)" if level else "",
        "#op_range_guess": _range(OP_PERCENT) if percent else "",
        **{f"#{k}_seen": f"{v:.4g}" for k, v in zip(("kp", "ti", "td"), settings, strict=False)},
        "#pv_seen": _range(found.pv),
        "#op_seen": _range(found.op),
        "#period_s": "" if np.isnan(found.period) else f"{found.period:g}",
        "#samples": found.n,
    }


def _range(seen: tuple[float, float]) -> str:
    return "" if seen[0] > seen[1] else f"{seen[0]:g} ... {seen[1]:g}"
