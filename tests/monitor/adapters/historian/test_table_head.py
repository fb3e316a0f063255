"""Where a table begins."""

from __future__ import annotations

import csv

import pytest

from monitor.adapters.historian.table_head import HeadHints, comma_of, separator_of, table_head

DATA = ["2026-03-14 08:00:00,1.5,2.5", "2026-03-14 08:00:05,1.6,2.5"]


def rows(lines: list[str], separator: str = ",") -> list[list[str]]:
    return [next(csv.reader([line], delimiter=separator), []) for line in lines]


@pytest.mark.parametrize(
    ("above", "header", "data"),
    [
        (["Time,A.SP,A.PV"], 0, 1),
        (["Report", "Start:,2026-03-14 07:00:00,End:", "", "Time,A.SP,A.PV"], 3, 4),
        (["Time,A.SP,A.PV", ",%,%"], 0, 2),
        (["Title", "Time,A.SP,A.PV", "time,set point,level", ",%,%"], 1, 4),
        ([], -1, 0),
    ],
)
def test_headings_among_titles_and_units(above: list[str], header: int, data: int) -> None:
    head = table_head(rows([*above, *DATA]))
    assert (head.header, head.data) == (header, data)
    assert head.headings == (
        ("Time", "A.SP", "A.PV") if header >= 0 else ("column 1", "column 2", "column 3")
    )
    assert head.kinds[head.headings[1]] == "number"


def test_two_rows_of_headings_are_joined() -> None:
    head = table_head(rows([",LIC-1,,,LIC-2,,", "Time,SP,PV,OP,SP,PV,OP", "2026-03-14 08:00,1,2,3,4,5,6"]))
    assert head.headings[1:] == ("LIC-1.SP", "LIC-1.PV", "LIC-1.OP", "LIC-2.SP", "LIC-2.PV", "LIC-2.OP")


def test_the_user_may_say_where_it_begins() -> None:
    assert table_head(rows(["x", "Time,A.SP,A.PV", *DATA]), HeadHints(header=1, data=3)).cells[1] == ("1.6",)


def test_nothing_in_it() -> None:
    with pytest.raises(ValueError, match="no rows"):
        table_head([[], [""]])


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
def test_the_separator_is_told_by_the_cells(separator: str) -> None:
    lines = ["Time;A.SP;A.PV", "14.03.2026 08:00;48.8;1.5", "14.03.2026 08:01;48.9;1.5"]
    lines = [line.replace(";", separator) for line in lines]
    assert separator_of(lines) == separator
    assert not comma_of(table_head(rows(lines, separator)), separator)


def test_a_decimal_comma_between_semicolons() -> None:
    lines = ["Zeit;A.SP;A.PV", "14.03.2026 08:00;48,8;1,5", "14.03.2026 08:01;48,9;1,5"]
    assert separator_of(lines) == ";"
    assert comma_of(table_head(rows(lines, ";")), ";")
