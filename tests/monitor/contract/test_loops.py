"""The loop table: what is accepted, what is refused in which words, defaults, names as data."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loops import Loop, LoopTable, default_key


@pytest.mark.parametrize(
    ("facts", "structure", "filter_time"),
    [
        ({"kp": 1.0}, "p", 0.0),
        ({"kp": 1.0, "ti": 9.0}, "pi", 0.0),
        ({"kp": 1.0, "ti": 9.0, "tf": 3.0}, "pi", 0.0),
        ({"kp": 1.0, "ti": 9.0, "td": 2.0}, "pid", 0.2),
        ({"kp": 1.0, "ti": 9.0, "td": 2.0, "tf": 0.0}, "pid", 0.0),
        ({"kp": 1.0, "td": 2.0, "tf": 0.5}, "pd", 0.5),
    ],
)
def test_structure_and_filter(facts, structure, filter_time):
    """The structure is that of the settings; tf is td/10 unless given, and nothing without td."""
    loop = Loop(name="L", **facts)
    assert loop.structure == structure
    assert loop.filter_time == pytest.approx(filter_time)


def test_the_table_finds_and_refuses():
    """By row, name and key; a second loop of a name or key is refused and leaves no trace."""
    table = LoopTable([Loop(name="A"), Loop(name="B", key="x/y")])
    assert (table.by_name["B"], table.by_key["x/y"], table.by_key["plant/A"]) == (1, 1, 0)
    for taken in (Loop(name="A", key="new"), Loop(name="C", key="x/y")):
        with pytest.raises(ValueError, match="taken"):
            table.add(taken)
    assert len(table) == 2
    assert table.add(Loop(name="C")) == 2
    table.replace(0, Loop(name="other", key="other", kp=3.0))
    assert (table[0].name, table[0].key, table[0].kp) == ("A", "plant/A", 3.0)


@settings(max_examples=200)
@given(name=st.text(min_size=1, max_size=40))
def test_a_default_key_is_one_chunk_of_a_valid_key(name):
    """Whatever the name: one chunk below ``plant``, no wildcard, no control character, and names stay apart."""
    key = default_key(name)
    chunk = key.removeprefix("plant/")
    assert not re.search(r"[/*$?#\x00-\x1f\x7f]", chunk)
    assert not chunk.startswith("@")
    back = re.sub(r"(?:%[0-9A-F]{2})+", lambda m: bytes.fromhex(m.group().replace("%", "")).decode(), chunk)
    assert back == name
