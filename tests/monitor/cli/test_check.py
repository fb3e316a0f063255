"""The command `loopsight check`: exit codes, and what it says of what it cannot check."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from tests.monitor.cli.check_tools import GOOD, check


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("x.csv", "", "x.csv: an empty file"),
        ("x.csv", "a,b\n1,2\n", "columns a, b, expected columns `loop, time"),
        ("x.csv", "loop,time,sp,pv,op\n", "no rows"),
        ("x.csv", "time,A.SP,A.PV\n1,2,3\n", "loop A: no column or tag of its OP"),
        ("x.csv", "loop,time,sp,pv,op\n" + "n" * 300 + ",1,2,3,4\n", "at most 200 bytes"),
        ("x.csv", "name,ti\nA,-3\n", "x.csv:2: ti: '-3', expected seconds above 0"),
        ("x.csv", "name,objective\nA,fast\n", "x.csv:2: objective: 'fast', expected one of both, setpoint"),
        ("x.toml", "[[loop]]\nname = 'A'\nti = -3\n", "x.toml:1: ti: -3, expected seconds above 0"),
        ("x.toml", "reorder_window = -1\n", "x.toml"),
        ("x.toml", "[[loop]\n", "x.toml: "),
        ("x.parquet", "nonsense", "x.parquet: "),
        ("x.doc", "nonsense", "suffix '.doc', expected .parquet or .csv"),
    ],
)
def test_problems_are_exit_2(tmp_path: Path, name: str, text: str, problem: str) -> None:
    (tmp_path / name).write_text(text)
    result = check(tmp_path / name)
    assert result.exit_code == 2
    assert problem in result.stderr
    assert "Traceback" not in result.output


def test_missing_file_and_wrong_zone(file: Path) -> None:
    assert "no such file" in check(file).stderr
    assert check(file).exit_code == 2
    file.write_text(GOOD)
    result = check(file, "--tz", "Mars")
    assert result.exit_code == 2
    assert "--tz: 'Mars'" in result.stderr


def test_loop_tables_and_configurations_that_are_fine(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("name,kp,ti\nA,1,20\nB,,\n")
    (tmp_path / "a.toml").write_text("[[loop]]\nname = 'A'\n")
    (tmp_path / "m.toml").write_text("reorder_window = 2.0\n")
    pd.DataFrame({"name": ["A"], "kp": [2.0]}).to_parquet(tmp_path / "a.parquet")
    result = check(*(tmp_path / f for f in ("a.csv", "a.toml", "m.toml", "a.parquet")))
    assert result.exit_code == 0
    assert [line.split(": ", 1)[1] for line in result.stdout.splitlines()] == [
        "loop table: 2 loops, 1 with settings; no problem",
        "loop table: 1 loop, 0 with settings; no problem",
        "configuration; no problem",
        "loop table: 1 loop, 1 with settings; no problem",
    ]
