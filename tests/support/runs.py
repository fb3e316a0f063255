"""The short way from a plant's samples to an engine's records."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment, Event, LoopRow, Record, Suggestion, Window
from monitor.contract.samples import Samples
from monitor.engine import Engine
from sim_plants.loops import Simulation
from sim_plants.specs import LoopSpec
from tests.support.plants import samples_of, table_of


@dataclass
class Seen:
    """What an engine said, sorted by kind of record."""

    events: list[Event] = field(default_factory=list)
    assessments: list[Assessment] = field(default_factory=list)
    suggestions: list[Suggestion] = field(default_factory=list)
    windows: list[Window] = field(default_factory=list)

    @property
    def closed(self) -> list[Event]:
        return [e for e in self.events if e.state != "open"]

    @property
    def opened(self) -> list[Event]:
        return [e for e in self.events if e.state == "open"]


def sorted_records(records: Iterable[Record]) -> Seen:
    seen = Seen()
    for record in records:
        if isinstance(record, Event):
            seen.events.append(record)
        elif isinstance(record, Assessment):
            seen.assessments.append(record)
        elif isinstance(record, Suggestion):
            seen.suggestions.append(record)
        else:
            seen.windows.append(record)
    return seen


def watch(
    specs: Sequence[LoopSpec], seconds: float, loops: Sequence[Loop] | None = None, **facts: Any
) -> tuple[Engine, Seen]:
    """Simulate loops and run an engine over them."""
    engine = Engine(LoopTable(table_of(specs, **facts) if loops is None else loops))
    records = engine.step(samples_of(Simulation(specs).advance(seconds)))
    return engine, sorted_records(records + engine.flush())


def run(loop: Loop, samples: Samples) -> tuple[Engine, Seen]:
    """Run an engine over one loop's samples, to the end of the data."""
    engine = Engine(LoopTable([loop]))
    return engine, sorted_records(engine.step(samples) + engine.flush())


def row_of(engine: Engine, name: str) -> LoopRow:
    return engine.row(engine.loops.by_name[name])
