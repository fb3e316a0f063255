"""Paths and looks of what is drawn of a loop."""

from __future__ import annotations

from monitor.adapters.rerun_view import series
from monitor.contract.evidence import Scale


def names(look: object) -> list[str]:
    """What a legend says of a series."""
    return list(look.names.as_arrow_array().to_pylist())  # type: ignore[attr-defined]


def test_legends_have_the_units_of_the_table() -> None:
    """PV and OP where the table says none; a long one is cut."""
    known, unknown = (series.event_looks(scale) for scale in (Scale("bar", "%"), Scale()))
    assert names(known[series.PV]) == ["PV [bar]"]
    assert names(known[series.MODEL]) == ["model of PV [bar]"]
    assert names(known[series.OP]) == ["OP [%]"]
    assert names(unknown[series.PV]) == ["PV [PV]"]
    assert names(series.live_looks(Scale("x" * 99))[series.PV]) == [f"PV [{'x' * 11}…]"]
    assert names(series.response_looks()[series.BAND]) == ["its band"] * 2
    assert series.units(Scale("bar", "")) == ("bar", "OP")


def test_two_events_of_a_loop_share_no_path() -> None:
    """Even where their ids differ in what no path may hold."""
    base = series.entity("LIC-101")
    found = {series.of_event(base, series.PV, name) for name in ("a", "a/b", "a_b", "")}
    assert len(found) == 4
    assert {path.count("/") for path in found} == {4}
