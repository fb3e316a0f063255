"""Rows 50 to 56 and 61 to 63 of the bad-data matrix: loops that come and go, bursts, losses, months."""

from __future__ import annotations

import gc
import json
import logging
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from monitor.adapters.inbox import Inbox
from monitor.adapters.store import StoreError
from monitor.contract.records import GOOD
from tests.bad_data.harness import (
    LOST,
    NAME,
    SECOND,
    SETTINGS,
    START,
    Live,
    Outcome,
    both,
    frame_of,
    good,
    live,
    messages,
    same,
)

N = 700


def test_loops_that_come_and_go(clean: Outcome, tmp_path: Path) -> None:
    """One joins in mid-stream, one vanishes, one is renamed: the others' records are the same to the last bit."""
    parts = [
        good(N),
        good(N, name="JOINS", seed=1)[250:],
        good(N, name="VANISHES", seed=2)[:330],
        good(N, name="OLD-NAME", seed=3)[:200],
        good(N, name="NEW-NAME", seed=3)[200:],
    ]
    data = pd.concat(parts).sort_values("time", kind="stable", ignore_index=True)
    monitor = Live(tmp_path, [])
    for _, second in data.groupby("time"):
        monitor.put([("plant/frame", frame_of(second))], 1.0)
    status = monitor.status()
    assert status["stale"] == ["VANISHES", "OLD-NAME"]
    assert status["loops"]["total"] == 5
    found = monitor.outcome()
    monitor.close()
    alone = live(good(N), tmp_path / "alone", "frame", [])
    mine = [e for e in found.events if e.loop == NAME]
    assert mine == alone.events
    assert found.rows[NAME] == alone.rows[NAME]
    assert {e.id for e in mine} == {clean.event.id}
    assert [e.state for e in found.events if e.loop == "VANISHES"] == ["interrupted"]


def test_a_name_that_comes_back_goes_on_behind_a_gap(tmp_path: Path) -> None:
    """Silent for two hours, then there again: the same row, nothing integrated across."""
    data = good(1700, at=1100)
    data["time"] = data["time"].where(data.index < 600, data["time"] + 7200 * SECOND)
    found = both(data, tmp_path)
    assert (found.states, found.row.verdict) == (["settled"], GOOD)
    assert 0.15 < found.row.coverage < 0.25


@pytest.mark.parametrize("payload", ["sample", "frame", "tag"])
def test_a_loop_of_no_table_is_given_up_after_a_month(
    clean: Outcome, tmp_path: Path, caplog: pytest.LogCaptureFixture, payload: str
) -> None:
    """Said once; its row is as new for the next loop, and for itself; loops of the table are never given up."""
    monitor = Live(tmp_path, [{"name": "TABLE"}, SETTINGS], auto_register=True)
    parts = [good(650, name="GOES"), good(650, name="TABLE")]
    data = pd.concat(parts).sort_values("time", kind="stable", ignore_index=True)
    with caplog.at_level(logging.WARNING, "loopsight"):
        for single in messages(data, payload):
            monitor.put(single, 0.5)
        monitor.wait(29 * 86_400.0)
        monitor.wait(60.0)
        assert monitor.status()["loops"]["total"] == 3
        monitor.wait(86_400.0)
        monitor.wait(60.0)
        status = monitor.status()
    assert status["loops"]["total"] == 2
    assert status["stale"] == ["TABLE"]
    assert [m for m in caplog.messages if "GOES" in m] == ["given up after a long silence: GOES"]
    assert status["samples_ok"] == 1300
    assert {r.loop for r in monitor.service.rows()} == {NAME, "TABLE"}
    late = (monitor.now - START * SECOND) // SECOND * SECOND
    parts = [good(N, name="NEW"), good(N, name="GOES")]
    data = pd.concat(parts).sort_values("time", kind="stable", ignore_index=True)
    for single in messages(data.assign(time=data["time"] + late), payload):
        monitor.put(single, 0.5)
    assert len(monitor.loops) == 4
    found = monitor.outcome()
    monitor.close()
    found.counted(ok=1300 + 2 * N)
    for name in ("NEW", "GOES"):
        mine = [e for e in found.events if e.loop == name and e.start > START * SECOND + late]
        assert [(e.start - late, e.event, e.iae) for e in mine] == [(clean.event.start, 1, clean.event.iae)]
        assert found.rows[name].events == 1
        assert found.rows[name].noise == clean.row.noise


