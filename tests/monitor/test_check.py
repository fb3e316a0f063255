"""Every problem at once, with file, line, field, value and what would be accepted."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from tests.monitor.cli.check_tools import GOOD, check
from tests.support.places import SHARED

DATA = SHARED / "data"


def test_good_data_say_what_they_are(file: Path) -> None:
    file.write_text(GOOD)
    result = check(file)
    assert result.exit_code == 0
    assert result.stdout == (
        f"{file}: long, 1 loop, 20 rows, 0 s to 190 s, period 10 s, in order, quality unknown; no problem\n"
    )
    assert not result.stderr


@pytest.mark.parametrize("layout", ["long", "per loop", "wide"])
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_layouts_and_zones(tmp_path: Path, layout: str, suffix: str) -> None:
    times = pd.date_range("2026-03-01", periods=30, freq="5s")
    data = pd.DataFrame({"time": times, "sp": 1.0, "pv": 2.0, "op": 3.0})
    if layout == "long":
        data.insert(0, "loop", "A")
    if layout == "wide":
        data = data.rename(columns=lambda c: c if c == "time" else f"A.{c}")
    path = tmp_path / f"A{suffix}"
    if suffix == ".csv":
        data[::-1].to_csv(path, index=False)
    else:
        data[::-1].to_parquet(path)
    result = check(path, "--tz", "Europe/Berlin")
    assert result.exit_code == 0
    expected = "1 loop, 30 rows, 2026-02-28T23:00:00.000Z to 2026-02-28T23:02:25.000Z, period 5 s"
    assert f"{layout}, {expected}" in result.stdout
    assert "times without zone, read as Europe/Berlin" in result.stdout
    assert "out of order (will be sorted)" in check(path).stdout


def test_each_problem_of_a_data_file_by_line(file: Path) -> None:
    lines = GOOD.splitlines()
    lines[3] = "LIC-1,20,50,Bad Input,40"
    lines[5] = "LIC-1,40,50,51"
    lines[7] = "LIC-1,soon,50,51,40"
    lines[9] = "LIC-1,80,,51,4O"
    file.write_text("\n".join(lines))
    result = check(file)
    assert result.exit_code == 2
    assert result.stderr.splitlines() == [
        f"{file}:6: 4 cells, expected 5",
        f"{file}:4: pv: 'Bad Input', expected a number",
        f"{file}:8: time: 'soon', expected a time, e.g. 2026-11-22T10:00:00Z",
        f"{file}:10: sp: '', expected a number",
        f"{file}:10: op: '4O', expected a number",
    ]
    assert "5 problems" in result.stdout


def test_long_lists_are_counted(file: Path) -> None:
    file.write_text(GOOD + "".join(f"LIC-1,{k},x,x,x\n" for k in range(1000, 1100)))
    lines = check(file).stderr.splitlines()
    assert len(lines) < 60
    assert "249 more cells that cannot be read" in lines[-1]


def test_text_in_parquet_is_named(tmp_path: Path) -> None:
    path = tmp_path / "d.parquet"
    pd.DataFrame(
        {"loop": "A", "time": range(30), "sp": 1.0, "pv": ["No Data"] * 2 + ["3"] * 28, "op": 2.0}
    ).to_parquet(path)
    result = check(path)
    assert result.exit_code == 2
    assert result.stderr == f"{path}: 'No Data' in 2 cells, expected numbers\n"


def test_a_rule_that_will_not_be_used_is_named(tmp_path: Path) -> None:
    """What the table alone tells: a structure, or a given kind of process, that the rule is not for."""
    rows = ["A,1,20,imc-pi,", "B,1,20,amigo,", "C,1,20,imc-pi,self-regulating", "D,1,20,,integrating"]
    path = tmp_path / "loops.csv"
    path.write_text("\n".join(["name,kp,ti,rule,process", *rows]))
    result = check(path)
    assert result.exit_code == 2
    assert result.stderr.splitlines() == [
        f"{path}: loop B: rule: 'amigo' is not used: it is for PID, this loop is a PI",
        f"{path}: loop C: rule: 'imc-pi' is not used: it is for integrating processes, this one is self-regulating",
    ]
    assert "loop table: 4 loops, 4 with settings; 2 problems" in result.stdout


@pytest.mark.skipif(not DATA.is_dir(), reason="the shared data sets are not beside this repository")
def test_shared_data_have_no_problem() -> None:
    files = [p for p in DATA.glob("*/*") if p.suffix in {".csv", ".parquet"} and p.name != "labels.csv"]
    result = check(*files)
    assert (result.exit_code, result.stderr) == (0, "")
    assert sum(line.endswith("; no problem") for line in result.stdout.splitlines()) == len(files)


def test_a_configuration_of_zenohs_own(tmp_path: Path) -> None:
    """By itself, and where a monitor's configuration names it: the file and the place."""
    secure, own = tmp_path / "z.json5", tmp_path / "monitor.toml"
    own.write_text('zenoh = "z.json5"\n')
    assert "z.json5: No such file" in check(own).stderr
    secure.write_text("{ mod: 1 }")
    for path in (secure, own):
        result = check(path)
        assert result.exit_code == 2
        assert result.stderr.startswith(f"{secure}: line 1: unknown field `mod`")
    secure.write_text("{ metadata: {} }")
    for path in (secure, own):
        assert check(path).exit_code == 0
