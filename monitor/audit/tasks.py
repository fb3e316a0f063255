"""An audit's work as tasks: groups of loops that know nothing of each other.

A task reads its loops out of all files, runs an engine of its own over them and returns what it found. Where
and in which order tasks run (here, in a pool of processes, on a cluster) changes nothing in the result.
"""

from __future__ import annotations

import hashlib
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import msgspec

from monitor.adapters.files import write_bytes
from monitor.adapters.historian.merge import OutOfOrderError, Span, in_order, rows_of, sorted_samples
from monitor.adapters.historian.rows import Tally, UnusableError
from monitor.adapters.historian.source import Source
from monitor.contract.evidence import Window
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment, LoopRow, Record, Spell
from monitor.contract.samples import Samples
from monitor.contract.unit_mismatch import lasts, unit_mismatch
from monitor.engine import Engine
from monitor.verdict.stale import LastSample

from .evidence import Curves, Keeper, Kept, Trends, curves_of, flagged
from .first_samples import FirstSamples
from .spells import Spells

CLUSTER_WAIT_S = 3.0
"""[s] For a scheduler to answer, and again for it to have a worker: with all imports below ten."""


class Part(msgspec.Struct):
    """What one task found, or the file that stopped it."""

    events: list[Assessment] = []
    rows: list[LoopRow] = []
    windows: list[Kept] = []
    """Some events of the flagged loops, for the eye."""
    answers: list[Curves] = []
    """What the flagged loops make of unit steps, by their models."""
    spells: list[Spell] = []
    """How the loops ran, spell by spell of time."""
    last: dict[str, LastSample] = {}
    """How each loop's samples ended."""
    first: int | None = None
    """Time of the first sample of any loop, good or bad [ns since 1970]."""
    newest: int | None = None
    """Of the last one [ns since 1970]."""
    counts: dict[str, int] = {}
    units: dict[str, str] = {}
    """Loops whose SP and PV look like different units, and what is seen."""
    tally: Tally = msgspec.field(default_factory=Tally)
    unusable: tuple[str, str, int | None] | None = None


@dataclass(frozen=True, slots=True)
class Task:
    """Some loops, and where their samples are."""

    loops: tuple[Loop, ...]
    sources: tuple[Source, ...]
    span: Span
    groups: Mapping[str, Sequence[int]]
    """Row groups that hold these loops, of sources where that is known."""

    def identity(self, version: str) -> str:
        """Name what the result depends on: the files as they are, the loops' facts, the settings."""
        zone = None if self.span.zone is None else self.span.zone.key
        facts = [
            version,
            [[str(s.path), s.name, s.size, s.mtime_ns, repr(s.clock), *_read_as(s)] for s in self.sources],
            [msgspec.to_builtins(loop) for loop in self.loops],
            [self.span.since, self.span.until, zone],
        ]
        return hashlib.blake2b(msgspec.msgpack.encode(facts), digest_size=16).hexdigest()


def _read_as(source: Source) -> list[str]:
    """Say how a recognised file is read, in full: another mapping of the same file is another task."""
    if not source.recognised:
        return []
    how = replace(source, path=Path(), name="")
    return [repr(how)]


_counter: Any = None
"""Shared with the parent process: rows done, for its progress bar."""


def _share(counter: Any) -> None:
    global _counter  # noqa: PLW0603 (a pool hands its workers things in no other way)
    _counter = counter
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which stops its workers


def _count(rows: int) -> None:
    if _counter is not None:
        with _counter.get_lock():
            _counter.value += rows


def run_task(task: Task, done: Callable[[int], None] = _count) -> Part:
    """Audit a task's loops. Never raises for the sake of data."""
    wanted = {loop.name: k for k, loop in enumerate(task.loops)}
    tally = Tally()
    try:
        try:
            part = _run(task, in_order(task.sources, wanted, task.span, tally, task.groups), done)
        except OutOfOrderError:
            tally = Tally()
            part = _run(task, sorted_samples(task.sources, wanted, task.span, tally), done)
    except UnusableError as error:
        return Part(unusable=(error.name, error.reason, error.line))
    part.tally = tally
    return part