@pytest.mark.parametrize("payload", ["sample", "frame", "tag"])
def test_a_backlog_of_a_minute_in_one_go(clean: Outcome, tmp_path: Path, payload: str) -> None:
    """What piled up at a gateway comes at once: in order of the source's time, no wrong interval; the delay shows."""
    monitor = Live(tmp_path)
    rows = messages(good(N), payload)
    for k in range(290):
        monitor.put(rows[k], 1.0)
    late = monitor.now
    for k in range(290, 350):
        for key, data in rows[k]:
            monitor.bus.put(key, data, late + (k - 290) * SECOND)
    monitor.wait(60.0)
    said = [json.loads(p) for k, p, _ in monitor.bus.said if k.endswith("/@/monitor/status")]
    for k in range(350, N):
        monitor.put(rows[k], 1.0)
    found = monitor.outcome()
    monitor.close()
    same(found, clean)
    assert said[-1]["latency"] == pytest.approx(60.0, abs=0.1)
    assert found.about["latency"] < 1.0


def test_a_consumer_that_is_too_slow_loses_the_oldest_and_counts(tmp_path: Path) -> None:
    """The ring is full: its oldest go, each counted; what is left is used, and the hole is a gap."""
    monitor = Live(tmp_path)
    monitor.bus.inbox = Inbox(most=100)
    rows = [m for single in messages(good(N)) for m in single]
    monitor.put(rows[:50], 50.0)
    for message in rows[50:550]:
        monitor.bus.put(*message, monitor.now)
    monitor.wait(500.0)
    monitor.put(rows[550:], 150.0)
    found = monitor.outcome()
    monitor.close()
    assert (found.about["dropped"], found.counts["ok"], found.about["messages"]) == (450, 250, N)
    assert found.row.coverage < 0.5


