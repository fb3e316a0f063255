"""The documented layout first, what is in the file second."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pytest

from monitor.adapters.historian.mapping import ExportMapping
from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.recognised import different_rows, texts_of
from monitor.adapters.historian.rows import UnusableError

PLAIN = "time,A.SP,A.PV,A.OP{}\n2026-03-14T08:00:00,1,2,3{}\n2026-03-14T08:00:05,1,2,3{}\n"


def made(tmp_path: Path, heading: str = "", cell: str = "") -> Path:
    path = tmp_path / "d.csv"
    path.write_text(PLAIN.format(heading, cell, cell))
    return path


def test_a_documented_file_is_read_as_ever(tmp_path: Path) -> None:
    source = inspect(made(tmp_path))
    assert (source.recognised, source.layout.unused) == (False, ())


def test_a_mode_beside_it_is_used_and_another_column_is_named(tmp_path: Path) -> None:
    assert inspect(made(tmp_path, ",A.MODE", ",MAN")).layout.columns["A"]["auto"] == "A.MODE"
    other = inspect(made(tmp_path, ",ambient", ",20"))
    assert (other.recognised, other.layout.unused) == (False, ("ambient",))


@pytest.mark.parametrize(("heading", "cell"), [(",A.MODE", ",16"), (",A.MAN", ",1"), (",A.MODE", ",LOKAL1")])
def test_a_mode_that_nobody_understands_is_not_passed_over(tmp_path: Path, heading: str, cell: str) -> None:
    with pytest.raises(UnusableError, match="--map"):
        inspect(made(tmp_path, heading, cell))


def test_the_user_says_what_a_mode_means(tmp_path: Path) -> None:
    source = inspect(made(tmp_path, ",A.MODE", ",16"), given=ExportMapping(modes={"16": 0}))
    assert source.modes == (("16", 0),)


def test_names_behind_a_server_are_the_tags(tmp_path: Path) -> None:
    path = tmp_path / "d.csv"
    path.write_text(PLAIN.format("", "", "").replace("A.", "SITE1:LIC-7."))
    assert inspect(path).loops == ["LIC-7"]


def test_different_rows_are_each_named_once() -> None:
    batch = pa.RecordBatch.from_pydict({"a": ["x", "y", "x", None], "b": ["1", "2", "1", "3"]})
    assert sorted(different_rows([batch, batch], ("a", "b"))) == [("x", "1"), ("y", "2")]
    assert different_rows([batch], ("a",)) == [("x",), ("y",)]


def test_kinds_by_type_and_by_text() -> None:
    batch = pa.RecordBatch.from_pydict({"t": pa.array([0], pa.timestamp("s")), "v": [1.5], "s": ["1.5"]})
    assert texts_of(batch)[1] == {"t": "time", "v": "number", "s": "number"}
