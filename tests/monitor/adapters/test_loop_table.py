"""Loop tables as files."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from monitor.adapters.loop_table import read_loop_table
from monitor.contract.loops import LoopTableError


def test_files(tmp_path):
    """CSV (with BOM, semicolons, decimal commas, spaces in the header), TOML and Parquet read alike."""
    comma = tmp_path / "a.csv"
    comma.write_text("name, kp ,ti\nL1,1.5,20\nL2,,inf\n", encoding="utf-8-sig")
    semicolon = tmp_path / "b.csv"
    semicolon.write_text("name;kp;ti\r\nL1;1,5;20\r\nL2;;\r\n", encoding="utf-8")
    toml = tmp_path / "c.toml"
    toml.write_text('[[loop]]\nname = "L1"\nkp = 1.5\nti = 20\n[[loop]]\nname = "L2"\n')
    parquet = tmp_path / "d.parquet"
    pd.DataFrame({"name": ["L1", "L2"], "kp": [1.5, None], "ti": [20.0, None]}).to_parquet(parquet)
    tables = [list(read_loop_table(p)) for p in (comma, semicolon, toml, parquet)]
    assert all(t == tables[0] for t in tables)
    assert (tables[0][0].kp, tables[0][0].ti, tables[0][1].kp) == (1.5, 20.0, None)


def test_every_problem_of_a_file_is_named_with_its_line(tmp_path):
    """``file:line: field: value, expected ...`` for each, duplicates of a name included."""
    path = tmp_path / "loops.csv"
    path.write_text("name,ti,form\nA,10,standard\nB,-3,standard\nA,5,standard\nC,1,odd\n")
    with pytest.raises(LoopTableError) as caught:
        read_loop_table(path)
    assert [p.split(": ")[0] for p in caught.value.problems] == [f"{path}:{n}" for n in (3, 4, 5)]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", ""),
        ("a.csv", "tag,kp\nL,1\n"),
        ("a.csv", "name,kp\n"),
        ("a.toml", "[[loop]\n"),
        ("a.toml", "loop = 3\n"),
        ("a.toml", ""),
        ("a.parquet", "no parquet"),
    ],
)
def test_a_file_that_is_no_table_is_one_clear_error(tmp_path, name, text):
    """LoopTableError with the path in it, nothing else, whatever the bytes."""
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(LoopTableError, match=re.escape(str(path))):
        read_loop_table(path)
