"""What an audit says of itself: every row of the data is counted once, and what was left out has its reason."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from monitor.adapters.historian.rows import Tally
from monitor.audit.about import problems, why_nothing
from monitor.audit.inputs import Inputs
from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.contract.loops import Loop, LoopTable
from tests.monitor.audit.tools import about, step_test


def test_counts_add_up(fleet_data: pd.DataFrame, table: Path, tmp_path: Path) -> None:
    data = fleet_data.astype({"pv": object, "time": str})
    data.loc[10:14, "pv"] = "Bad Input"
    data.loc[20:22, "time"] = "never"
    data["quality"] = 192
    data.loc[30:33, "quality"] = 0
    data.loc[40:45, "quality"] = 64
    data = pd.concat([data, data.iloc[50:57]])
    text = data.to_csv(index=False) + "LIC-1,2026"
    (tmp_path / "d.csv").write_text(text)
    run_audit([tmp_path / "d.csv"], table, tmp_path / "out", AuditSettings(until="2026-03-01T00:10:00"))
    seen = about(tmp_path / "out")
    c = seen["counts"]
    assert c["rows"] == len(data) == seen["inputs"][0]["rows"]
    lost = {k: c[k] for k in ("bad_value", "bad_quality", "bad_time", "duplicate", "uncertain", "lost_lines")}
    assert lost == {
        "bad_value": 5, "bad_quality": 4, "bad_time": 3, "duplicate": 7, "uncertain": 6, "lost_lines": 1,
    }  # fmt: skip
    assert c["outside"] == 5 * 300
    assert c["rows"] == sum(
        c[k] for k in ("ok", "bad_value", "bad_quality", "bad_time", "duplicate", "late", "outside")
    )
    assert seen["text_in_values"] == {"count": 5, "most_frequent": {"Bad Input": 5}}
    assert seen["times_unreadable"] == ["never"]
    assert seen["skipped"]["lines"] == [
        {"name": "d.csv", "line": len(data) + 2, "reason": "2 cells, expected 6"}
    ]


def test_the_first_lost_lines_are_named_and_the_rest_counted() -> None:
    tally = Tally(lost_lines={"d.csv": 7}, lines={"d.csv": dict.fromkeys(range(2, 9), "2 cells, expected 5")})
    said = problems(Inputs(), tally, {"a\x1b[2J": "no column a.OP"})
    assert said[0] == "d.csv:2: 2 cells, expected 5"
    assert said[-2:] == ["d.csv: 2 more lines that cannot be read", "loop a\\x1b[2J: no column a.OP"]


def test_why_nothing_was_audited() -> None:
    inputs = Inputs(loops=LoopTable([Loop(name="LIC-1")]))
    none = dict.fromkeys(("bad_value", "bad_quality"), 0)
    assert (
        why_nothing(inputs, Tally(), none) == "no loop of the table is in the data; the table has LIC-1, ..."
    )
    assert (
        why_nothing(inputs, Tally(rows=9, bad_time=2), {**none, "bad_value": 7})
        == "no good sample in 9 rows: 7 bad_value, 2 bad_time"
    )


def test_a_night_when_clocks_go_back_is_said(tmp_path: Path) -> None:
    """Local times: exact with their zone; without it the hour that comes twice is named, with the way out."""
    data = step_test("TIC", n=3 * 3600)
    first = pd.Timestamp("2026-10-24T23:30:00").value
    utc = pd.to_datetime(data["time"] - data["time"][0] + first).dt.tz_localize("UTC")
    local = utc.dt.tz_convert("Europe/Berlin").dt.strftime("%d/%m/%Y %H:%M:%S")
    data.assign(time=local).to_csv(tmp_path / "d.csv", index=False)
    (tmp_path / "loops.csv").write_text("name,kp,ti\nTIC,8,40\n")
    given = [tmp_path / "d.csv"], tmp_path / "loops.csv", tmp_path / "out"
    without = run_audit(*given)
    assert without.exit_code == 0
    assert [said for said in without.problems if said.startswith("times repeat or go back: 3600 rows")]
    assert "--tz" in without.problems[0]
    exact = run_audit(*given, AuditSettings(tz="Europe/Berlin"))
    assert exact.problems == []
    assert exact.counts["ok"] == len(data)
    assert [e.start for e in exact.events] == [utc[300].value, utc[600].value]


def test_repeated_rows_are_no_clock_that_went_back() -> None:
    """Overlapping exports hold the same values."""
    assert problems(Inputs(), Tally(duplicate=5), {}) == []
    assert problems(Inputs(), Tally(duplicate=5, conflict=2), {})[0].startswith(
        "times repeat or go back: 2 rows"
    )
