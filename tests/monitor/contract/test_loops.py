"""The loop table: what is accepted, what is refused in which words, defaults, names as data."""

from __future__ import annotations

import math
import re

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.adapters.loop_table import read_loop_table
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable, LoopTableError, default_key


def test_only_the_name_is_required():
    """All else has its documented default."""
    loop, wrong = parse_row({"name": "LIC-101"})
    assert wrong == []
    assert loop == Loop(name="LIC-101")
    assert (loop.process, loop.objective, loop.form, loop.ci_min, loop.ms_max) == (
        "auto", "both", "standard", 0.6, 2.2,
    )  # fmt: skip
    assert loop.structure == "pi"
    assert math.isinf(loop.ti)


WRONG = [
    ({"name": ""}, "name"),
    ({"name": "x" * 201}, "name"),
    ({"name": "L", "kp": "abc"}, "kp"),
    ({"name": "L", "kp": 0}, "kp"),
    ({"name": "L", "kp": math.inf}, "kp"),
    ({"name": "L", "ti": -1}, "ti"),
    ({"name": "L", "ti": 0}, "ti"),
    ({"name": "L", "td": -0.1}, "td"),
    ({"name": "L", "td": math.inf}, "td"),
    ({"name": "L", "process": "fast"}, "process"),
    ({"name": "L", "objective": "all"}, "objective"),
    ({"name": "L", "controller": "i"}, "controller"),
    ({"name": "L", "rule": "guess"}, "rule"),
    ({"name": "L", "form": "ideal"}, "form"),
    ({"name": "L", "allow_pd": "perhaps"}, "allow_pd"),
    ({"name": "L", "ms_max": 0.9}, "ms_max"),
    ({"name": "L", "ci_min": 0}, "ci_min"),
    ({"name": "L", "period": 0}, "period"),
    ({"name": "L", "key": "a/*/b"}, "key"),
    ({"name": "L", "key": "a//b"}, "key"),
    ({"name": "L", "key": "plant/L/settings"}, "key"),
    ({"name": "L", "pv_low": 5, "pv_high": 5}, "pv_high"),
    ({"name": "L", "op_low": 100, "op_high": 0}, "op_high"),
    ({"name": "L", "ki": 0.1, "kp": 1}, "ki"),
    ({"name": "L", "form": "parallel", "ki": 0.1}, "kp"),
    ({"name": "L", "form": "parallel", "kp": 1, "ki": -0.1}, "ki"),
    ({"name": "L", "form": "parallel", "kp": -1, "ki": -0.1, "kd": 0.1}, "kd"),
]


@pytest.mark.parametrize(("row", "field"), WRONG, ids=[f"{f} {n}" for n, (_, f) in enumerate(WRONG)])
def test_what_is_wrong_is_named(row, field):
    """No loop, and one line that names the field and what would be accepted."""
    loop, wrong = parse_row(row)
    assert loop is None
    assert len(wrong) == 1
    assert wrong[0].startswith(field)
    assert "expected" in wrong[0]


def test_all_that_is_wrong_is_named_at_once():
    """Three mistakes, three lines."""
    _, wrong = parse_row({"name": "L", "ti": -1, "form": "x", "kp": 0})
    assert len(wrong) == 3


@pytest.mark.parametrize("empty", [None, "", "  ", math.nan])
def test_an_empty_cell_is_the_default(empty):
    """Empty text, NaN and None alike."""
    loop, wrong = parse_row({"name": "L", "ti": empty, "kp": empty, "form": empty, "allow_pd": empty})
    assert wrong == []
    assert loop == Loop(name="L")


def test_parallel_settings():
    """``ti = kp/ki``, ``td = kd/kp``; a widely copied ``ti = 1/ki`` is wrong. Signs go along."""
    loop, wrong = parse_row({"name": "L", "form": "parallel", "kp": "-2", "ki": "-0.1", "kd": "-6"})
    assert wrong == []
    assert loop is not None
    assert (loop.kp, loop.ti, loop.td) == (-2.0, 20.0, 3.0)
    no_integral, _ = parse_row({"name": "L", "form": "parallel", "kp": 2, "ki": 0, "kd": 0})
    assert no_integral is not None
    assert math.isinf(no_integral.ti)
    assert no_integral.structure == "p"


def test_vendor_blocks_are_forms_where_they_are_known():
    """A block's id is accepted in a table, not an unknown one."""
    loop, _ = parse_row({"name": "L", "form": "vendor-x"}, ("standard", "vendor-x"))
    assert loop is not None
    assert parse_row({"name": "L", "form": "vendor-y"}, ("standard", "vendor-x"))[0] is None


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


@settings(max_examples=100)
@given(
    row=st.dictionaries(
        st.sampled_from([*Loop.__struct_fields__, "ki", "kd", "unknown"]),
        st.one_of(
            st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.lists(st.integers())
        ),
    )
)
def test_any_row_is_a_loop_or_a_list_of_problems(row):
    """Never an exception, never both."""
    loop, wrong = parse_row(row)
    assert (loop is None) == bool(wrong)
