"""A monitor that is killed, wherever that hits it, goes on as if nothing had happened."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import LoopTable
from sim_plants.loops import Simulation
from sim_plants.scenarios import SCENARIOS
from sim_plants.truth import loop_table
from tests.monitor.service.test_run import messages_of
from tests.monitor.service.tools import SENT, Bench

TOLD = ("verdict", "kp", "ti", "new_kp", "new_ti", "events", "flags", "process", "gain")


class KilledError(BaseException):
    """What a SIGKILL is to the code that it hits."""


@pytest.fixture(scope="module")
def plant() -> Any:
    """The demo's loops, and a frame for each second of half an hour."""
    loops = SCENARIOS["demo"](1)
    block = Simulation(loops, 1_767_225_600).advance(1800)
    return [parse_row(row)[0] for row in loop_table(loops)], messages_of(loops, block, "frame")


def told(b: Bench) -> dict[str, list[Any]]:
    """What is said of each loop; of one whose samples have not come again yet, too."""
    rows = {loop.name: b.service.engine.row(k) for k, loop in enumerate(b.loops)}
    return {name: [getattr(row, n) for n in TOLD] for name, row in rows.items()}


def stored(folder: Path, table: str) -> dict[str, Any]:
    with closing(sqlite3.connect(f"file:{folder}/loopsight.sqlite?mode=ro", uri=True)) as db:
        rows = db.execute(f"SELECT id, json FROM {table}").fetchall()  # noqa: S608 (a name of ours)
    return {i: json.loads(j) for i, j in rows}


@contextmanager
def dies(b: Bench, where: str, after: int) -> Iterator[None]:
    """Kill the process at the ``after``-th commit, before or after it, or at the ``after``-th message it publishes."""
    left = [after]

    def count(*_: Any) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise KilledError

    if where == "publishing":
        b.bus.on_publish = count
    elif where == "before":
        whole = b.store.keep_memory
        b.store.keep_memory = lambda m: (whole(m), count())  # type: ignore[assignment]
    else:
        latest = b.store.latest
        b.store.latest = lambda: (latest(), count())[0]  # type: ignore[method-assign]
    with pytest.raises(KilledError):
        yield
    b.store.close()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow
def test_killed_again_and_again(plant: Any, tmp_path: Path, seed: int) -> None:
    """In the middle of a commit, between commit and message, between two messages.

    What was published is stored; what is stored was published; every set-point event is assessed, none stays open;
    and after each restart verdicts, settings and flags are those of before.
    """
    table, messages = plant
    rng = np.random.default_rng(seed)
    said: dict[str, Any] = {}
    ended: dict[str, Any] = {}
    runs, at = 0, 0
    b = Bench(tmp_path, LoopTable(list(table)))
    while at < len(messages):
        where = ("publishing", "before", "after")[runs % 3]
        before = told(b)
        try:
            with dies(b, where, int(rng.integers(1, 12))):
                while at < len(messages):
                    before = told(b)
                    b.bus.put(*messages[at], SENT)
                    at += 1
                    b.tick(1.0)
                b.service.finish()
                raise KilledError
        finally:
            said |= {r["id"]: r for r in b.bus.kinds("assessment")}
            ended |= {r["id"]: r for r in b.bus.kinds("event")}
        runs += 1
        b = Bench(tmp_path, LoopTable(list(table)))
        after = told(b)
        # of a loop without events the figures of the last minutes are not kept yet
        changed = [n for n in after if after[n] != before[n] and 0 < after[n][5] <= before[n][5]]
        assert not changed, [(before[n], after[n]) for n in changed]
    b.service.finish()
    said |= {r["id"]: r for r in b.bus.kinds("assessment")}
    ended |= {r["id"]: r for r in b.bus.kinds("event")}
    b.store.close()
    assert runs > 8
    kept = stored(tmp_path, "assessment")
    assert kept == said
    events = stored(tmp_path, "event")
    assert events == ended
    assert all(e["state"] != "open" for e in events.values())
    closed = {i for i, e in events.items() if e["kind"] == "setpoint"}
    opened_only = {i for i in closed - set(kept) if events[i]["end"] is None}
    assert closed - set(kept) == opened_only
    assert len(kept) > 10
