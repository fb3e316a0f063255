"""The controller in a sample of the data that `check` and `import` read, and the loop table's settings against it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import QUALITY_UNCERTAIN, Array, Samples
from monitor.detect.event import EventWindow

if TYPE_CHECKING:
    from monitor.identify.controller_seen import Controller, Interval

STRETCH_SAMPLES, LEAST_SAMPLES = 1024, 128
"""Samples of a stretch in which a controller is looked for; below the second it is left."""
MOST_STRETCHES = 4
"""Stretches of a loop that are kept: those in which the set point, then PV, moves most."""


@dataclass(slots=True, eq=False)
class _Kept:
    """What is kept of a loop."""

    buffer: list[Array] = field(default_factory=list)
    """(n, 4) of the stretch that is being filled: time [ns], SP, PV, OP."""
    n: int = 0
    """Its samples."""
    stretches: list[tuple[float, float, Array]] = field(default_factory=list)
    """How far SP and PV move, and the samples."""


class Sample:
    """Stretches of each loop, kept while its samples pass by; bounded."""

    def __init__(self) -> None:
        self._loops: dict[int, _Kept] = {}

    def watched(self, batches: Iterator[Samples]) -> Iterator[Samples]:
        """Yield the batches as they come, and keep of them what shows the controllers."""
        for samples in batches:
            for code, own in samples.by_loop():
                self.add(code, own)
            yield samples

    def windows(self, code: int) -> list[tuple[EventWindow, float]]:
        """Return a loop's stretches with their sample periods [s]."""
        kept = self._loops.get(code)
        if kept is None:
            return []
        _close(kept)
        out = []
        for _, _, columns in kept.stretches:
            time = (columns[:, 0] - columns[0, 0]) * 1e-9
            sp, pv, op = (np.ascontiguousarray(columns[:, k]) for k in (1, 2, 3))
            window = EventWindow(time, sp, pv, op, len(time))
            out.append((window, float(np.median(np.diff(time)))))
        return out

    def add(self, code: int, samples: Samples) -> None:
        """Take a loop's next samples; one that is bad, or in manual, ends the stretch."""
        kept = self._loops.setdefault(code, _Kept())
        columns = np.column_stack([samples.time.astype(float), samples.sp, samples.pv, samples.op])
        good = np.isfinite(columns).all(axis=1) & samples.auto & (samples.quality >= QUALITY_UNCERTAIN)
        for part in _runs(columns, good):
            at = 0
            while at < len(part):
                more = part[at : at + STRETCH_SAMPLES - kept.n]
                kept.buffer.append(more)
                kept.n += len(more)
                at += len(more)
                if kept.n == STRETCH_SAMPLES:
                    _close(kept)
            if not good[-1] or part is not columns:
                _close(kept)


def _runs(columns: Array, good: NDArray[np.bool_]) -> list[Array]:
    """Return the runs of good rows."""
    if good.all():
        return [columns]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    return [columns[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _close(kept: _Kept) -> None:
    """End the stretch that is being filled, and keep it where it moves more than others."""
    if kept.n >= LEAST_SAMPLES:
        columns = np.concatenate(kept.buffer)
        kept.stretches.append((float(np.ptp(columns[:, 1])), float(np.ptp(columns[:, 2])), columns))
        kept.stretches.sort(key=lambda s: s[:2], reverse=True)
        del kept.stretches[MOST_STRETCHES:]
    kept.buffer, kept.n = [], 0


def controller_in(sample: Sample, code: int, loop: Loop) -> Controller | None:
    """Return what a sample shows of a loop's controller; None where nothing is seen."""
    from monitor.identify.controller import see_controller  # noqa: PLC0415 (compiles: only where there are data)
    from monitor.identify.controller_seen import combined  # noqa: PLC0415

    seen = [see_controller(window, period, loop) for window, period in sample.windows(code)]
    return combined([c for c in seen if c is not None])


def looked_at(names: list[str], sample: Sample, loops: Mapping[str, Loop]) -> tuple[list[str], list[str]]:
    """Return what a file's samples say against the settings of loops, and what else they show; a line each.

    Parameters
    ----------
    names
        Of the loops, by the samples' numbers.
    sample
        Of the file.
    loops
        Rows of the loop table, by name.
    """
    from monitor.identify import controller_seen as said  # noqa: PLC0415 (compiles: only where there are data)

    wrong, notes = [], []
    for code, name in enumerate(names):
        found = controller_in(sample, code, loops.get(name, Loop(name=name)))
        if found is None:
            continue
        if found.said in {said.CONTRADICTED, said.NOT_LINEAR}:
            wrong.append(f"loop {name}: {found.cause}")
        elif found.said == said.BESIDE:
            notes.append(f"loop {name}: {found.cause}")
        elif found.said == said.FOUND:
            notes.append(f"loop {name}: {_seen(found)}")
    return wrong, notes


def _seen(found: Controller) -> str:
    """Return settings seen where the table has none."""
    reset = f"ti = {_range(found.ti)} s" if np.isfinite(found.ti.value) else "no integral action"
    parts = [f"kp = {_range(found.kp)}", reset]
    if found.td.value > 0:
        parts.append(f"td = {_range(found.td)} s")
    return f"no settings in the table; seen: {', '.join(parts)}"


def _range(interval: Interval) -> str:
    low, high = sorted((interval.low, interval.high), key=abs)
    return f"{interval.value:.3g} ({low:.3g} to {high:.3g})"
