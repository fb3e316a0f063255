"""``loopsight report``: one line for what is wrong, and where the page is."""

from __future__ import annotations

from pathlib import Path

from tests.monitor.audit.tools import command, step_test

from .tools import run


def test_a_report_is_drawn_again(tmp_path: Path) -> None:
    step_test("LIC-1").to_parquet(tmp_path / "data.parquet")
    assert command(tmp_path / "data.parquet", "--out", tmp_path / "out").exit_code == 0
    (tmp_path / "out" / "report.html").unlink()
    result = run("report", str(tmp_path / "out"))
    assert (result.returncode, result.stderr) == (0, "")
    assert str(tmp_path / "out" / "report.html") in result.stdout
    assert (tmp_path / "out" / "report.html").stat().st_size > 50_000


def test_no_audit_there_is_one_line_and_exit_2(tmp_path: Path) -> None:
    result = run("report", str(tmp_path))
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "no loops.parquet" in result.stderr
