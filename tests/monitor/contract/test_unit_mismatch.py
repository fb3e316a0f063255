"""SP and PV in different units."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.unit_mismatch import lasts, unit_mismatch

PV = 50 + np.sin(np.arange(100.0))


@pytest.mark.parametrize("ranges", [{}, {"pv_low": 0.0, "pv_high": 100.0}])
def test_a_set_point_in_millimetres_is_named(ranges: dict[str, float]) -> None:
    said = unit_mismatch(Loop(name="A", **ranges), np.full(100, 1500.0), PV)
    assert said.startswith("SP is 1500 where PV is 50")
    assert "other units" in said


@pytest.mark.parametrize("sp", [50.0, 60.0, 20.0, np.nan, 0.0])
def test_an_error_is_none(sp: float) -> None:
    for ranges in ({}, {"pv_low": 0.0, "pv_high": 100.0}):
        assert not unit_mismatch(Loop(name="A", **ranges), np.full(100, sp), PV)


def test_a_pv_far_off_that_wanders_is_none_and_few_samples_tell_nothing() -> None:
    assert not unit_mismatch(Loop(name="A"), np.full(100, 500.0), np.linspace(1, 400, 100))
    assert not unit_mismatch(Loop(name="A"), np.full(5, 1500.0), PV[:5])


def test_a_unit_stays_and_a_pump_starts() -> None:
    """The error of the first samples is that of the whole record, or is gone; not known is no."""
    sp = np.append(np.full(99, 1500.0), np.nan)
    assert lasts(-1450.0, sp, PV)
    assert not lasts(2.0, sp, PV)
    assert not lasts(None, sp, PV)
