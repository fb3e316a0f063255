"""A monitor that is killed, wherever that hits it, goes on as if nothing had happened."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable
from monitor.service import memories
from sim_plants.loops import Simulation
from sim_plants.scenarios import SCENARIOS
from sim_plants.truth import loop_table
from tests.monitor.service.tools import SENT, Bench, a_step, feed, messages_of, one_loop
from tests.support.stores import stored

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
    assert len(kept) > 5


def test_settings_flags_and_held_tags_outlive_a_kill(tmp_path: Path) -> None:
    """Two messages in one tick both count; the next process judges by them, flags who was flagged, and knows SP."""
    b = Bench(tmp_path, one_loop())
    feed(b, a_step())
    feed(b, [("plant/L/settings", b'{"kp": 2.5}'), ("plant/L/settings", b'{"ti": 40}')])
    assert (b.loops[0].kp, b.loops[0].ti) == (2.5, 40.0)
    feed(b, [("plant/M/sp", b"7"), ("plant/M/op", b"3")])
    b.tick(5.0)
    feed(b, [("plant/M/settings", b'{"kp": 1.5}')])
    b.service.trends.flag(0, True)
    before = told(b)
    b.store.close()
    again = Bench(tmp_path, one_loop())
    assert told(again) == before
    assert (again.loops[0].kp, again.loops[0].ti, again.loops[1].kp) == (2.5, 40.0, 1.5)
    tags = again.service.reorder.tags(1)
    assert (tags["sp"], tags["op"]) == (7.0, 3.0)
    assert again.status()["samples_ok"] == 0
    again.tick(3.0)
    assert again.status()["stale"] == []  # nothing has come for three seconds, not since 1970
    again.store.close()


def test_an_event_that_closed_is_assessed_by_the_next_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed between the two: published as closed, it has its assessment after the restart."""
    monkeypatch.setattr("monitor.service.service.Service._assess", lambda *_: [])
    b = Bench(tmp_path, one_loop())
    feed(b, a_step())
    assert b.bus.kinds("event")[-1]["state"] == "settled"
    assert not b.bus.kinds("assessment")
    b.store.close()
    monkeypatch.undo()
    again = Bench(tmp_path, one_loop())
    again.tick(1.0)
    (found,) = again.bus.kinds("assessment")
    assert found["id"] == b.bus.kinds("event")[-1]["id"]
    again.tick(2.0)
    again.store.close()
    third = Bench(tmp_path, one_loop())
    third.tick(1.0)
    assert third.bus.kinds("assessment") == []
    third.store.close()


def test_loops_that_registered_themselves_are_known_again(tmp_path: Path) -> None:
    """With what was known of them; an open event of one that is not watched any more is closed, too."""
    b = Bench(tmp_path, LoopTable([]), auto_register=True)
    feed(b, a_step())
    assert b.service.engine.verdict(0) is not None
    before = told(b)
    b.store.close()
    again = Bench(tmp_path, LoopTable([]), auto_register=True)
    assert told(again) == before
    later = [(k, {**json.loads(p), "t": json.loads(p)["t"] + 500}) for k, p in a_step()[:215]]
    feed(again, [(k, json.dumps(sample).encode()) for k, sample in later])
    opened = again.bus.kinds("event")[-1]
    assert opened["state"] == "open"
    again.store.close()
    other = Bench(tmp_path, LoopTable([Loop(name="X")]))
    other.tick(1.0)
    closed = [e for e in other.bus.kinds("event") if e["state"] != "open"]
    assert [(e["id"], e["state"]) for e in closed] == [(opened["id"], "interrupted")]
    assert other.store.open_events() == []
    other.store.close()


def test_what_another_version_knew_costs_the_settings_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    b = Bench(tmp_path, one_loop())
    feed(b, a_step())
    feed(b, [("plant/L/settings", b'{"kp": 2.5}')])
    b.store.close()
    monkeypatch.setattr(memories, "LAYOUT", "another")
    with caplog.at_level(logging.WARNING, "loopsight"):
        again = Bench(tmp_path, one_loop())
    assert again.loops[0].kp == 2.5
    assert again.service.engine.verdict(0) is None
    assert "another version's" in caplog.text
    again.store.close()


def test_a_store_that_fails_forgets_nothing(tmp_path: Path) -> None:
    """What was due while it failed is kept when it is back."""
    b = Bench(tmp_path, one_loop())
    feed(b, a_step())
    b.store.failing = True
    feed(b, [("plant/L/settings", b'{"kp": 2.5}')])
    b.tick(2.0)
    b.store.failing = False
    b.tick(2.0)
    b.store.close()
    again = Bench(tmp_path, one_loop())
    assert again.loops[0].kp == 2.5
    again.store.close()


def test_quiet_loops_are_kept_in_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So many in a second, whoever waits longest first; at the end all."""
    monkeypatch.setattr(memories, "KEPT_A_SECOND", 2.0)
    b = Bench(tmp_path, LoopTable([Loop(name=f"L{k}") for k in range(5)]))
    changed = [set(range(5))]
    monkeypatch.setattr(b.service.engine, "take_changed", lambda: changed.pop() if changed else set())
    kept = []
    for _ in range(3):
        b.tick(1.0)
        kept.append({m.key for m in b.store.memories()})
    assert [len(k) for k in kept] == [2, 4, 5]
    b.service.finish()
    b.store.close()
