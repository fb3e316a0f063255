"""What has become of a loop, and what follows: retuned and better, retuned and worse, or changed by itself."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from monitor.compare.judge import judge
from monitor.contract.changes import BETTER, KEPT, MIXED, RETUNED, SAME, UNCLEAR, WORSE, LoopChange
from monitor.contract.records import Assessment, LoopRow

from .tools import events, row, spells

SLOW, FAST = [0.30, 0.31, 0.29, 0.30, 0.32], [0.80, 0.82, 0.78, 0.81, 0.79]
MODEL = {"process": "integrating", "gain": 0.1, "gain_lo": 0.09, "gain_hi": 0.11}


def judged(
    before: LoopRow,
    after: LoopRow,
    ci: tuple[Sequence[float], Sequence[float]] = ((), ()),
    error: float = 0.1,
) -> LoopChange:
    hours = spells(0.1), spells(error, seed=1)
    found: tuple[list[Assessment], list[Assessment]] = (events(ci[0]), events(ci[1]))
    return judge((before, after), found, hours)


def test_retuned_and_better() -> None:
    found = judged(row(verdict="retune", new_kp=4.0, new_ti=60.0, new_td=0.0), row(kp=4.0), (SLOW, FAST))
    assert (found.outcome, found.settings) == (BETTER, RETUNED)
    assert found.conclusion == "retuned as suggested and better: keep the new settings"
    assert found.better == ("to retune no more", "index after set-point steps 0.3 → 0.8")


def test_retuned_and_worse_has_the_way_back() -> None:
    found = judged(row(), row(kp=1.0), (FAST, SLOW))
    assert found.outcome == WORSE
    assert found.conclusion == "retuned and worse: go back to kp = 2, ti = 60 s"


def test_the_way_back_is_not_into_danger_and_there_may_be_a_way_on() -> None:
    near = row(flags=("near_instability",), verdict="retune")
    after = row(kp=1.0, flags=("near_instability",), verdict="retune", new_kp=0.5)
    assert judged(near, after, (FAST, SLOW)).conclusion == (
        "retuned and worse: go back to something between: kp = 2, ti = 60 s was near instability; what the later audit "
        "suggests is the way on"
    )


@pytest.mark.parametrize(
    ("more", "cause"),
    [
        ({"flags": ("stiction", "oscillating")}, "look at the valve"),
        ({"flags": ("oscillating",)}, "find where the cycle comes from"),
        ({"gain": 0.3, "gain_lo": 0.28, "gain_hi": 0.32}, "the process has changed (gain 0.1 → 0.3)"),
        ({}, "stroke the valve first"),
    ],
)
def test_worse_by_itself_has_a_cause_to_look_for(more: dict[str, object], cause: str) -> None:
    found = judged(row(**MODEL), row(**{**MODEL, **more}), (FAST, SLOW))
    assert (found.outcome, found.settings) == (WORSE, KEPT)
    assert found.conclusion.startswith("not retuned, worse by itself; ")
    assert found.conclusion.endswith(cause)


def test_better_without_a_retune() -> None:
    found = judged(row(flags=("stiction",), verdict="inconclusive"), row(), (SLOW, FAST))
    assert (
        found.conclusion == "better, though not retuned; stiction is seen no more: repaired, or not excited?"
    )


def test_better_in_one_and_worse_in_another() -> None:
    found = judged(row(), row(kp=4.0), (SLOW, FAST), error=0.3)
    assert found.outcome == MIXED
    assert "or go back to kp = 2" in found.conclusion


def test_from_and_towards_instability_outweighs_the_rest() -> None:
    near = row(flags=("near_instability",), verdict="retune")
    assert judged(near, row(kp=1.0), (FAST, SLOW)).outcome == BETTER
    assert judged(row(), near, (SLOW, FAST)).outcome == WORSE


def test_as_before() -> None:
    assert judged(row(), row(), (FAST, FAST)).conclusion == "as before"
    found = judged(row(new_kp=4.0, verdict="retune"), row(verdict="retune"), (SLOW, SLOW))
    assert (found.outcome, found.conclusion) == (
        SAME,
        "as before; the settings that were suggested are not in",
    )


def test_an_error_alone_is_of_the_loads_as_well() -> None:
    """Without a retune it is said, and decides nothing; after one it does."""
    found = judged(row(), row(), error=0.2)
    assert found.outcome == UNCLEAR
    assert "mean size of the error" in found.conclusion
    assert found.conclusion.endswith("loop or loads, which of the two the events do not tell")
    assert judged(row(), row(kp=4.0), error=0.2).outcome == WORSE


def test_too_few_events_are_counted() -> None:
    found = judge((row(), row(kp=4.0)), (events(SLOW[:3]), events(FAST[:2])), ([], []))
    assert found.outcome == UNCLEAR
    assert (
        found.conclusion
        == "retuned; whether that helped cannot be told yet; too few events before and after (3 and 2; 5 and 5 "
        "of a kind tell)"
    )
    nothing = judge((row(), row()), ([], []), ([], []))
    assert nothing.conclusion.endswith("no event, and no time watched in automatic, in both")
