"""What an audit reads, and what it leaves."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from monitor.audit.inputs import expand, find, found_root, identity
from monitor.audit.run import run_audit
from tests.monitor.audit.tools import about


def test_folder_leaves_out_loop_table_and_results(fleet_data: pd.DataFrame, tmp_path: Path) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    (tmp_path / "loops.csv").write_text("name\nLIC-0\n")
    for _ in range(2):
        result = run_audit([tmp_path], tmp_path / "loops.csv", tmp_path / "out")
        assert [r.loop for r in result.rows] == ["LIC-0"]
        assert [i["name"] for i in about(tmp_path / "out")["inputs"]] == ["d.parquet"]
        assert result.problems == [f"loop LIC-{k}: not in the loop table" for k in range(1, 5)]


def test_paths_are_files_folders_and_globs(tmp_path: Path) -> None:
    for name in ("a/x.csv", "a/b/y.parquet", "a/.hidden/z.csv", "a/note.txt", "c/w.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    problems: list[str] = []
    found = expand([tmp_path / "a", tmp_path / "c" / "*.csv", tmp_path / "a" / "x.csv"], problems)
    assert list(found.values()) == ["a/b/y.parquet", "a/x.csv", "c/w.csv"]
    assert not problems


def test_all_loops_with_defaults_where_no_table_is_given(fleet_data: pd.DataFrame, tmp_path: Path) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    result = run_audit([tmp_path / "d.parquet"], None, tmp_path / "out")
    assert {r.loop for r in result.rows} == {f"LIC-{k}" for k in range(5)}
    assert about(tmp_path / "out")["settings"]["loops"] is None


def test_name_of_ten_thousand_bytes_is_refused_by_name(fleet_data: pd.DataFrame, tmp_path: Path) -> None:
    data = pd.concat([fleet_data, fleet_data.query("loop == 'LIC-0'").assign(loop="n" * 10_000)])
    data.to_parquet(tmp_path / "d.parquet")
    result = run_audit([tmp_path / "d.parquet"], None, tmp_path / "out")
    assert len(result.rows) == 5
    assert [
        p for p in result.problems if p.startswith("loop nnn") and "at most 200 bytes" in p and len(p) < 300
    ]


def test_files_are_named_from_their_common_folder(tmp_path: Path) -> None:
    assert found_root({tmp_path / "a" / "x.csv", tmp_path / "b" / "c" / "y.csv"}) == tmp_path
    assert found_root({tmp_path / "a" / "x.csv"}) == tmp_path / "a"


def test_a_loop_table_that_cannot_be_used_ends_the_search(tmp_path: Path) -> None:
    """Its problems are all that there is to say."""
    (tmp_path / "loops.csv").write_text("name,kp\nLIC-1,zero\n")
    (tmp_path / "d.csv").write_text("loop,time,sp,pv,op\nLIC-1,0,1,1,1\n")
    wrong = find([tmp_path / "d.csv"], tmp_path / "loops.csv", tmp_path / "out")
    assert [p.partition(": ")[2] for p in wrong.problems] == ["kp: 'zero', expected a number"]
    assert not wrong.sources
    missing = find([tmp_path / "d.csv"], tmp_path / "none.csv", tmp_path / "out")
    assert missing.problems == [f"{tmp_path / 'none.csv'}: No such file or directory"]


def test_identity_is_the_file_and_not_its_place(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_bytes(b"the same")
    assert identity(tmp_path / "a", "x") == identity(tmp_path / "b", "x")
    assert identity(tmp_path / "a", "x")["size"] == 8