def _run(task: Task, samples: Iterator[Samples], done: Callable[[int], None]) -> Part:
    engine, keeper = Engine(LoopTable(task.loops)), Keeper()
    names = [loop.name for loop in task.loops]
    trends, spells = Trends(names), Spells(names)
    events: list[Assessment] = []
    times: list[int] = []
    firsts = FirstSamples(len(task.loops))
    for batch in samples:
        firsts.watch(batch)
        _keep(engine.step(batch), events, keeper)
        trends.take(batch)
        spells.take(batch)
        times = [min([*times, int(batch.time.min())]), max([*times, int(batch.time.max())])]
        done(len(batch))
    _keep(engine.flush(), events, keeper)
    last = {loop.name: engine.seen.last(row) for row, loop in enumerate(task.loops)}
    first, newest = times or (None, None)
    units = {
        loop.name: said
        for row, loop in enumerate(task.loops)
        if (said := unit_mismatch(loop, *firsts.of(row)))
    }
    rows = {loop.name: engine.row(k) for k, loop in enumerate(task.loops)}
    for k, loop in enumerate(task.loops):
        if loop.name in units and lasts(rows[loop.name].offset, *firsts.of(k)):
            rows[loop.name] = engine.row(k, units[loop.name])
    shown = [name for name, row in rows.items() if flagged(row)]
    curves = [c for name in shown for c in curves_of(engine.answers(engine.loops.by_name[name], rows[name]))]
    kept = [*keeper.of(shown), *trends.of(shown)]
    return Part(
        events,
        list(rows.values()),
        kept,
        curves,
        spells.found(),
        last,
        first,
        newest,
        engine.seen.counts(),
        units,
    )


def _keep(records: Sequence[Record], events: list[Assessment], keeper: Keeper) -> None:
    """Keep assessments, and the windows that follow them."""
    for record in records:
        if isinstance(record, Assessment):
            events.append(record)
        elif isinstance(record, Window):
            keeper.take(record, events[-1].kind)


# ---------------------------------------------------------------------------------------------------
# running


@dataclass(slots=True)
class Progress:
    """How far an audit is."""

    rows: int = 0
    loops: int = 0
    all_rows: int = 0
    """Estimated where the files do not say."""
    all_loops: int = 0


def run_all(
    tasks: Sequence[Task],
    *,
    version: str,
    keep: Path,
    jobs: int = 1,
    resume: bool = False,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
) -> list[Part]:
    """Run tasks here, in a pool, or on a cluster; return their parts in the order of the tasks.

    Parameters
    ----------
    keep
        Folder for the parts that are done, so that an audit that was stopped can go on.
    resume
        Take over such parts.

    Raises
    ------
    ImportError
        A scheduler is named, and dask.distributed is not installed.
    OSError
        A part cannot be stored, or the scheduler cannot be reached.
    """
    keep.mkdir(parents=True, exist_ok=True)
    files = [keep / f"{task.identity(version)}.msgpack" for task in tasks]
    parts: dict[int, Part] = {}
    names = [loop.name for task in tasks for loop in task.loops]
    sources = {s.name: s for task in tasks for s in task.sources}
    state = Progress(
        all_rows=sum(rows_of(s, names) for s in sources.values()),
        all_loops=len(names),
    )
    if resume:
        parts = {k: part for k, file in enumerate(files) if (part := _stored(file)) is not None}
        state.loops = sum(len(tasks[k].loops) for k in parts)
    open_tasks = [k for k in range(len(tasks)) if k not in parts]
    for k, part in _results({k: tasks[k] for k in open_tasks}, jobs, scheduler, state, progress):
        parts[k] = part
        state.loops += len(tasks[k].loops)
        progress(state)
        if part.unusable is None:
            write_bytes(files[k], msgspec.msgpack.encode(part))
    return [parts[k] for k in range(len(tasks))]


