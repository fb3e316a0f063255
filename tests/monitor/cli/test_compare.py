"""``loopsight compare``: what has changed on the terminal, exit 2 with one line for what is no audit."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from monitor.cli.main import loopsight
from tests.monitor.compare.test_run import folder
from tests.monitor.compare.tools import row


def command(*args: object) -> Result:
    return CliRunner().invoke(loopsight, ["compare", *map(str, args)])


def test_it_shows_and_writes(tmp_path: Path) -> None:
    old = folder(tmp_path / "old", [row("LIC-1")], 0.8)
    new = folder(tmp_path / "new", [row("LIC-1", kp=4.0)], 0.3)
    found = command(old, new, "--out", tmp_path / "out")
    assert found.exit_code == 0
    assert "go back to kp = 2, ti = 60 s" in " ".join(found.output.split())
    assert "1 loops in both: 0 better, 1 worse" in found.output
    assert (tmp_path / "out" / "compare.html").is_file()


@pytest.mark.parametrize("which", [0, 1])
def test_what_is_no_audit_is_one_line(tmp_path: Path, which: int) -> None:
    folders = [folder(tmp_path / "old", [row()], 0.8), tmp_path / "none"]
    found = command(*(folders if which else folders[::-1]), "--out", tmp_path / "out")
    assert found.exit_code == 2
    assert found.output.count("\n") == 1
    assert "no loops.parquet, expected the folder of an audit" in found.output
