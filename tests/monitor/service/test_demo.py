"""The demo as a newcomer runs it: a plant, a monitor, suggestions that hold the truth, and nothing left behind."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.monitor.cli.tools import run
from tests.monitor.service.tools import command
from tests.support.processes import children, gone
from tests.support.waiting import PATIENCE, until

EVENTS = [
    "loop",
    "id",
    "event",
    "kind",
    "start",
    "end",
    "state",
    "amplitude",
    "iae",
    "ci",
    "process",
    "gain",
    "gain_lo",
    "gain_hi",
    "t0",
    "t0_lo",
    "t0_hi",
    "dead_time",
    "dead_time_lo",
    "dead_time_hi",
    "lag",
    "lag_lo",
    "lag_hi",
    "method",
    "fit",
    "coverage",
    "verdict",
    "reason",
]
LOOPS = [
    "loop",
    "verdict",
    "reason",
    "action",
    "events",
    "ci_setpoint",
    "ci_load",
    "ms",
    "process",
    "gain",
    "gain_lo",
    "gain_hi",
    "t0",
    "t0_lo",
    "t0_hi",
    "dead_time",
    "dead_time_lo",
    "dead_time_hi",
    "lag",
    "lag_lo",
    "lag_hi",
    "rule",
    "form",
    "new_kp",
    "new_ti",
    "new_td",
    "new_tf",
    "new_ki",
    "new_kd",
    "new_fields",
    "new_ms",
    "new_ms_worst",
    "new_ci",
    "new_op_noise",
    "new_op_noise_abs",
    "stages",
    "coverage",
    "saturation",
    "manual",
    "offset",
    "noise",
    "quantum",
    "travel_per_hour",
    "reversals_per_hour",
    "oscillation_period",
    "oscillation_regularity",
    "stiction",
    "harris",
    "compression",
    "flags",
]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """A run of eight seconds at 300 times real time: its output, its tables, and the plant's process."""
    out = tmp_path_factory.mktemp("demo") / "out"
    started = subprocess.Popen(
        command("--seconds", "8", "--speed", "300", "--out", str(out)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    plants = until(lambda: children(started.pid))
    said, errors = started.communicate(timeout=PATIENCE)
    assert started.returncode == 0, errors
    return said, out, plants


def test_suggestions_hold_the_truth(demo):
    """At least one loop is to be retuned, and its gain and T0 lie where the plant's truth lies."""
    _, out, _ = demo
    truth = {r["loop"]: r for r in csv.DictReader((out / "truth.csv").read_text().splitlines())}
    rows = [
        r
        for r in pq.read_table(out / "loops.parquet").to_pylist()
        if r["verdict"] == "retune" and r["new_kp"] is not None
    ]
    assert rows
    good = [
        r
        for r in rows
        if all(r[f"{n}_lo"] <= float(truth[r["loop"]][n]) <= r[f"{n}_hi"] for n in ("gain", "t0"))
    ]
    print(f"{len(good)} of {len(rows)} suggestions hold gain and T0")
    assert good
    assert {r["loop"] for r in rows} <= {n for n, r in truth.items() if r["tuning"] not in {"good", "manual"}}


def test_tables_have_the_columns_of_the_contract(demo):
    """All of them, under their names; loops worst first; a csv beside."""
    _, out, _ = demo
    events, loops = pq.read_table(out / "events.parquet"), pq.read_table(out / "loops.parquet")
    assert set(EVENTS) <= set(events.column_names)
    assert set(LOOPS) <= set(loops.column_names)
    assert str(events.schema.field("start").type).startswith("timestamp")
    assert len(events) >= 10
    order = ["retune", "inconclusive", "good", "not_assessed"]
    verdicts = [order.index(v) for v in loops["verdict"].to_pylist()]
    assert verdicts == sorted(verdicts)
    assert (out / "loops.csv").read_text().count("\n") == len(loops) + 1


def test_it_says_what_happens(demo):
    """Ready, suggestions, and the loops at the end."""
    said, _, _ = demo
    assert said.startswith("ready") or "\nready" in said
    assert "suggestion" in said
    assert "Loops, worst first" in said


def test_no_process_is_left(demo):
    """The plant ends with the demo."""
    _, _, plants = demo
    until(lambda: all(gone(p) for p in plants))


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_however_it_ends_the_plant_ends_too(number):
    """Told to stop: exit 0 and nothing left; killed: the plant notices."""
    with subprocess.Popen(
        command("--speed", "50"), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as started:
        assert started.stdout is not None
        for line in started.stdout:
            if "ready" in line:
                break
        plants = until(lambda: children(started.pid))
        os.kill(started.pid, number)
        started.stdout.read()
        code = started.wait(PATIENCE)
    assert code == (-signal.SIGKILL if number == signal.SIGKILL else 0)
    until(lambda: all(gone(p) for p in plants))


@pytest.mark.slow
def test_status_beside_a_running_demo():
    """`loopsight status` shows the demo and its loops, wherever it listens."""
    started = subprocess.Popen(
        command("--seconds", "100000"), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert started.stdout is not None
    try:
        ready = next(line for line in started.stdout if "ready" in line)
        endpoint, loops = re.findall(r"tcp/\S+", ready)[0], int(re.findall(r"(\d+) loops", ready)[0])

        def health() -> dict[str, Any]:
            done = run("status", "--json", "--connect", endpoint)
            return dict(json.loads(done.stdout)) if done.returncode == 0 else {}

        answer = until(lambda: found if (found := health()).get("samples_ok") else None)
        assert (answer["id"], answer["ready"]) == ("demo", True)
        assert answer["loops"]["total"] == loops > 5
        assert "monitor demo: ready, up " in run("status", "--connect", endpoint).stdout
    finally:
        started.send_signal(signal.SIGTERM)
        started.stdout.read()
        started.stdout.close()
    assert started.wait(PATIENCE) == 0
