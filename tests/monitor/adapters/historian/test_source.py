"""A file that can be read, and how."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from monitor.adapters.historian.layout import layout_of
from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.source import headings_of
from tests.monitor.adapters.historian.tools import frame, wide, write


def test_a_row_is_named_as_a_user_finds_it(tmp_path: Path) -> None:
    """By its line in a CSV file, whose first is the headings; by its running number elsewhere."""
    csv = inspect(write(frame(), tmp_path / "a.csv"))
    parquet = inspect(write(frame(), tmp_path / "a.parquet"))
    assert (csv.line(0), parquet.line(0)) == (2, 1)
    assert (csv.rows, parquet.rows) == (None, len(frame()))


def test_decimal_commas_occur_only_where_commas_do_not_separate(tmp_path: Path) -> None:
    source = inspect(write(frame(), tmp_path / "a.csv"))
    assert not source.comma
    assert replace(source, delimiter=";").comma
    assert not replace(source, delimiter=";", format="parquet").comma


def test_only_the_headings_of_wanted_loops_are_read() -> None:
    """Of a wide file; a long one has them all."""
    headings = list(wide(frame()).columns)
    layout = layout_of(headings, Path("a.csv"), ())
    names = sorted(layout.columns)
    assert sorted(headings_of(layout, None)) == sorted(headings)
    some = headings_of(layout, names[:1])
    assert some[0] == layout.time
    assert len(some) > 1
    assert all(h == layout.time or h.startswith(names[0]) for h in some)
    long = layout_of(list(frame().columns), Path("a.csv"), ())
    assert sorted(headings_of(long, names[:1])) == sorted(frame().columns)
