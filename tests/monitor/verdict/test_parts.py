"""A suggestion as columns of a row: in the loop's own form, with its block's own fields."""

from __future__ import annotations

import json

import pytest

from monitor.contract.loops import Loop
from tests.support.plants import stepped
from tests.support.runs import run


@pytest.mark.parametrize(
    ("form", "keys"),
    [
        ("standard", {"kp", "ti", "td", "tf"}),
        ("series", {"kp", "ti", "td", "tf"}),
        ("parallel", {"kp", "ki", "kd", "tf"}),
    ],
)
def test_a_suggestion_is_in_the_loops_own_form(form, keys):
    """Fields, stages and the action's words are those of the form; ki and kd only for parallel."""
    engine, _ = run(Loop(name="L", kp=0.4, ti=300.0, form=form), stepped(4000, kp=0.4, ti=300.0, noise=0.02))
    row = engine.row(0)
    assert row.form == form
    assert row.new_kp is not None
    assert row.new_ti is not None
    assert set(json.loads(row.new_fields or "")) == keys
    assert all(set(stage) == keys for stage in json.loads(row.stages or ""))
    assert (row.new_ki is not None) == (form == "parallel")
    if row.new_ki is not None:
        assert row.new_ki == pytest.approx(row.new_kp / row.new_ti)


def test_a_vendor_block_shows_its_own_fields():
    """With a block's id as form, the fields are those of its faceplate, and kp is in engineering units still."""
    from tuners.blocks import BLOCKS  # noqa: PLC0415

    block = next(k for k, b in BLOCKS.items() if b.form == "standard")
    facts = {"pv_low": 0.0, "pv_high": 100.0, "op_low": 0.0, "op_high": 100.0}
    loop = Loop(name="L", kp=0.4, ti=300.0, form=block, **facts)
    assert loop.canonical_form == "standard"
    engine, _ = run(loop, stepped(4000, kp=0.4, ti=300.0, noise=0.02))
    row = engine.row(0)
    assert row.form == block
    assert json.loads(row.new_fields or "{}")
    assert row.new_op_noise is not None
    assert row.new_op_noise_abs == pytest.approx(row.new_op_noise)  # the span is 100
