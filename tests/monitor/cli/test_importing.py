"""``loopsight import``."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner

from monitor.cli.importing import import_exports
from tests.support.export_families import AMBIGUOUS, ZONE, base, timed


def test_from_the_export_to_the_files(tmp_path: Path) -> None:
    """What the data leave open is asked for in one line; with the answer it is read."""
    path = timed("%d/%m/%Y %H:%M:%S")(base(start=AMBIGUOUS), tmp_path)
    command = ["--tz", ZONE, "--out", str(tmp_path / "plant"), str(path)]
    asked = CliRunner().invoke(import_exports, command)
    assert asked.exit_code == 2
    assert "--time-format" in asked.stderr
    assert len(asked.stderr.splitlines()) == 1
    done = CliRunner().invoke(import_exports, ["--time-format", "%d/%m/%Y", *command])
    assert done.exit_code == 0
    assert "mapping.toml, loops.csv" in done.stdout
    again = CliRunner().invoke(import_exports, ["--map", str(tmp_path / "plant" / "mapping.toml"), *command])
    assert again.exit_code == 0


def test_a_wrong_option_is_one_line(tmp_path: Path) -> None:
    wrong = CliRunner().invoke(import_exports, ["x.csv", "--out", str(tmp_path), "--tz", "Moon"])
    assert wrong.exit_code == 2
    assert wrong.output.count("\n") == 1
