"""Open events outlive a kill: assessed, or closed with the gap named; what is on disk is old or new, never half."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment
from monitor.service.config import Config
from monitor.service.service import Service
from monitor.service.snapshot import FILE_VERSION, KEPT_LOOPS, read, take, write
from tests.support.bus import FakeBus
from tests.support.stores import quick

START = 1_767_225_600
N = 700


class Run:
    """A process of the monitor: killed, it leaves only its folder."""

    def __init__(self, folder: Path, names: tuple[str, ...] = ("L",), **config: Any) -> None:
        self.folder, self.now = folder, START * 10**9
        self.bus, self.store = FakeBus(), quick(folder)
        self.heard: list[Any] = []
        self.loops = LoopTable([Loop(name=n, kp=1.0, period=1.0) for n in names])
        self.service = Service(
            Config(loops="t" if names else "", **config), self.loops, self.bus, self.store,
            heard=self.heard.append, clock=lambda: self.now, monotonic=lambda: self.now * 1e-9,
            open_file=folder / "open.npz",
        )  # fmt: skip

    def feed(self, rows: range, names: tuple[str, ...] = ("L",)) -> None:
        """A second for each row of a step that takes half a minute."""
        for k in rows:
            self.now = (START + k) * 10**9
            for name in names:
                sp, pv = (1.0 if k >= 200 else 0.0), float(np.clip((k - 200) / 30, 0.0, 1.0))
                sample = {"t": START + k, "sp": sp, "pv": pv, "op": sp - pv}
                self.bus.put(f"plant/{name}", json.dumps(sample).encode(), self.now)
            self.service.tick()

    def kill(self) -> None:
        """End without a word."""
        self.store.close()

    @property
    def assessments(self) -> list[Assessment]:
        return [r for r in self.heard if isinstance(r, Assessment)]


def test_killed_in_mid_event_and_back_behind_a_gap(tmp_path, caplog):
    """A minute down: the event is closed by the gap at its last sample, and assessed; nothing stays open."""
    first = Run(tmp_path)
    first.feed(range(221))
    (opened,) = first.bus.kinds("event")
    first.kill()
    second = Run(tmp_path)
    with caplog.at_level(logging.WARNING, "loopsight"):
        second.feed(range(281, N))
    (closed,) = second.bus.kinds("event")
    assert (closed["id"], closed["state"]) == (opened["id"], "interrupted")
    (found,) = second.assessments
    assert "gap" in found.reason
    assert found.id == opened["id"]
    assert START + 205 <= found.end / 1e9 <= START + 221
    assert second.store.open_events() == []
    row = second.service.row(0)
    assert row.coverage is not None
    assert row.coverage < 0.95  # the time that it was down is a gap
    second.kill()


def test_killed_and_back_before_a_gap(tmp_path):
    """Down for less than three periods, with a state as old as that: the event goes on as if nothing had happened."""
    whole = Run(tmp_path / "whole")
    whole.feed(range(N))
    whole.kill()
    for at in (211, 215, 221):
        first = Run(tmp_path / str(at))
        first.feed(range(at))
        first.service._open.keep(first.service.engine, first.service.reorder, first.now)
        first.kill()
        second = Run(tmp_path / str(at))
        second.feed(range(at, N))
        assert second.assessments == whole.assessments
        states = [e["state"] for e in second.bus.kinds("event")]
        assert (
            states == ["open", "settled"][at > 211 :]
        )  # killed right after it opened: it may not have been said
        second.kill()


def test_an_event_of_which_nothing_was_kept_is_interrupted(tmp_path, caplog):
    """Killed right after it opened, or its file is gone: said and stored as interrupted, once."""
    first = Run(tmp_path)
    first.feed(range(221))
    (opened,) = first.bus.kinds("event")
    first.kill()
    (tmp_path / "open.npz").unlink(missing_ok=True)
    with caplog.at_level(logging.WARNING, "loopsight"):
        second = Run(tmp_path)
    assert "1 events were open when the last run ended: interrupted" in caplog.messages
    second.feed(range(300, 302))
    assert [(e["id"], e["state"]) for e in second.bus.kinds("event")] == [(opened["id"], "interrupted")]
    second.kill()
    third = Run(tmp_path)
    third.feed(range(303, 305))
    assert third.bus.kinds("event") == []
    third.kill()


def test_told_to_stop_leaves_nothing_open(tmp_path):
    """An orderly end closes events; the next run takes up nothing."""
    first = Run(tmp_path)
    first.feed(range(221))
    first.service.finish()
    first.kill()
    found = read(tmp_path / "open.npz")
    assert found is None or not len(found.names)
    second = Run(tmp_path)
    assert not second.service._left_open
    assert second.service.status().loops.open == 0
    second.kill()


def test_loops_that_registered_themselves_are_there_again(tmp_path):
    """Without a table: those with an open event are known before they speak."""
    first = Run(tmp_path, ())
    first.feed(range(221), ("A", "B"))
    first.kill()
    second = Run(tmp_path, ())
    assert sorted(loop.name for loop in second.loops) == ["A", "B"]
    assert second.service.status().loops.open == 2
    second.kill()


def test_loops_that_are_gone_from_the_table(tmp_path):
    """Their events are left; the others go on, in whatever rows they are now."""
    first = Run(tmp_path, ("A", "B", "C"))
    first.feed(range(221), ("A", "B", "C"))
    first.kill()
    second = Run(tmp_path, ("C", "X", "A"))
    assert list(second.service.engine.open_rows()) == [0, 2]
    second.feed(range(221, N), ("C", "X", "A"))
    assert {a.loop for a in second.assessments} == {"A", "C"}
    second.kill()


@pytest.mark.parametrize("damage", ["cut", "zeros", "text", "other layout", "older version", "flipped"])
def test_a_damaged_file_is_left_alone(tmp_path, damage, caplog):
    """Whatever stands there: the monitor starts, and says so."""
    first = Run(tmp_path)
    first.feed(range(221))
    first.kill()
    path = tmp_path / "open.npz"
    whole = path.read_bytes()
    if damage == "other layout":
        kept = read(path)
        assert kept is not None
        kept.arrays["state"] = np.zeros(1, [("phase", np.int64)])
        write(path, kept)
    elif damage == "older version":
        kept = read(path)
        assert kept is not None
        write(path, replace(kept, version=FILE_VERSION - 1))
    else:
        middle = len(whole) // 2
        flipped = whole[:middle] + bytes(b ^ 255 for b in whole[middle : middle + 50]) + whole[middle + 50 :]
        content = {"cut": whole[:-100], "zeros": bytes(1000), "text": b"no archive", "flipped": flipped}
        path.write_bytes(content[damage])
    second = Run(tmp_path)
    assert "not taken up again" in caplog.text
    second.feed(range(300, 305))
    assert second.service.status().loops.open == 0
    second.kill()


def test_a_full_disk_leaves_the_old_one(tmp_path, monkeypatch):
    """What cannot be written leaves what is there, and the tick goes on."""
    first = Run(tmp_path)
    first.feed(range(221))
    before = (tmp_path / "open.npz").read_bytes()

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("monitor.adapters.files.os.fsync", full)
    first.feed(range(221, 235))
    assert (tmp_path / "open.npz").read_bytes() == before
    first.kill()


def test_an_upset_of_the_whole_plant_is_bounded(tmp_path):
    """More open events than are kept: the first ones."""
    names = tuple(f"L{k}" for k in range(KEPT_LOOPS + 20))
    run = Run(tmp_path, names)
    run.feed(range(180, 206), names)
    assert run.service.status().loops.open == KEPT_LOOPS + 20
    kept = take(run.service.engine, run.service.reorder, run.now)
    assert len(kept.names) == KEPT_LOOPS
    run.kill()
