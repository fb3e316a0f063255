"""An audit from its inputs to its files: find, run, finish."""

from __future__ import annotations

import glob
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from monitor.adapters.files import write_text
from monitor.adapters.historian.clock import zone_of
from monitor.adapters.historian.layout import LONG
from monitor.adapters.historian.merge import Span
from monitor.adapters.historian.reader import FORMATS, inspect, scan
from monitor.adapters.historian.rows import Tally, UnusableError
from monitor.adapters.historian.source import Source
from monitor.adapters.loop_table import read_loop_table
from monitor.adapters.tables import write_tables
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import LoopTable, LoopTableError
from monitor.contract.records import WORST_FIRST
from monitor.contract.text import short, visible
from monitor.contract.times import iso
from monitor.verdict.row import worst_first
from monitor.verdict.stale import is_stale, mark_stale, patience_of_export

from .result import PARTS, AuditResult
from .tasks import Part, Progress, plan, run_all

SCHEMA = 1
MOST_LISTED = 20
"""Different texts in place of values that ``audit.json`` lists, the most frequent."""
MOST_LINES = 5
"""Lines per file that are named on the terminal; all kept ones are in ``audit.json``."""


class Audit:
    """One audit's facts on the way: what was found, what was left out, and why."""

    def __init__(
        self,
        out: Path,
        *,
        tz: str | None = None,
        since: str | None = None,
        until: str | None = None,
        time_unit: str | None = None,
    ) -> None:
        self.out, self.tz, self.time_unit = out, tz or "UTC", time_unit
        zone = zone_of(self.tz)
        self.span = Span(_instant("--since", since, zone), _instant("--until", until, zone), zone)
        self.version = package_version()
        self.loops_file: Path | None = None
        self.loops = LoopTable([])
        self.sources: list[Source] = []
        self.files: list[dict[str, Any]] = []
        """Files left out: name, line, reason."""
        self.left_out: dict[str, str] = {}
        """Loops left out, and why."""
        self.problems: list[str] = []
        self.parts: list[Part] = []
        self._hashing: dict[str, Future[dict[str, Any]]] = {}

    # -- find ---------------------------------------------------------------------------------------

    def find(self, paths: Sequence[str | Path], loops_file: str | Path | None) -> None:
        """Look at the loop table and all files; note what cannot be used."""
        self.loops_file = None if loops_file is None else Path(loops_file)
        if self.loops_file is not None:
            try:
                self.loops = read_loop_table(self.loops_file)
            except LoopTableError as error:
                self.problems += error.problems
                return
            except OSError as error:
                self.problems.append(f"{self.loops_file}: {error.strerror}")
                return
        found = expand(paths, self.problems, leave=(self.loops_file, self.out))
        for path, name in found.items():
            try:
                self.sources.append(inspect(path, name, self.loops.by_name, self.time_unit))
            except UnusableError as error:
                self._leave(error)
        if self.loops_file is None:
            self._discover()

    def _leave(self, error: UnusableError) -> None:
        self.files.append({"name": error.name, "line": error.line, "reason": error.reason})
        self.sources = [s for s in self.sources if s.name != error.name]

    def _discover(self) -> None:
        """Take every loop in the data, with defaults."""
        names: set[str] = set()
        for source in list(self.sources):
            try:
                names.update(*(scan(source) if source.layout.kind == LONG else [source.loops]))
            except UnusableError as error:
                self._leave(error)
        for name in sorted(names):
            loop, wrong = parse_row({"name": name})
            if loop is None:
                self.left_out[name[:200]] = "; ".join(map(short, wrong))
            else:
                self.loops.add(loop)

    # -- run ----------------------------------------------------------------------------------------

    def run(
        self,
        *,
        jobs: int = 1,
        resume: bool = False,
        scheduler: str | None = None,
        progress: Callable[[Progress], None] = lambda _: None,
    ) -> None:
        """Audit all loops; a file that turns out to be damaged is left out whole, and the rest done anew."""
        # beside the work, not after it: hashing takes a tenth of the time of detection
        with ThreadPoolExecutor(1, "identity") as pool:
            self._hashing = {s.name: pool.submit(_identity, s.path, s.name) for s in self.sources}
            self._run(jobs=jobs, resume=resume, scheduler=scheduler, progress=progress)

    def _run(self, *, jobs: int, **how: Any) -> None:
        while self.sources and len(self.loops):
            try:
                tasks = plan(list(self.loops), self.sources, self.span, jobs)
            except UnusableError as error:
                self._leave(error)
                continue
            parts = run_all(
                tasks,
                version=f"{self.version}/{SCHEMA}",
                keep=self.out / PARTS,
                jobs=jobs,
                **how,
            )
            damaged = {p.unusable[0]: p.unusable for p in parts if p.unusable is not None}
            if not damaged:
                self.parts = parts
                return
            for name in sorted(damaged):
                self._leave(UnusableError(*damaged[name]))

    # -- finish -------------------------------------------------------------------------------------

    def finish(self) -> AuditResult:
        """Write the results, and say what was left out.

        Raises
        ------
        OSError
            The folder cannot be written to.
        """
        tally, samples = Tally(), Counter[str]()
        for part in self.parts:
            tally.add(part.tally)
            samples.update(part.counts)
        self._note_left_out(tally)
        if not samples["ok"]:
            self._tidy()
            return AuditResult(2, [*self.problems, *self._nothing(tally, samples)])
        events = sorted((e for p in self.parts for e in p.events), key=lambda e: (e.loop, e.start, e.id))
        seconds = all(s.clock.numeric for s in self.sources)
        self._mark_stale(seconds)
        rows = sorted((r for p in self.parts for r in p.rows), key=worst_first)
        self.out.mkdir(parents=True, exist_ok=True)
        files = write_tables(self.out, events, rows, seconds=seconds)
        verdicts = Counter(r.verdict for r in rows)
        counts = {
            "rows": tally.rows,
            **{name: samples[name] for name in ("ok", "uncertain", "bad_value", "bad_quality")},
            "bad_time": tally.bad_time,
            "duplicate": tally.duplicate + samples["duplicate"],
            "conflict": tally.conflict + samples["conflict"],
            "late": samples["late"],
            "outside": tally.outside,
            "lost_lines": sum(tally.lost_lines.values()),
            "events": len(events),
            "loops": len(rows),
            **{f"loops_{verdict}": verdicts[verdict] for verdict in WORST_FIRST},
        }
        about = self._about(tally, counts)
        write_text(
            self.out / "audit.json", json.dumps(about, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        )
        self._tidy()
        return AuditResult(0, self.problems, rows, events, [*files, self.out / "audit.json"], counts)

    def _mark_stale(self, seconds: bool) -> None:
        """Mark the loops whose good samples end well before the newest of all."""
        first, newest = self._reach()
        patience = patience_of_export(first, newest)
        for part in self.parts:
            for k, row in enumerate(part.rows):
                last = part.last[row.loop]
                stale = is_stale((newest - last.time) * 1e-9, last.period, patience)
                since = f"{last.time * 1e-9:.10g} s" if seconds else iso(last.time)
                part.rows[k] = mark_stale(row, last, since if stale else None)

    def _reach(self) -> tuple[int, int]:
        """Return the times of the first and the newest sample of all loops [ns since 1970]."""
        firsts = [p.first for p in self.parts if p.first is not None]
        newest = [p.newest for p in self.parts if p.newest is not None]
        return min(firsts, default=0), max(newest, default=0)

    def _tidy(self) -> None:
        """Remove the parts: the audit is done."""
        keep = self.out / PARTS
        for file in keep.glob("*"):
            file.unlink()
        if keep.is_dir():
            keep.rmdir()

    def _note_left_out(self, tally: Tally) -> None:
        for source in self.sources:
            for name, reason in source.layout.incomplete.items():
                if name not in tally.loop_rows:
                    self.left_out[name] = f"{source.name}: {reason}"
        for name in tally.unknown:
            if name not in self.loops.by_name:
                self.left_out.setdefault(name, "not in the loop table")
        for left in self.files:
            where = left["name"] if left["line"] is None else f"{left['name']}:{left['line']}"
            self.problems.append(f"{where}: {left['reason']}")
        for file in sorted(tally.lost_lines):
            lines = sorted(tally.lines.get(file, {}).items())
            self.problems += [f"{file}:{n}: {reason}" for n, reason in lines[:MOST_LINES]]
            more = tally.lost_lines[file] - len(lines[:MOST_LINES])
            if more > 0:
                self.problems.append(f"{file}: {more} more lines that cannot be read")
        for name, reason in sorted(self.left_out.items()):
            self.problems.append(f"loop {visible(name, 80)}: {reason}")

    def _nothing(self, tally: Tally, samples: Counter[str]) -> list[str]:
        """Say why nothing was audited."""
        if self.problems and not tally.rows and not self.sources:
            return []
        if tally.rows:
            bad = {**{n: samples[n] for n in ("bad_value", "bad_quality")}, "bad_time": tally.bad_time}
            bad["outside --since/--until"] = tally.outside
            causes = ", ".join(f"{n} {name}" for name, n in bad.items() if n)
            return [f"no good sample in {tally.rows} rows: {causes}"]
        have = ", ".join(visible(loop.name, 80) for loop in list(self.loops)[:5])
        return [f"no loop of the table is in the data; the table has {have or 'none'}, ..."]

    def _about(self, tally: Tally, counts: dict[str, Any]) -> dict[str, Any]:
        first, newest = self._reach()
        return {
            "schema": SCHEMA,
            "versions": {"loopsight": self.version},
            "generated_at": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
            "settings": {
                "loops": None
                if self.loops_file is None
                else _identity(self.loops_file, self.loops_file.name),
                "since": _iso(self.span.since),
                "until": _iso(self.span.until),
                "time_unit": self.time_unit,
            },
            "time_zone": self.tz,
            "times_without_zone": sorted(s.name for s in self.sources if s.clock.naive),
            "inputs": self._inputs(tally),
            "counts": counts,
            "first_sample": _iso(first),
            "newest_sample": _iso(newest),
            "text_in_values": {"count": tally.bad_texts, "most_frequent": _most_frequent(tally.texts)},
            "quality_not_good": _most_frequent(tally.qualities),
            "times_unreadable": sorted(tally.times)[:MOST_LISTED],
            "held_where_empty": {s.name: sorted(s.sparse) for s in self.sources if s.sparse},
            "quality_unknown": sorted(s.name for s in self.sources if not _has_quality(s)),
            "loops_without_data": sorted(n for n in self.loops.by_name if n not in tally.loop_rows),
            "skipped": {
                "files": sorted(self.files, key=lambda left: str(left["name"])),
                "lines": [
                    {"name": file, "line": n, "reason": reason}
                    for file in sorted(tally.lines)
                    for n, reason in sorted(tally.lines[file].items())
                ],
                "loops": [{"loop": name, "reason": reason} for name, reason in sorted(self.left_out.items())],
            },
        }

    def _inputs(self, tally: Tally) -> list[dict[str, Any]]:
        return [
            {
                **self._hashing[s.name].result(),
                "layout": s.layout.kind,
                "rows": s.rows if s.rows is not None else tally.file_rows.get(s.name, 0),
                "time": f"{s.clock.kind} [{s.clock.unit}]" if s.clock.kind == "number" else s.clock.kind,
            }
            for s in self.sources
        ]


def run_audit(
    paths: Sequence[str | Path],
    loops_file: str | Path | None,
    out: str | Path,
    *,
    jobs: int = 1,
    since: str | None = None,
    until: str | None = None,
    tz: str | None = None,
    time_unit: str | None = None,
    resume: bool = False,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
) -> AuditResult:
    """Audit historian exports and write the tables and ``audit.json`` to ``out``.

    Parameters
    ----------
    paths
        Files, folders and globs.
    loops_file
        Loop table; None: every loop in the data, with defaults.
    jobs
        Processes. Their number changes nothing in the result.
    since, until
        First time, and first time not wanted any more: ISO text, or seconds where the data have numbers.
    tz
        Zone of times that name none; default UTC.
    time_unit
        Unit of numeric times: ``s``, ``ms``, ``us``, ``ns`` or ``excel``; default: told by their range.
    resume
        Take over what an earlier audit of the same data, stopped half way, has stored in ``out``.
    scheduler
        Address of a Dask scheduler that runs the tasks; its workers see the files under the same paths.

    Raises
    ------
    ValueError
        A setting is not acceptable: one line that names it.
    OSError
        ``out`` cannot be written to.
    """
    audit = Audit(Path(out), tz=tz, since=since, until=until, time_unit=time_unit)
    audit.find(paths, loops_file)
    audit.run(jobs=jobs, resume=resume, scheduler=scheduler, progress=progress)
    return audit.finish()


def expand(
    paths: Sequence[str | Path], problems: list[str], leave: Sequence[Path | None] = ()
) -> dict[Path, str]:
    """Return the files meant by files, folders (with all below) and globs, and what to call each; sorted.

    ``leave`` names files and folders that are no input. What matches nothing is added to ``problems``.
    """
    left = {p.resolve() for p in leave if p is not None}
    found: set[Path] = set()
    for given in map(str, paths):
        path = Path(given)
        if path.is_dir():
            files = [p for p in path.rglob("*") if p.suffix.lower() in FORMATS and p.is_file()]
            files = [p for p in files if not any(part.startswith(".") for part in p.relative_to(path).parts)]
        else:
            # a pattern may be absolute, which pathlib's glob refuses
            matches = [path] if path.is_file() else map(Path, glob.glob(given, recursive=True))  # noqa: PTH207
            files = [p for p in matches if p.is_file()]
        files = [p.resolve() for p in files]
        if not files:
            problems.append(
                f"{given}: no such file, and no Parquet or CSV file in a folder or glob of that name"
            )
        found.update(p for p in files if not ({p, *p.parents} & left))
    if not found:
        return {}
    # named from their common folder: the same data are called the same wherever they lie
    root = found_root(found)
    return {
        p: p.relative_to(root).as_posix() for p in sorted(found, key=lambda p: p.relative_to(root).as_posix())
    }


def found_root(files: set[Path]) -> Path:
    """Return the folder that all files share."""
    parents = [p.parent for p in files]
    root = parents[0]
    while not all(p.is_relative_to(root) for p in parents):
        root = root.parent
    return root


def _identity(path: Path, name: str) -> dict[str, Any]:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"name": name, "size": path.stat().st_size, "sha256": digest}


def _most_frequent(counts: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:MOST_LISTED])


def _has_quality(source: Source) -> bool:
    return all("quality" in roles for roles in source.layout.columns.values())


def _instant(option: str, text: str | None, zone: Any) -> int | None:
    """Read a time given on the command line [ns since 1970].

    Raises
    ------
    ValueError
        It is no time.
    """
    if text is None:
        return None
    try:
        return round(float(text) * 1e6) * 1000
    except (ValueError, OverflowError):
        pass
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(
            f"{option}: {text!r}, expected ISO text, e.g. 2026-11-22T10:00:00, or seconds"
        ) from None
    when = when.replace(tzinfo=zone or UTC) if when.tzinfo is None else when
    return int(when.timestamp()) * 10**9 + when.microsecond * 1000


def _iso(ns: int | None) -> str | None:
    return None if ns is None else str(np.datetime64(ns, "ns")) + "Z"


def package_version() -> str:
    """Return the version of the distribution, ``0`` where it is not installed."""
    try:
        return version("loopsight")
    except PackageNotFoundError:
        return "0"
