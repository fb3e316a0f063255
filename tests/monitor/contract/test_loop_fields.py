"""A row of the loop table: what it may hold, and every problem by its field."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop


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
