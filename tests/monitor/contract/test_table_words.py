"""Columns of a loop table that are none."""

from __future__ import annotations

import pytest

from monitor.contract.loop_fields import TABLE_COLUMNS
from monitor.contract.table_words import is_mistaken, unknown_column


@pytest.mark.parametrize(
    ("column", "meant"),
    [
        ("gain", "kp"),
        ("Reset", "ti"),
        ("rate", "td"),
        ("op_hi", "op_high"),
        ("PV_Min", "pv_low"),
        ("tag", "name"),
        ("closed_loop_tim", "closed_loop_time"),
        ("KP", "kp"),
        ("units", "unit"),
        ("PB", "kp = 100/PB"),
    ],
)
def test_the_nearest_known_one_is_named(column: str, meant: str) -> None:
    said = unknown_column(column, ["1"])
    assert said.startswith(f"{column}: do you mean {meant}")
    assert is_mistaken(said)


def test_minutes_are_named() -> None:
    assert "'minutes': ti and td are in seconds" in unknown_column("units", ["minutes"])


def test_known_columns_and_remarks_are_let_pass() -> None:
    assert not any(map(unknown_column, (*TABLE_COLUMNS, "#note", "")))
    assert not is_mistaken(unknown_column("commissioned by"))
