"""Cells by their text."""

from __future__ import annotations

import pytest

from monitor.adapters.historian.cell_kinds import column_kind, decimal_comma, kind_of, stands_for_value


@pytest.mark.parametrize(
    ("cell", "kind"),
    [
        ("48.8", "number"),
        ("-1,5e3", "number"),
        ("20260302", "time"),
        ("02.03.2026", "time"),
        ("08:00", "clock"),
        ("8:00:01 PM", "clock"),
        ("degC", "word"),
        ("  ", "empty"),
        ("1795564800000", "number"),
        ("NaN", "word"),
    ],
)
def test_kinds(cell: str, kind: str) -> None:
    assert kind_of(cell) == kind


def test_words_that_stand_for_values() -> None:
    assert all(map(stands_for_value, ("Bad Input", "NaN", "MAN", "1.5")))
    assert not stands_for_value("LIC-101.PV")


def test_a_column_is_what_most_of_it_is() -> None:
    assert column_kind(["Bad", "1", "2", ""]) == "number"
    assert column_kind(["", ""]) == "empty"


@pytest.mark.parametrize(
    ("cells", "comma"),
    [
        (["48,8"], True),
        (["48.8"], False),
        (["1,234"], None),
        (["1.234,5"], True),
        (["1,234.5"], False),
        (["5"], None),
    ],
)
def test_the_decimal_sign(cells: list[str], comma: bool | None) -> None:
    assert decimal_comma(cells) is comma
