"""Tasks read as little of the files as they can."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from monitor.adapters.historian.merge import Span
from monitor.audit import plan as planning
from monitor.audit.inputs import find
from monitor.audit.plan import plan
from monitor.audit.tasks import Task


def cut(data: pd.DataFrame, file: Path, jobs: int) -> list[Task]:
    data.to_parquet(file, row_group_size=500)
    found = find([file], None, file.parent / "out")
    return plan(list(found.loops), found.sources, Span(), jobs)


def test_in_order_of_loops_small_in_order_of_time_one_for_each_job(
    fleet_data: pd.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planning, "MOST_TASK_ROWS", len(fleet_data) // 4)
    by_loop = cut(fleet_data.sort_values(["loop", "time"]), tmp_path / "loops.parquet", 1)
    assert len(by_loop) > 2
    by_time = fleet_data.sort_values(["time", "loop"])
    assert len(cut(by_time, tmp_path / "times.parquet", 1)) == 1
    tasks = cut(by_time, tmp_path / "two.parquet", 2)
    assert len(tasks) == 2
    assert sorted(loop.name for t in tasks for loop in t.loops) == sorted(set(by_time["loop"]))