def _stored(file: Path) -> Part | None:
    try:
        return msgspec.msgpack.decode(file.read_bytes(), type=Part)
    except (OSError, msgspec.MsgspecError):
        return None  # not there, or torn: the task runs again


def _results(
    tasks: Mapping[int, Task],
    jobs: int,
    scheduler: str | None,
    state: Progress,
    progress: Callable[[Progress], None],
) -> Iterator[tuple[int, Part]]:
    if scheduler is not None and tasks:
        yield from _on_cluster(tasks, scheduler)
    elif jobs > 1 and len(tasks) > 1:
        yield from _in_pool(tasks, jobs, state, progress)
    else:

        def done(rows: int) -> None:
            state.rows += rows
            progress(state)

        for k, task in tasks.items():
            yield k, run_task(task, done)


class _DoneElsewhereError(Exception):
    """What is being done here has just been done by another process."""


def _in_pool(
    tasks: Mapping[int, Task], jobs: int, state: Progress, progress: Callable[[Progress], None]
) -> Iterator[tuple[int, Part]]:
    """Run tasks in other processes, which take them from the first on, and in this one, from the last.

    What is left is done here as well, until either has it: an audit that is over before the processes have started, or
    that loses one of them, takes no longer than alone.
    """
    # spawn: a fork after threads were started (Arrow's, numba's) can hang
    context = get_context("spawn")
    counter, here = context.Value("q", 0), 0
    with context.Pool(min(jobs, len(tasks)) - 1, _share, (counter,)) as pool:  # at the end they are stopped
        away = {k: pool.apply_async(run_task, (task,)) for k, task in tasks.items()}

        def done(rows: int) -> None:
            nonlocal here
            here += rows
            state.rows = min(here + counter.value, state.all_rows)
            progress(state)
            if away[mine].ready():
                raise _DoneElsewhereError

        while away:
            for k in [k for k, result in away.items() if result.ready()]:
                yield k, away.pop(k).get()
            if away:
                mine = max(away)
                with suppress(_DoneElsewhereError):
                    part = run_task(tasks[mine], done)
                    del away[mine]
                    yield mine, part


def _on_cluster(tasks: Mapping[int, Task], scheduler: str) -> Iterator[tuple[int, Part]]:
    with cluster(scheduler) as client:
        futures = {client.submit(run_task, task, pure=False): k for k, task in tasks.items()}
        for future in import_module("distributed").as_completed(list(futures)):
            yield futures[future], future.result()


def cluster(scheduler: str) -> Any:
    """Return a client of a Dask cluster that has somebody to do the work.

    Raises
    ------
    ImportError
        dask.distributed, an extra, is not installed.
    OSError
        No scheduler answers, or it has no worker: one line.
    """
    try:
        dask: Any = import_module("distributed")
    except ImportError:
        raise ImportError(
            "--scheduler: dask.distributed is not installed, expected: pip install 'loopsight[cluster]'"
        ) from None
    try:
        client = _in_time(lambda: dask.Client(scheduler, timeout=CLUSTER_WAIT_S), 2.0 * CLUSTER_WAIT_S)
    except (OSError, ValueError, MemoryError) as error:  # the last: what answers speaks another language
        said = " ".join(str(error).split()) or "nothing comes back"
        raise OSError(f"--scheduler: {scheduler!r}: no Dask scheduler answers there: {said}") from None
    try:
        client.wait_for_workers(1, timeout=CLUSTER_WAIT_S)
    except TimeoutError:
        client.close()
        raise OSError(
            f"--scheduler: {scheduler!r} has no worker, expected some: dask worker {scheduler}"
        ) from None
    return client


def _in_time(work: Callable[[], Any], seconds: float) -> Any:
    """Return what ``work`` does, if it does it within so long [s]; what goes on then is left alone.

    Raises
    ------
    TimeoutError
        It takes longer, as where a web server takes the question and thinks about it for ever.
    """
    done: Future[Any] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:  # noqa: BLE001 (it is raised where it is asked for)
            done.set_exception(error)

    threading.Thread(target=run, name="scheduler", daemon=True).start()
    return done.result(seconds)
