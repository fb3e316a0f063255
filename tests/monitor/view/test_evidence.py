"""Which event stands for a loop, and what is remembered of it."""

from __future__ import annotations

from dataclasses import replace

from monitor.contract.evidence import Window
from monitor.view.evidence import EVENTS, WINDOWS, Evidence
from monitor.wire.arrow import decode_window
from tests.support.fake_monitor import demo_loops, window_payload


def judged(event: str, start: str, verdict: str = "good") -> dict[str, object]:
    return {"id": event, "start": start, "verdict": verdict}


def window(event: str = "e", onset: int = 1, loop: str = "L") -> Window:
    return replace(decode_window(window_payload(demo_loops()[0])), id=event, onset=onset, loop=loop)


def test_the_best_event_of_the_past_stands_for_a_loop() -> None:
    """One to retune before all others, then the latest."""
    evidence = Evidence()
    for fact, better in (
        (judged("a", "2026-01-01"), True),
        (judged("b", "2026-01-03"), True),
        (judged("c", "2026-01-02"), False),
        (judged("d", "2025-01-01", "retune"), True),
        (judged("e", "2026-02-01"), False),
    ):
        evidence.keep(fact)
        assert evidence.prefer("L", fact) is better
    assert evidence.stands == {"L": "d"}


def test_what_a_suggestion_rests_on_stands_whatever_else_is_remembered() -> None:
    """Until the loop is no longer shown."""
    evidence = Evidence()
    evidence.cite("L", "a")
    assert not evidence.prefer("L", judged("b", "2026-01-01", "retune"))
    evidence.forget("L")
    assert evidence.prefer("L", judged("b", "2026-01-01", "retune"))
    assert evidence.stands == {"L": "b"}


def test_the_newest_window_is_held_or_the_one_that_stands() -> None:
    """Each is drawn once, and only of loops that are shown."""
    evidence = Evidence()
    evidence.hold(window("new", 5))
    evidence.hold(window("old", 3))
    assert [w.id for w in evidence.undrawn(["L", "M"])] == ["new"]
    assert list(evidence.undrawn(["L"])) == []
    evidence.cite("L", "old")
    evidence.hold(window("old", 3))
    assert evidence.windows(["M", "L"])["L"].id == "old"
    assert [w.id for w in evidence.undrawn(["L"])] == ["old"]


def test_it_is_bounded() -> None:
    """What came first is forgotten first."""
    evidence = Evidence()
    for k in range(EVENTS + 1):
        evidence.keep(judged(str(k), ""))
    assert evidence.assessment("0") is None
    assert evidence.assessment("1") is not None
    for k in range(WINDOWS + 1):
        evidence.hold(window(loop=f"L{k}"))
    assert len(evidence.windows([f"L{k}" for k in range(WINDOWS + 1)])) == WINDOWS
