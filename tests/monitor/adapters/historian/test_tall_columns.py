"""The columns of a tall export."""

from __future__ import annotations

import pytest

from monitor.adapters.historian.tall_columns import tag_columns, tag_name, value_and_quality
from tests.monitor.adapters.historian.test_recognise import TWO, look

TAGS = ["A.PV", "A.SP"]


def test_the_tag_is_one_column_or_two() -> None:
    assert tag_columns(look({"name": TAGS, "v": TWO}), ["name", "v"]) == ("name",)
    two = {"asset": ["A", "A"], "variable": ["sp", "pv"], "v": TWO}
    assert tag_columns(look(two), list(two)) == ("asset", "variable")
    assert tag_columns(look({"x": ["a", "b"], "v": TWO}), ["x", "v"]) == ()
    assert tag_name([" A ", "pv"]) == "A.pv"


def test_the_value_by_its_heading_or_as_the_only_number() -> None:
    three = {"Value": TWO, "OPCQuality": TWO, "Quality": TWO}
    assert value_and_quality(look(three), list(three)) == ("Value", "OPCQuality")
    assert value_and_quality(look({"x": TWO}), ["x"]) == ("x", "")
    with pytest.raises(ValueError, match="x and y may be the values"):
        value_and_quality(look({"x": TWO, "y": TWO}), ["x", "y"])
