"""What an audit reads: the loop table and the files, and what of them is left out, and why."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from monitor.adapters.historian.layout import LONG
from monitor.adapters.historian.mapping import NO_MAPPING, ExportMapping
from monitor.adapters.historian.reader import FOLDER_FORMATS, FORMATS, inspect, scan
from monitor.adapters.historian.reading import settled
from monitor.adapters.historian.rows import UnusableError
from monitor.adapters.historian.source import Source
from monitor.adapters.loop_table import read_loop_table, unknown_columns
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import LoopTable, LoopTableError
from monitor.contract.text import short


@dataclass(slots=True)
class Inputs:
    """The loop table and the files that are read, and what is not."""

    loops_file: Path | None = None
    loops: LoopTable = field(default_factory=lambda: LoopTable([]))
    sources: list[Source] = field(default_factory=list)
    files_left: list[UnusableError] = field(default_factory=list)
    """Files left out: name, line, reason."""
    loops_left: dict[str, str] = field(default_factory=dict)
    """Loops left out before anything was read, and why."""
    columns_unknown: list[str] = field(default_factory=list)
    """Columns of the loop table that are not known, one line each."""
    problems: list[str] = field(default_factory=list)
    """What is wrong with the loop table, and paths that lead nowhere."""

    def leave(self, error: UnusableError) -> None:
        """Leave out a file that cannot be used."""
        self.files_left.append(error)
        self.sources = [s for s in self.sources if s.name != error.name]


def find(
    paths: Sequence[str | Path],
    loops_file: str | Path | None,
    out: Path,
    time_unit: str | None = None,
    given: ExportMapping = NO_MAPPING,
) -> Inputs:
    """Look at the loop table and all files; what cannot be used is noted.

    Parameters
    ----------
    out
        Folder of the results, which are no input.
    time_unit
        Unit of numeric times, where the user names it.
    given
        What the user says of the files.
    """
    inputs = Inputs(None if loops_file is None else Path(loops_file))
    if inputs.loops_file is not None:
        try:
            inputs.columns_unknown = unknown_columns(inputs.loops_file)
            inputs.loops = read_loop_table(inputs.loops_file)
        except LoopTableError as error:
            inputs.problems += error.problems
            return inputs
        except OSError as error:
            inputs.problems.append(f"{inputs.loops_file}: {error.strerror}")
            return inputs
    found = expand(paths, inputs.problems, leave=(inputs.loops_file, out))
    for path, name in found.items():
        try:
            inputs.sources.append(inspect(path, name, inputs.loops.by_name, time_unit, given))
        except UnusableError as error:
            inputs.leave(error)
    inputs.sources = settled(inputs.sources)
    if inputs.loops_file is None:
        _take_all_loops(inputs)
    return inputs


def _take_all_loops(inputs: Inputs) -> None:
    """Take every loop in the data, with defaults."""
    names: set[str] = set()
    for source in list(inputs.sources):
        try:
            names.update(*(scan(source) if source.layout.kind == LONG else [source.loops]))
        except UnusableError as error:
            inputs.leave(error)
    for name in sorted(names):
        loop, wrong = parse_row({"name": name})
        if loop is None:
            inputs.loops_left[name[:200]] = "; ".join(map(short, wrong))
        else:
            inputs.loops.add(loop)


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
            files = [p for p in files if p.suffix.lower() in FOLDER_FORMATS] or files
        else:
            # a pattern may be absolute, which pathlib's glob refuses
            matches = [path] if path.is_file() else map(Path, glob.glob(given, recursive=True))  # noqa: PTH207
            files = [p for p in matches if p.is_file()]
        files = [p.resolve() for p in files]
        if not files:
            problems.append(
                f"{given}: no such file, and no Parquet, CSV or xlsx file in a folder or glob of that name"
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


def identity(path: Path, name: str) -> dict[str, Any]:
    """Return a file's name, size and SHA-256."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"name": name, "size": path.stat().st_size, "sha256": digest}
