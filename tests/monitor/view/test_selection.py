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
