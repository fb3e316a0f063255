"""The fleet picture: where loops stand, which names are shown, who is not in it."""

from __future__ import annotations

import math

from monitor.contract.records import LoopRow
from monitor.report.fleet import HEIGHT, MOST_LABELS, WIDTH, fleet_of

from .tools import fleet, retune


def kinds(rows: list[LoopRow]) -> dict[str, str]:
    return {r.loop: "good" if r.verdict == "good" else "retune" for r in rows}


def test_fast_is_right_and_fragile_is_up() -> None:
    rows = [retune("slow", ci_setpoint=0.1, ms=1.3), retune("wild", ci_setpoint=0.9, ms=5.0)]
    found = fleet_of(rows, kinds(rows))
    slow, wild = (next(p for p in found["points"] if p["loop"] == name) for name in ("slow", "wild"))
    assert slow["x"] < found["ci_limit"] < wild["x"]
    assert wild["y"] < found["ms_limit"] < slow["y"]


def test_what_lies_beyond_the_axes_stands_at_the_edge_and_the_rest_is_counted() -> None:
    rows = [retune("a", ms=math.inf, ci_setpoint=9.0), *fleet()[4:]]
    found = fleet_of(rows, kinds(rows))
    assert all(0 <= p["x"] <= WIDTH and 0 <= p["y"] <= HEIGHT for p in found["points"])
    assert found["missing"] == 2


def test_names_hide_no_names_and_good_loops_have_none() -> None:
    rows = [retune(f"LIC-{k}", ci_setpoint=0.3 + 1e-3 * k) for k in range(300)]
    rows += [LoopRow(loop="fine", verdict="good", ci_setpoint=0.9, ms=1.5)]
    labels = fleet_of(rows, kinds(rows))["labels"]
    assert 0 < len(labels) <= MOST_LABELS
    assert "fine" not in {label["name"] for label in labels}
    assert labels[0]["name"] == "LIC-0"  # the worst first


def test_a_crowd_of_good_loops_is_one_path_and_the_flagged_stay_single() -> None:
    rows = [
        retune("bad"),
        *(LoopRow(loop=f"{k}", verdict="good", ci_setpoint=0.9, ms=1.5) for k in range(2000)),
    ]
    found = fleet_of(rows, kinds(rows))
    assert [p["loop"] for p in found["points"]] == ["bad"]
    assert found["crowd"].count("M") == 2000
    assert fleet_of(rows[:9], kinds(rows))["crowd"] == ""
