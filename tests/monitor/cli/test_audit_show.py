"""What an audit shows: the worst loops first, and where the files are."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from tests.monitor.audit.tools import command


def test_command_shows_the_worst_first_and_where_the_files_are(
    fleet_data: pd.DataFrame, table: Path, tmp_path: Path
) -> None:
    fleet_data.to_parquet(tmp_path / "d.parquet")
    result = command(tmp_path / "d.parquet", "--loops", table, "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert result.stderr == ""
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["verdict", "loop", "CI", "Ms", "why", "new", "settings"]
    assert "5 loops, 10 events, 4500 of 4500 samples used" in lines[-2]
    assert lines[-1].endswith("out/: report.html, loops.csv, loops.xlsx, audit.json, 5 .parquet")
    assert max(map(len, lines)) <= 140
