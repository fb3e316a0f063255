"""The command `loopsight audit`: what it shows, and what it refuses in one line."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from monitor.adapters.rerun_view import series
from tests.monitor.audit.tools import command, step_test
from tests.monitor.cli.tools import run
from tests.support.recordings import read, texts


@pytest.mark.parametrize(
    ("files", "args", "says"),
    [
        ({}, ["none.csv"], "none.csv: no such file"),
        ({"d.csv": "a,b\n1,2\n"}, ["d.csv"], "d.csv: columns a, b, expected"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"}, ["d.csv", "--loops", "t.csv"], "no loop of the table"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,a,b,c\n"}, ["d.csv"], "no good sample in 1 rows: 1 bad_value"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"}, ["d.csv", "--loops", "n.csv"], "n.csv: No such file"),
        ({"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"}, ["d.csv", "--tz", "Mars"], "--tz: 'Mars', expected"),
        (
            {"d.csv": "loop,time,sp,pv,op\nX,1,2,3,4\n"},
            ["d.csv", "--since", "noon"],
            "--since: 'noon', expected",
        ),
        ({"d.csv": "loop,time,sp,pv,op\nX,45000,2,3,4\n"}, ["d.csv"], "--time-unit"),
    ],
)
def test_nothing_usable_is_exit_2_and_one_line_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, files: dict[str, str], args: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.csv").write_text("name\nLIC-1\n")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    result = command(*args, "--out", "out")
    assert result.exit_code == 2
    assert says in result.stderr
    assert "Traceback" not in result.output
    assert not result.stdout
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.skipif(find_spec("distributed") is not None, reason="dask.distributed is installed here")
def test_scheduler_without_its_library_names_the_extra(table: Path, tmp_path: Path) -> None:
    step_test("LIC-1").to_csv(tmp_path / "d.csv", index=False)
    result = command(
        tmp_path / "d.csv", "--loops", table, "--out", tmp_path / "out", "--scheduler", "tcp://x:1"
    )
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "loopsight[cluster]" in result.stderr


def test_bad_loop_table_names_each_problem(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("name,ti\nA,-1\nA,2\nB,x\n")
    result = command(tmp_path / "t.csv", "--loops", tmp_path / "t.csv", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 2
    assert "t.csv:2: ti: '-1', expected seconds above 0" in result.stderr


def test_help_and_import_are_light() -> None:
    heavy = {"numpy", "pyarrow", "numba", "rich"}
    code = f"import sys, monitor.cli.audit, monitor.cli.check; print(len({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0"
    assert "Example:\n    loopsight audit " in command("--help").stdout


def test_the_recording_is_written_where_it_is_asked_for(tmp_path: Path) -> None:
    """Beside the tables; it is what `loopsight view` shows of them."""
    step_test("LIC-1").to_parquet(tmp_path / "d.parquet")
    (tmp_path / "t.csv").write_text("name,process,kp,ti,unit,op_unit\nLIC-1,integrating,8,40,bar,%\n")
    done = command(tmp_path / "d.parquet", "--loops", tmp_path / "t.csv", "--out", tmp_path / "out", "--rrd")
    assert done.exit_code == 0, done.output
    assert "audit.rrd" in done.stdout
    (page,) = texts(tmp_path / "out" / "audit.rrd", f"/{series.entity('LIC-1')}/page")
    assert "Kp [%/bar]" in page.replace("\\", "")
    seen = run("view", str(tmp_path / "out"), "--view", "none", "--save", str(tmp_path / "seen.rrd"))
    assert (seen.returncode, seen.stdout) == (0, "view none\n"), seen.stderr
    recorded, shown = (read(path) for path in (tmp_path / "out" / "audit.rrd", tmp_path / "seen.rrd"))
    assert recorded.keys() == shown.keys()
    for path, (times, values) in recorded.items():
        np.testing.assert_array_equal(times, shown[path][0])
        np.testing.assert_array_equal(values, shown[path][1])
