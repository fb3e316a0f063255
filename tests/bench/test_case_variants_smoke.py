"""The variants of cases: each can be drawn again, is what its case is, and its claims can be broken."""

from __future__ import annotations

import io
import math

import numpy as np
import pandas as pd
import pytest

from monitor.contract.records import GOOD, LoopRow
from tests.support.case_records import deltav_rows, narrow_rows
from tests.support.case_variants import HARMFUL_MS, draw, faults, makers

SEED = 4
CASES = sorted(makers())
LOOPS = {
    "evaporator-cycle": ["EVAP-cycle", "EVAP-tiwrong", "EVAP-step"],
    "fryer-level-cycle": ["FRYER-cycle", "FRYER-step"],
    "no-response": ["AIC-1", "PIC-2"],
    "split-range": ["SPLIT", "SPLIT-heat"],
    "sign-or-output-inverted": ["SIGN-typed", "OP-inverted"],
    "output-logged-as-fraction": ["OP-fraction", "OP-8bit"],
    "error-squared-and-gap": ["LIC-err2", "LIC-gap"],
    "proportional-on-measurement": ["PONM-asPID", "PONM-told"],
}
"""Loops of the cases that have several, as in their folders."""


def test_all_twenty_cases_have_a_maker() -> None:
    assert len(CASES) == 20


@pytest.mark.parametrize("case", CASES)
def test_a_variant_is_drawn_again_and_differs_by_seed(case: str) -> None:
    variants, again, other = draw(case, SEED), draw(case, SEED), draw(case, SEED + 1)
    assert [v.loop.name for v in variants] == LOOPS.get(case, [variants[0].loop.name])
    for one, same, differs in zip(variants, again, other, strict=True):
        np.testing.assert_array_equal(one.samples.pv, same.samples.pv)
        assert one.law == same.law
        assert one.law != differs.law or one.plant.slope != differs.plant.slope
        assert np.isfinite(one.samples.pv).all()
        assert (np.diff(one.samples.time) > 0).all()
        assert 600 < len(one.samples) < 9000
        assert math.isfinite(one.ms(one.law))  # none swings ever more


@pytest.mark.parametrize("case", CASES)
def test_claims_are_broken_by_a_row_that_harms(case: str) -> None:
    """The valve blamed, all called good, and fifty times the gain to type in."""
    for variant in draw(case, SEED):
        kp = 50.0 * variant.law.kp
        row = LoopRow(
            loop="x", verdict=GOOD, flags=("stiction",), new_kp=kp, new_ti=variant.law.ti, gain=-1.0
        )
        assert len(faults(variant, row)) >= 2


def test_suggestions_are_judged_on_the_true_loop() -> None:
    (drum,) = draw("horizontal-drum", SEED)
    safe = LoopRow(loop="x", new_kp=drum.law.kp, new_ti=drum.law.ti)
    middle = 1.0 / (2 * drum.plant.slope * drum.plant.theta)
    bold = LoopRow(loop="x", new_kp=2.0 * middle, new_ti=8 * drum.plant.theta)
    assert not any("Ms" in words for words in faults(drum, safe))
    assert any(f"above {HARMFUL_MS:g}" in words for words in faults(drum, bold))


def test_exports_hold_the_same_samples() -> None:
    (variant,) = draw("narrow-export", SEED)
    long = pd.read_csv(io.StringIO(narrow_rows(variant))).pivot_table("value", "timestamp", "tag")
    wide = pd.read_csv(io.StringIO(deltav_rows(variant)))
    np.testing.assert_array_equal(long["LIC-1.PV"], variant.samples.pv)
    np.testing.assert_array_equal(wide["LIC-1/OUT.CV"], variant.samples.op)
