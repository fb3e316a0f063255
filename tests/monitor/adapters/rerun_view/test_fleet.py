"""The fleet's picture in Rerun."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.adapters.rerun_view.fleet import HOVERED, NAMED, STRETCH, frame, points
from monitor.contract.evidence import Fleet
from monitor.contract.fleet import CI_LEAST, MS_MOST, across, down


def labels(drawn: Any) -> list[str]:
    return [] if drawn.labels is None else list(drawn.labels.as_arrow_array().to_pylist())


def places(drawn: Any) -> np.ndarray:
    return np.array(drawn.positions.as_arrow_array().to_pylist())


def fleet(kinds: list[str]) -> Fleet:
    n = len(kinds)
    return Fleet([f"L{k}" for k in range(n)], kinds, np.linspace(0.1, 1.0, n), np.linspace(4.0, 1.2, n))


def test_the_worst_have_names_and_the_good_have_them_for_the_pointer() -> None:
    """Each loop once, at its place; the worst is drawn last, on top."""
    loops = fleet(["retune"] * (NAMED + 5) + ["good"] * 7)
    drawn = points(loops)
    assert labels(drawn["named"])[-1] == "L0"
    assert len(labels(drawn["named"])) == NAMED
    assert len(labels(drawn["others"])) == 5
    assert len(labels(drawn["good"])) == 7
    np.testing.assert_allclose(
        places(drawn["named"])[-1], [across(loops.ci[0]), STRETCH * down(loops.ms[0])], rtol=1e-6
    )
    assert labels(drawn["kinds"])[:2] == ["good: 7", f"to retune: {NAMED + 5}"]


def test_a_large_fleet_is_a_crowd() -> None:
    """No names for the good ones, and no loop is left out; no fleet at all is drawn, too."""
    drawn = points(fleet(["valve"] + ["good"] * HOVERED))
    assert labels(drawn["good"]) == []
    assert len(places(drawn["good"])) == HOVERED
    assert labels(drawn["named"]) == ["L0"]
    assert len(points(fleet([]))["kinds"].as_component_batches()) > 0


def test_the_region_of_the_fast_and_safe_is_marked() -> None:
    region: Any = frame()["region"]
    centre, half = (
        region.centers.as_arrow_array().to_pylist()[0],
        region.half_sizes.as_arrow_array().to_pylist()[0],
    )
    np.testing.assert_allclose(centre[0] - half[0], across(CI_LEAST), rtol=1e-6)
    np.testing.assert_allclose(centre[1] - half[1], STRETCH * down(MS_MOST), rtol=1e-6)
