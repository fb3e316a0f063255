"""An audit's facts, made up: a loop of each kind with its evidence, and as many more as a test wants."""

from __future__ import annotations

import json
import math

import numpy as np

from monitor.audit.summary import summary_of
from monitor.contract.evidence import Answers, Window
from monitor.contract.records import Assessment, LoopRow
from monitor.contract.summary import Contents

START = 1_772_323_200 * 10**9
ABOUT = {
    "versions": {"loopsight": "0.1.0"},
    "first_sample": "2026-03-01T00:00:00.000000000Z",
    "newest_sample": "2026-03-08T00:00:00.000000000Z",
    "time_zone": "UTC",
    "times_without_zone": [],
    "inputs": [{"name": "week.parquet"}],
    "settings": {"loops": {"name": "loops.csv"}},
    "counts": {"ok": 1000, "rows": 1001, "events": 7},
    "skipped": {"files": [{"name": "bad.csv", "reason": "no time column"}], "lines": [], "loops": []},
}
STAGES = ({"kp": 3.0, "ti": 90.0, "td": 0.0, "tf": 0.0}, {"kp": 4.5, "ti": 80.0, "td": 0.0, "tf": 0.0})


def retune(name: str = "LIC-101", **more: object) -> LoopRow:
    """A slow loop with settings to be typed in, in two parts."""
    facts: dict[str, object] = {
        "loop": name, "verdict": "retune", "reason": "slow to follow: CI_sp = 0.25 (0.6 at least); rolls",
        "action": "set kp = 3, ti = 90 s; watch PV and OP for 5 min", "events": 4, "ci_setpoint": 0.25, "ms": 1.4,
        "process": "integrating", "gain": 0.01, "gain_lo": 0.009, "gain_hi": 0.011, "dead_time": 3.0,
        "dead_time_lo": 2.0, "dead_time_hi": 4.0, "rule": "simc-pi", "form": "deltav-pid", "kp": 1.2, "ti": 300.0,
        "td": 0.0, "tf": 0.0, "settings_source": "table", "new_kp": 3.0, "new_ti": 90.0, "new_td": 0.0, "new_tf": 0.0,
        "stages": json.dumps(STAGES), "fields": json.dumps({"GAIN": 0.75, "RESET": 300.0, "note": "series or not?"}),
        "new_fields": json.dumps({"GAIN": 1.9, "RESET": 90.0}), "new_ms": 1.5, "new_ms_worst": 1.8, "new_ci": 0.9,
        "stage_fields": json.dumps([{"GAIN": 1.9, "RESET": 90.0}, {"GAIN": 2.8, "RESET": 80.0}]),
        "iae_setpoint": 120.0, "iae_load": 300.0, "new_iae_setpoint": 60.0, "new_iae_load": 30.0, "coverage": 0.99,
        "noise": 0.02, "travel_per_hour": 12.0,
    }  # fmt: skip
    return LoopRow(**{**facts, **more})  # type: ignore[arg-type]


def fleet() -> list[LoopRow]:
    """One loop of each kind, worst first."""
    return [
        retune("PIC-7", ms=4.0, flags=("near_instability",), reason="too close to instability: Ms = 4 (2.75 at most)"),
        LoopRow(loop="FIC-2", verdict="inconclusive", reason="the valve sticks: OP travels 3 % after a reversal",
                action="check the valve", flags=("stiction", "oscillating"), oscillation_period=600.0, coverage=1.0),
        LoopRow(loop="TIC-3", verdict="inconclusive", reason="it oscillates with a period of 90 s",
                action="find the source first", flags=("oscillating",), oscillation_period=90.0, ci_load=0.9, ms=1.5),
        retune(),
        LoopRow(loop="AIC-5", verdict="inconclusive", reason="sampled too coarsely", action="sample the loop faster",
                flags=("undersampled",)),
        LoopRow(loop="LIC-8", verdict="good", ci_setpoint=0.9, ms=1.6, events=12, coverage=1.0),
        LoopRow(loop="LIC-6", verdict="not_assessed", reason="in manual for 80% of the time",
                action="find out why it is kept in manual", flags=("manual",), manual=0.8),
    ]  # fmt: skip


def event(name: str, k: int = 0) -> Assessment:
    onset = START + k * 3600 * 10**9
    return Assessment(
        loop=name, id=f"{name}/{k}", event=k + 1, kind="setpoint", start=onset, end=onset + 200 * 10**9,
        state="settled", amplitude=5.0, ci=0.25, ms=1.4, fit=0.98, method="direct", verdict="retune", reason="slow",
    )  # fmt: skip


def window(name: str, k: int = 0, n: int = 300) -> Window:
    onset = START + k * 3600 * 10**9
    time = np.arange(-60, n - 60)
    pv = np.where(time > 0, 5.0 * (1 - np.exp(-np.maximum(time, 0) / 60.0)), 0.0) + 50.0
    return Window(
        id=f"{name}/{k}", loop=name, onset=onset, time=onset + time * 10**9, sp=np.where(time >= 0, 55.0, 50.0),
        pv=pv + 0.02 * np.sin(time), op=40.0 + 3.0 * np.exp(-np.maximum(time, 0) / 60.0) * (time >= 0), model=pv,
    )  # fmt: skip


def answers(name: str) -> list[Answers]:
    time = np.linspace(0.0, 600.0, 121)
    slow, fast = 1 - np.exp(-time / 120.0), 1 - np.exp(-time / 40.0)
    setpoint = Answers(name, "setpoint", time, slow * [[1.0], [0.9], [1.1]], fast * [[1.0], [0.95], [1.05]])
    load = Answers(
        name, "load", time, np.full((3, 121), math.nan), np.exp(-time / 40.0) * [[1.0], [0.9], [1.1]]
    )
    return [load, setpoint]


def contents(rows: list[LoopRow] | None = None, events: int = 2) -> Contents:
    """What a report of these rows shows; each loop to be retuned has some events with windows, and answers."""
    rows = fleet() if rows is None else rows
    seen = [r.loop for r in rows if r.verdict == "retune"]
    return Contents(
        ABOUT,
        rows,
        [event(name, k) for name in seen for k in range(events)],
        [window(name, k) for name in seen for k in range(events)],
        [a for name in seen for a in answers(name)],
        summary_of(rows),
    )
