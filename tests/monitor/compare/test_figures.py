"""Each figure says better, worse, the same, or that it cannot be told; and counts where it matters."""

from __future__ import annotations

import math

import pytest

from monitor.compare.conditions import Condition
from monitor.compare.figures import changes_of
from monitor.contract.changes import BETTER, COMPARED, SAME, UNCLEAR, WORSE, Change
from monitor.contract.records import Assessment, Spell

from .tools import events, spells

SLOW, FAST = [0.30, 0.31, 0.29, 0.30, 0.32], [0.80, 0.82, 0.78, 0.81, 0.79]


def found(
    before: list[Assessment], after: list[Assessment], hours: tuple[list[Spell], list[Spell]] = ([], []),
    conditions: tuple[Condition, ...] = (),
) -> dict[str, Change]:  # fmt: skip
    return {c.name: c for c in changes_of((before, after), hours, conditions)}


def test_a_faster_loop() -> None:
    changes = found(events(SLOW), events(FAST))
    assert list(changes) == [n for n in COMPARED if n in changes]  # in the order of a reader
    index = changes["ci_setpoint"]
    assert (index.before, index.after, index.n_before, index.says, index.counts) == (
        0.30,
        0.80,
        5,
        BETTER,
        True,
    )
    assert index.ratio == pytest.approx(2.67, rel=0.02)
    assert changes["iae_setpoint"].says == BETTER
    assert not changes["iae_setpoint"].counts  # the index says it
    assert changes["ms"].says == SAME


def test_too_few_events_and_too_much_scatter_cannot_be_told() -> None:
    assert found(events(SLOW[:3]), events(FAST))["ci_setpoint"].says == UNCLEAR
    wide = [0.1, 0.9, 0.2, 0.7, 0.4]
    assert found(events(wide), events(wide[::-1]))["ci_setpoint"].says == UNCLEAR
    assert found(events([]), events(FAST))["ci_setpoint"].says == UNCLEAR


def test_beyond_the_reference_nothing_counts() -> None:
    assert not found(events([1.6] * 6), events([1.1] * 6))["ci_setpoint"].counts
    assert found(events([1.6] * 6), events([0.9] * 6))["ci_setpoint"].counts
    assert not found(events(FAST, ms=1.3), events(FAST, ms=1.8))["ms"].counts
    assert found(events(FAST, ms=1.3), events(FAST, ms=2.4))["ms"].counts


def test_an_unstable_loop_has_no_ratio() -> None:
    ms = found(events(FAST, ms=2.0), events(FAST, ms=math.inf))["ms"]
    assert (ms.after, ms.ratio, ms.says) == (math.inf, None, WORSE)


def test_errors_count_where_the_index_is_not_known() -> None:
    plain = [[Assessment(**{**{n: getattr(e, n) for n in e.__struct_fields__}, "ci": None}) for e in events(ci)]
             for ci in (SLOW, FAST)]  # fmt: skip
    changes = found(plain[0], plain[1])
    assert "ci_setpoint" not in changes
    assert changes["iae_setpoint"].counts
    assert changes["iae_setpoint"].before == pytest.approx(50.0 / 0.30 / 5.0)


def test_mean_errors_count_unless_the_conditions_explain_them() -> None:
    hours = spells(0.1), spells(0.2, seed=1)
    alike = found([], [], hours)["error"]
    assert (alike.says, alike.counts, alike.n_before) == (WORSE, True, 24)
    assert alike.ratio == pytest.approx(2.0, rel=0.05)
    assert not found([], [], hours, (Condition("noise", harder=True),))["error"].counts
    assert found([], [], hours, (Condition("noise", harder=False),))["error"].counts
    assert found([], [], (spells(0.1), spells(0.115)))["error"].says == SAME  # sure, and no matter
