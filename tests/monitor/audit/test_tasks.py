"""Any cut into tasks, any number of processes: the same tables."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from monitor.audit import tasks
from monitor.audit.plan import plan
from monitor.audit.result import PARTS_FOLDER
from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.audit.tasks import Part, Task, run_task
from tests.monitor.audit.tools import about, content


def test_jobs_change_nothing(fleet_data: pd.DataFrame, table: Path, tmp_path: Path) -> None:
    fleet_data.sort_values(["loop", "time"]).to_parquet(tmp_path / "d.parquet", row_group_size=500)
    found = []
    for jobs in (1, 2):
        result = run_audit([tmp_path / "d.parquet"], table, tmp_path / f"o{jobs}", AuditSettings(jobs=jobs))
        assert result.exit_code == 0
        assert len(result.events) == 10
        found.append(content(tmp_path / f"o{jobs}"))
    assert found[0] == found[1]
    assert not (tmp_path / "o2" / PARTS_FOLDER).exists()


def leave(_: Any) -> None:
    """What a process does that is killed as soon as it starts."""
    os._exit(1)


def test_a_worker_that_is_killed_costs_nothing(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    run_audit([tmp_path / "d.parquet"], table, tmp_path / "one")
    monkeypatch.setattr(tasks, "_share", leave)
    run_audit([tmp_path / "d.parquet"], table, tmp_path / "two", AuditSettings(jobs=2))
    assert content(tmp_path / "two") == content(tmp_path / "one")


@pytest.mark.parametrize("n", [2, 3, 5])
def test_any_cut_into_tasks_gives_the_same(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path, n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files of every layout together, some loops in none, unknown ones too; tasks one after the other."""
    folder = tmp_path / "in"
    folder.mkdir()
    long = fleet_data.query("loop in ['LIC-0', 'LIC-1']")
    long.sort_values(["loop", "time"]).to_parquet(folder / "long.parquet", row_group_size=300)
    fleet_data.query("loop == 'LIC-2'").drop(columns="loop").to_csv(folder / "LIC-2.csv", index=False)
    wide = fleet_data.query("loop == 'LIC-3'").drop(columns="loop")
    wide = wide.rename(columns={c: f"LIC-3.{c}" for c in ("sp", "pv", "op")}).assign(**{"X.pv": "no"})
    wide.to_csv(folder / "wide.csv", index=False)
    fleet_data.query("loop == 'LIC-4'").assign(loop="other").to_csv(folder / "zz.csv", index=False)
    run_audit([folder], table, tmp_path / "one")
    one = content(tmp_path / "one")
    seen = about(tmp_path / "one")
    assert {s["loop"] for s in seen["skipped"]["loops"]} == {"X", "other"}
    assert seen["loops_without_data"] == ["LIC-4"]
    monkeypatch.setattr(
        "monitor.audit.run.plan", lambda loops, sources, span, _: plan(loops, sources, span, n)
    )
    run_audit([folder], table, tmp_path / "many")
    assert content(tmp_path / "many") == one


def test_resume_takes_over_what_is_done(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    run_audit([tmp_path / "d.parquet"], table, tmp_path / "whole")
    monkeypatch.setattr(
        "monitor.audit.run.plan", lambda loops, sources, span, _: plan(loops, sources, span, 3)
    )
    done: list[Task] = []

    def stops(task: Task, progress: Any) -> Part:
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(task)
        return run_task(task, progress)

    monkeypatch.setattr(tasks, "run_task", stops)
    with pytest.raises(KeyboardInterrupt):
        run_audit([tmp_path / "d.parquet"], table, tmp_path / "out")
    assert len(list((tmp_path / "out" / PARTS_FOLDER).iterdir())) == 2
    torn = min((tmp_path / "out" / PARTS_FOLDER).iterdir())
    torn.write_bytes(torn.read_bytes()[:-5])  # torn: done again
    again: list[Task] = []
    monkeypatch.setattr(
        tasks, "run_task", lambda task, progress: (again.append(task), run_task(task, progress))[1]
    )
    run_audit([tmp_path / "d.parquet"], table, tmp_path / "out", AuditSettings(resume=True))
    assert len(again) == 2
    assert content(tmp_path / "out") == content(tmp_path / "whole")
    # without --resume nothing is taken over
    done.clear()
    monkeypatch.setattr(tasks, "run_task", stops)
    with pytest.raises(KeyboardInterrupt):
        run_audit([tmp_path / "d.parquet"], table, tmp_path / "out")
    done.clear()
    with pytest.raises(KeyboardInterrupt):
        run_audit([tmp_path / "d.parquet"], table, tmp_path / "out")
    assert len(done) == 2
    # other settings, other parts
    assert len({t.identity(v) for t in again for v in ("1", "2")}) == 4


def test_a_set_point_in_another_unit_has_no_verdict(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path
) -> None:
    """SP in metres, PV in per cent: named in the row, and nothing is suggested; the others are judged."""
    wrong = fleet_data["loop"] == "LIC-0"
    fleet_data.assign(sp=fleet_data["sp"].where(~wrong, fleet_data["sp"] * 0.032)).to_parquet(
        tmp_path / "d.parquet"
    )
    rows = {r.loop: r for r in run_audit([tmp_path / "d.parquet"], table, tmp_path / "out").rows}
    assert rows["LIC-0"].verdict == "inconclusive"
    assert "SP is 1.6 where PV is 50" in rows["LIC-0"].reason
    assert "mapping_suspect" in rows["LIC-0"].flags
    assert rows["LIC-0"].new_kp is None
    assert not [r for r in rows.values() if r.loop != "LIC-0" and "mapping_suspect" in r.flags]
