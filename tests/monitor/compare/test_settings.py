"""Whether a loop was retuned, by table and by data, and what is said where these contradict each other."""

from __future__ import annotations

import json
import math

import pytest

from monitor.compare.settings import settings_change, way_back
from monitor.contract.changes import KEPT, RETUNED, UNKNOWN
from monitor.contract.records import LoopRow

from .tools import row


def seen(shown: float, share: float = 0.03, **more: object) -> LoopRow:
    """A loop whose controller the data show."""
    ends = {f"{n}_seen{e}": f * v for n, v in (("kp", shown), ("ti", 60.0)) for e, f in
            (("", 1.0), ("_lo", 1.0 - share), ("_hi", 1.0 + share))}  # fmt: skip
    return row(**{**ends, **more})


@pytest.mark.parametrize(
    ("new", "state"),
    [
        ({}, KEPT),
        ({"kp": 2.02}, KEPT),  # rounded when it was typed
        ({"kp": 2.2}, RETUNED),
        ({"kp": -2.0}, RETUNED),
        ({"ti": math.inf}, RETUNED),
        ({"td": 5.0}, RETUNED),
        ({"settings_source": "", "kp": None, "ti": None, "td": None}, UNKNOWN),
    ],
)
def test_by_the_table(new: dict[str, object], state: str) -> None:
    assert settings_change(row(), row(**new)).state == state


def test_what_is_not_there_is_the_same_however_it_is_written() -> None:
    assert settings_change(row(ti=None, td=None), row(ti=math.inf, td=0.0)).state == KEPT


def test_what_has_moved_is_named() -> None:
    assert settings_change(row(), row(kp=3.0)).words == "kp 2 → 3"
    assert settings_change(row(), row(ti=None)).words == "ti 60 → none s"


def test_the_data_count_where_the_table_was_not_brought_up_to_date() -> None:
    found = settings_change(seen(2.0), seen(3.0))
    assert found.state == RETUNED
    assert found.words == "the data show kp 2 → 3; the loop table was not brought up to date"


def test_a_change_of_the_table_alone_is_doubted() -> None:
    found = settings_change(seen(2.0), seen(2.01, kp=3.0))
    assert found.state == KEPT
    assert "were they typed in?" in found.words


def test_by_the_data_alone() -> None:
    unknown = {"settings_source": "data"}
    assert settings_change(seen(2.0, **unknown), seen(2.02, **unknown)).state == KEPT
    assert settings_change(seen(2.0, **unknown), seen(3.0, **unknown)).state == RETUNED
    assert (
        settings_change(seen(2.0, **unknown), seen(3.0, share=0.6, **unknown)).state == KEPT
    )  # too wide to tell


def test_as_suggested() -> None:
    before = row(new_kp=3.0, new_ti=90.0, new_td=0.0)
    assert settings_change(before, row(kp=3.0, ti=88.0)).as_suggested
    assert not settings_change(before, row(kp=3.0, ti=60.0)).as_suggested


def test_the_way_back_is_in_the_fields_of_the_block() -> None:
    assert way_back(row()) == "kp = 2, ti = 60 s"
    assert way_back(row(ti=None)) == "kp = 2, ti = none s"
    fields = json.dumps({"GAIN": 0.75, "RESET": 300.0, "ACTION": "REVERSE", "note": "series or not?"})
    assert way_back(row(fields=fields)) == "GAIN = 0.75, RESET = 300, ACTION = REVERSE"