def test_a_failing_disk_stops_nothing(
    clean: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No write succeeds while the step happens: detection goes on, not ready; afterwards all is said, no restart."""
    monitor = Live(tmp_path)
    works = type(monitor.store).transaction

    def fails(_: object) -> object:
        raise StoreError("disk full")

    for k, single in enumerate(messages(good(N))):
        monkeypatch.setattr(type(monitor.store), "transaction", fails if 250 <= k < 650 else works)
        monitor.put(single, 1.0)
        if 310 <= k < 650:
            assert not monitor.status()["ready"]
            assert monitor.status()["waiting_for_store"] > 0
    assert monitor.status()["ready"]
    found = monitor.outcome()
    kept = monitor.store.counts()["assessment"]
    monitor.close()
    same(found, clean)
    assert kept == 1
    assert found.about["records_lost"] == 0


def test_other_units_of_the_whole_record(clean: Outcome, tmp_path: Path) -> None:
    """SP and PV as 1.8 x + 32, OP as a fraction: the same events; indices the same, the integral scales."""
    data = good(N)
    for column in ("sp", "pv"):
        data[column] = 1.8 * data[column] + 32.0
    data["op"] *= 0.01
    found = both(data, tmp_path, table=[{**SETTINGS, "kp": 14.0 * 0.01 / 1.8}])
    assert [(e.id, e.state, e.end) for e in found.events] == [(e.id, e.state, e.end) for e in clean.events]
    assert found.row.verdict == clean.row.verdict
    assert found.event.ci == pytest.approx(clean.event.ci, rel=1e-6)
    assert found.event.ms == pytest.approx(clean.event.ms, rel=1e-3)
    assert found.event.iae == pytest.approx(1.8 * clean.event.iae, rel=1e-6)
    assert found.event.gain == pytest.approx(180 * clean.event.gain, rel=1e-6)


@pytest.mark.parametrize("every", [0.5, 7.0, 120.0])
def test_stream_and_batch(clean: Outcome, tmp_path: Path, every: float) -> None:
    """However the samples are cut into ticks, live is the audit, to the last bit."""
    same(live(good(N), tmp_path, every=every), clean)


# ---------------------------------------------------------------------------------------------------
# months


def resident() -> int:
    """Memory of this process [bytes]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def open_files() -> int:
    """How many file descriptors this process has open."""
    return len(list(Path("/proc/self/fd").iterdir()))


class Plant:
    """Levels under PI control, sampled once a minute; the first of them step their set points twice a day."""

    def __init__(self, loops: int, stepping: int) -> None:
        self.names = [f"L{k}" for k in range(loops)]
        self.stepping, self.minute = stepping, 0
        self.rng = np.random.default_rng(0)
        self.sp, self.level = np.full(loops, 50.0), np.full(loops, 50.0)
        self.integral = np.zeros(loops)
        self.op = np.full((4, loops), 40.0)
        """Now, and one, two and three minutes ago."""

    @property
    def table(self) -> list[dict[str, Any]]:
        """Its loops and their settings, which suit them."""
        return [{"name": n, "kp": 14.0 / 60, "ti": 3600.0} for n in self.names]

    def advance(self, minutes: int) -> pd.DataFrame:
        """What is sampled in the next minutes; one value in a hundred thousand is none, as many are called bad."""
        n = len(self.names)
        sp, pv, op = np.empty((3, minutes, n))
        for k in range(minutes):
            due = np.arange(self.minute % 720, self.stepping, 720)
            self.sp[due] = 105.0 - self.sp[due] if self.minute > 720 else 50.0 + 5.0 * (due % 2)
            self.level += 0.6 * (self.op[3] - 40.0)
            sp[k], pv[k] = self.sp, self.level + self.rng.normal(0, 0.02, n)
            e = sp[k] - pv[k]
            self.integral += e / 60.0
            self.op = np.roll(self.op, 1, axis=0)
            op[k] = self.op[0] = 40.0 + 14.0 / 60 * (e + self.integral)
            self.minute += 1
        times = START * SECOND + (self.minute - minutes + np.arange(minutes)) * 60 * SECOND
        spoilt = self.rng.random(pv.size) < 1e-5
        quality = np.where(self.rng.random(pv.size) < 1e-5, 0.0, 192.0)
        return pd.DataFrame(
            {
                "loop": np.tile(self.names, minutes),
                "time": np.repeat(times, n),
                "sp": sp.ravel(),
                "pv": np.where(spoilt, np.nan, pv.ravel()),
                "op": op.ravel(),
                "quality": quality,
            }
        )


def month(folder: Path, loops: int, stepping: int, minutes: int, days: int = 30) -> dict[str, float]:
    """Run a plant through the service, in frames of so many minutes, with all kinds of trouble; return the figures.

    Once a day the newest frame comes again, an old one is sent anew, a loop that nobody knows speaks, and something
    that cannot be read comes. Memory, file descriptors and threads stay; every sample has one cause.
    """
    plant = Plant(loops, stepping)
    monitor = Live(folder, plant.table)
    monitor.bus.keep = False
    monitor.service._heard = None  # the harness keeps all that it hears
    seen, memory, ticks = 0, [], []
    gc.freeze()  # what the other tests have left is not looked through each day
    begun: tuple[int, int] | None = None
    old = None
    for done in range(0, days * 1440, minutes):
        data = plant.advance(minutes)
        frame = frame_of(data)
        said = [("plant/frame", frame)]
        seen += len(data)
        if done % 1440 == 0:
            strange = data[:1].assign(loop="NOBODY")
            said += [
                ("plant/frame", frame),
                ("plant/frame", old or frame),
                ("plant/frame", frame_of(strange)),
            ]
            said.append(("plant/L0", b"{"))
            seen += 2 * len(data) + 1
            old = frame
        begin = time.thread_time()
        monitor.put(said, minutes * 60.0)
        ticks.append(time.thread_time() - begin)
        if done % 1440 == 0:
            gc.collect()
            memory.append(resident())
            if done == 5 * 1440:
                begun = open_files(), threading.active_count()
    status = monitor.status()
    used = status["samples_ok"] + status["held"] + sum(status.get(name, 0) for name in LOST)
    assert used == seen
    assert min(status[n] for n in ("bad_value", "bad_quality", "duplicate", "late", "unknown_loop")) > 0
    assert status["malformed"] == days
    assert status["dropped"] == status["records_lost"] == status["backlog"] == 0
    found = monitor.store.counts()["assessment"]
    assert found > 0.9 * stepping * days
    assert (open_files(), threading.active_count()) == begun
    half = len(memory) // 2
    slope = float(np.polyfit(np.arange(half), memory[-half:], 1)[0]) / 1e6
    assert slope < max(0.5, 0.001 * memory[-1] / 1e6), f"{slope:.2f} MB a day"
    monitor.close()
    return {
        "samples": seen, "assessed": found, "MB": memory[-1] / 1e6, "MB a day": slope,
        "tick_p99": float(np.quantile(ticks, 0.99)), "tick_most": max(ticks),
    }  # fmt: skip


def test_a_month(tmp_path: Path) -> None:
    """Thirty days of a few loops: memory, file descriptors and threads flat, every sample accounted for."""
    month(tmp_path, 5, 2, 240)


@pytest.mark.soak
def test_a_month_of_a_thousand_loops(tmp_path: Path) -> None:
    """The same for a thousand loops, a frame a minute: 43 million samples, thousands of events (ten minutes).

    A tick, with all that is due once in ten seconds, stays below 50 ms in 99 of 100, assessments included.
    """
    figures = month(tmp_path, 1000, 100, 1)
    print(figures)
    assert figures["tick_p99"] < 0.05
