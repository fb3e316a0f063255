"""How an audit's work is cut into tasks: of about equal weight, each reading as little of the files as it can."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from monitor.adapters.historian.layout import LONG
from monitor.adapters.historian.merge import Span
from monitor.adapters.historian.reader import scan
from monitor.adapters.historian.source import Source
from monitor.contract.loops import Loop

from .tasks import Task

MOST_TASK_ROWS = 50_000_000
"""Rows of a task: what `--resume` loses at most, a second or two of detection."""
MOST_READS = 2.0
"""How often the files may be read over all tasks, on average; beyond, there is a task for each job and no more."""


def plan(loops: Sequence[Loop], sources: Sequence[Source], span: Span, jobs: int) -> list[Task]:
    """Cut an audit into tasks of about equal weight: at least one for each job.

    Files in order of loops are cut small, for `--resume`. In files in order of time every task would read all, so there
    it is one for each job.

    Raises
    ------
    UnusableError
        A file turned out to be damaged.
    """
    rows = sum(map(_rows_about, sources))
    n = max(1, min(len(loops), max(jobs, -(-rows // MOST_TASK_ROWS))))
    if n == 1:
        return [Task(tuple(loops), tuple(sources), span, {})]
    names = {loop.name for loop in loops}
    groups = {source.name: _names_in(source) for source in sources}
    where: dict[str, dict[str, list[int]]] = {}
    weight = dict.fromkeys(names, 1)
    for source in sources:
        for g, found in enumerate(groups[source.name]):
            for name, times in found.items():
                if name in names:
                    where.setdefault(name, {}).setdefault(source.name, []).append(g)
                    weight[name] += times
    # loops that lie together in the files stay together: each task reads as little as possible
    place = {s.name: k for k, s in enumerate(sources)}
    far = (len(sources), 0)
    first = {n: min(((place[s], g[0]) for s, g in where.get(n, {}).items()), default=far) for n in names}
    ordered = sorted(loops, key=lambda loop: (first[loop.name], loop.name))
    tasks = [_task(part, sources, span, where) for part in _shares(ordered, weight, n)]
    if n > jobs and sum(_reads(task, groups) for task in tasks) > MOST_READS * rows:
        tasks = [_task(part, sources, span, where) for part in _shares(ordered, weight, max(jobs, 1))]
    return tasks


def _rows_about(source: Source) -> int:
    return source.size // 40 if source.rows is None else source.rows


def _reads(task: Task, groups: Mapping[str, Sequence[Mapping[str, int]]]) -> int:
    """Return how many rows a task reads, its own or not; of a Parquet file with a column for each loop only its own."""
    rows = 0
    for source in task.sources:
        if source.name in task.groups:
            rows += sum(sum(groups[source.name][g].values()) for g in task.groups[source.name])
        elif source.format != "parquet":
            rows += _rows_about(source)
    return rows


def _names_in(source: Source) -> list[dict[str, int]]:
    """Return the loops of each row group with their rows; empty where only a full reading would tell."""
    if source.layout.kind != LONG:
        return [dict.fromkeys(source.loops, source.rows or source.size // 40)]
    return scan(source) if source.format == "parquet" else []


def _shares(loops: Sequence[Loop], weight: Mapping[str, int], n: int) -> Iterator[list[Loop]]:
    """Cut a row of loops into n runs of about equal weight, none empty."""
    total, so_far, share = sum(weight[loop.name] for loop in loops), 0, 0
    part: list[Loop] = []
    for k, loop in enumerate(loops):
        part.append(loop)
        so_far += weight[loop.name]
        left = len(loops) - k - 1
        if (
            share < n - 1
            and left >= n - 1 - share
            and (so_far * n >= total * (share + 1) or left == n - 1 - share)
        ):
            yield part
            part, share = [], share + 1
    yield part


def _task(
    loops: Sequence[Loop],
    sources: Sequence[Source],
    span: Span,
    where: Mapping[str, Mapping[str, Sequence[int]]],
) -> Task:
    names = {loop.name for loop in loops}
    groups: dict[str, set[int]] = {}
    for name in names:
        for source, found in where.get(name, {}).items():
            groups.setdefault(source, set()).update(found)
    used = [s for s in sources if s.name in groups or (s.layout.kind == LONG and s.format != "parquet")]
    pruned = {s.name: sorted(groups[s.name]) for s in used if s.layout.kind == LONG and s.format == "parquet"}
    # a task needs to know its own columns only: a wide file of a whole fleet has tens of thousands
    return Task(tuple(loops), tuple(_narrow(s, names) for s in used), span, pruned)


def _narrow(source: Source, names: set[str]) -> Source:
    if source.layout.kind == LONG:
        return source
    columns = {name: roles for name, roles in source.layout.columns.items() if name in names}
    return replace(source, layout=replace(source.layout, columns=columns, incomplete={}))
