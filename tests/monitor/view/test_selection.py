"""Which loops are shown."""

from __future__ import annotations

from monitor.view.selection import Selection


def test_selection_shows_the_worst_and_does_not_flicker() -> None:
    """At most so many; a shown loop yields only to a clearly worse one, or when it is good again."""
    selection = Selection(most=3)

    def put(name: str, ci: float, verdict: str = "retune") -> bool:
        selection.put({"loop": name, "verdict": verdict, "ci_setpoint": ci}, f"plant/{name}")
        return selection.choose()

    assert put("a", 0.5)
    assert put("b", 0.4)
    assert put("c", 0.3)
    assert not put("d", 0.45)  # worse than a, but not by much
    assert put("e", 0.1)
    assert selection.shown == ["e", "c", "b"]
    assert put("e", 0.9, "good")
    assert selection.shown == ["c", "b", "d"]
    assert selection.counts() == {"retune": 4, "good": 1}
    assert [r["loop"] for r in selection.flagged()] == ["c", "b", "d", "a"]


def test_danger_comes_before_speed() -> None:
    """As in the audit: near instability, the valve, then the slowest; the rest needs nobody."""
    selection = Selection(most=2)
    for name, facts in {
        "slow": {"verdict": "retune", "ci_setpoint": 0.01},
        "valve": {"verdict": "inconclusive", "flags": ["stiction"]},
        "unsure": {"verdict": "inconclusive"},
        "near": {"verdict": "retune", "ci_setpoint": 0.9, "flags": ["near_instability"]},
    }.items():
        selection.put({"loop": name, **facts}, f"plant/{name}")
        selection.choose()
    assert [r["loop"] for r in selection.flagged()] == ["near", "valve", "slow"]
    assert selection.shown == ["near", "valve"]
    assert selection.counts() == {"retune": 2, "valve": 1, "unclear": 1}


def test_the_fleet_moves_where_a_loop_does() -> None:
    """The most dangerous first; a loop that loses its figures leaves; the same row again moves nothing."""
    selection = Selection()
    fine, slow = (
        {"loop": "a", "verdict": "good", "ci_load": 0.9, "ms": 1.5},
        {"loop": "b", "verdict": "retune"},
    )
    for facts in (fine, slow | {"ci_setpoint": 0.2, "ms": 1.2}):
        selection.put(facts, "plant/x")
    assert selection.moved
    fleet = selection.fleet()
    assert list(fleet.names) == ["b", "a"]
    assert list(fleet.kinds) == ["retune", "good"]
    assert fleet.ci.tolist() == [0.2, 0.9]
    selection.moved = False
    selection.put(fine, "plant/x")
    assert not selection.moved
    selection.put(slow, "plant/x")
    assert selection.moved
    assert (selection.placed, Selection().fleet().ci.size) == (1, 0)
