"""An audit from its inputs to its files: find, run, finish."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from monitor.adapters.audit_folder import ABOUT_FILE, read_audit
from monitor.adapters.files import write_text
from monitor.adapters.historian.rows import Tally, UnusableError
from monitor.adapters.tables import write_evidence, write_spells, write_tables
from monitor.contract.danger import worst_first
from monitor.verdict.together import cycling_together

from .about import (
    AUDIT_SCHEMA,
    about,
    counted,
    loops_left_out,
    notes_on_reading,
    package_version,
    problems,
    why_nothing,
)
from .drawing import draw_report
from .evidence import answers_of, windows_of
from .inputs import Inputs, find, identity
from .plan import plan
from .result import PARTS_FOLDER, AuditResult
from .settings import AuditSettings
from .silence import Silence, end_of_most
from .tasks import Part, Progress, cluster, run_all


def run_audit(
    paths: Sequence[str | Path],
    loops_file: str | Path | None,
    out: str | Path,
    settings: AuditSettings | None = None,
    *,
    progress: Callable[[Progress], None] = lambda _: None,
) -> AuditResult:
    """Audit historian exports and write the tables and ``audit.json`` to ``out``.

    Parameters
    ----------
    paths
        Parquet and CSV files, folders, globs.
    loops_file
        Loop table; None: all loops in the data, with unknown settings.
    out
        Folder; is made where it does not exist.
    settings
        Times, processes; None: the defaults of `AuditSettings`.
    progress
        Called with how far the audit is.

    Raises
    ------
    ValueError
        A setting is not acceptable: one line that names it.
    OSError
        ``out`` cannot be written to, the last audit not be read, or nobody is there to do the work.
    ImportError
        A scheduler is named, and dask.distributed is not installed.
    """
    audit = Audit(Path(out), settings or AuditSettings())
    if audit.settings.scheduler is not None:
        cluster(audit.settings.scheduler).close()  # before a large folder is looked at
    audit.find(paths, loops_file)
    audit.run(progress)
    return audit.finish()


class Audit:
    """One audit on its way."""

    def __init__(self, out: Path, settings: AuditSettings) -> None:
        self.out, self.settings = out, settings
        self.span = settings.span()
        # before anything is written: it may be the folder that this audit writes to
        self.last = None if settings.since_audit is None else read_audit(Path(settings.since_audit))
        self.inputs = Inputs()
        self.parts: list[Part] = []
        self._hashing: dict[str, Future[dict[str, Any]]] = {}

    def find(self, paths: Sequence[str | Path], loops_file: str | Path | None) -> None:
        """Look at the loop table and all files; note what cannot be used."""
        self.inputs = find(paths, loops_file, self.out, self.settings.time_unit, self.settings.given())

    def run(self, progress: Callable[[Progress], None] = lambda _: None) -> None:
        """Audit all loops; a file that turns out to be damaged is left out whole, and the rest done anew."""
        # beside the work, not after it: hashing takes a tenth of the time of detection
        with ThreadPoolExecutor(1, "identity") as pool:
            self._hashing = {s.name: pool.submit(identity, s.path, s.name) for s in self.inputs.sources}
            self._run(progress)

    def _run(self, progress: Callable[[Progress], None]) -> None:
        inputs, settings = self.inputs, self.settings
        while inputs.sources and len(inputs.loops):
            try:
                tasks = plan(list(inputs.loops), inputs.sources, self.span, settings.jobs)
            except UnusableError as error:
                inputs.leave(error)
                continue
            parts = run_all(
                tasks,
                version=f"{package_version()}/{AUDIT_SCHEMA}",
                keep=self.out / PARTS_FOLDER,
                jobs=settings.jobs,
                resume=settings.resume,
                scheduler=settings.scheduler,
                progress=progress,
            )
            damaged = {p.unusable[0]: p.unusable for p in parts if p.unusable is not None}
            if not damaged:
                self.parts = parts
                return
            for name in sorted(damaged):
                inputs.leave(UnusableError(*damaged[name]))

    def finish(self) -> AuditResult:
        """Write the results, and say what was left out.

        Raises
        ------
        OSError
            The folder cannot be written to.
        """
        inputs, tally, samples = self.inputs, Tally(), Counter[str]()
        for part in self.parts:
            tally.add(part.tally)
            samples.update(part.counts)
        left = loops_left_out(inputs, tally)
        notes = notes_on_reading(inputs)
        notes += [f"loop {n}: {said}" for p in self.parts for n, said in sorted(p.units.items())]
        wrong = problems(inputs, tally, left)
        if not samples["ok"]:
            self._tidy()
            said = (
                []
                if wrong and not tally.rows and not inputs.sources
                else [why_nothing(inputs, tally, samples)]
            )
            return AuditResult(2, [*wrong, *said], notes=notes)
        events = sorted((e for p in self.parts for e in p.events), key=lambda e: (e.loop, e.start, e.id))
        seconds = all(s.clock.numeric for s in inputs.sources)
        reach = _reach(self.parts)
        silence = Silence(reach[0], end_of_most(p.last for p in self.parts))
        rows = sorted(cycling_together([r for p in self.parts for r in silence.rows(p)]), key=worst_first)
        self.out.mkdir(parents=True, exist_ok=True)
        files = write_tables(self.out, events, rows, seconds=seconds)
        windows = sorted(
            (w for p in self.parts for w in windows_of(p.windows)), key=lambda w: (w.loop, w.onset, w.id)
        )
        answers = sorted(
            (a for p in self.parts for a in answers_of(p.answers)), key=lambda a: (a.loop, a.kind)
        )
        files += write_evidence(self.out, windows, answers, seconds=seconds)
        spells = sorted((s for p in self.parts for s in p.spells), key=lambda s: (s.loop, s.start))
        files.append(write_spells(self.out, spells, seconds=seconds))
        counts = counted(tally, samples, len(events), rows)
        said_of_it = about(
            inputs,
            self.settings,
            tally,
            counts=counts,
            left=left,
            reach=reach,
            identities={s.name: self._hashing[s.name].result() for s in inputs.sources},
        )
        text = json.dumps(said_of_it, indent=1, ensure_ascii=False, allow_nan=False)
        write_text(self.out / ABOUT_FILE, text + "\n")
        files += [self.out / ABOUT_FILE, draw_report(self.out, self.last)]
        self._tidy()
        return AuditResult(0, wrong, rows, events, files, counts, notes)

    def _tidy(self) -> None:
        """Remove the parts: the audit is done."""
        keep = self.out / PARTS_FOLDER
        for file in keep.glob("*"):
            file.unlink()
        if keep.is_dir():
            keep.rmdir()


def _reach(parts: Sequence[Part]) -> tuple[int, int]:
    """Return the times of the first and the newest sample of all loops [ns since 1970]."""
    firsts = [p.first for p in parts if p.first is not None]
    newest = [p.newest for p in parts if p.newest is not None]
    return min(firsts, default=0), max(newest, default=0)
