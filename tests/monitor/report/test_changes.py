"""The page of a comparison: what got worse and what improved, hostile names harmless, one file without a script."""

from __future__ import annotations

import re

import pytest

from monitor.compare.between import compare
from monitor.contract.changes import Comparison
from monitor.report.changes import MOST_FIGURES, draw_changes, since_of
from monitor.report.draw import draw
from tests.monitor.compare.tools import audit, events, row, spells

from .tools import contents, fleet

HOSTILE = "<script>alert(1)</script>\x1b[31m\u202e"


@pytest.fixture
def found() -> Comparison:
    names = ["LIC-1", "LIC-2", HOSTILE]
    slow, fast = [0.3] * 6, [0.8] * 6
    old = [*events(slow, "LIC-1"), *events(fast, "LIC-2"), *events(fast, HOSTILE)]
    new = [*events(fast, "LIC-1"), *events(slow, "LIC-2"), *events(slow, HOSTILE)]
    rows = [row(n, ci_setpoint=0.3, ms=1.4) for n in names]
    after = [row(n, ci_setpoint=0.8, ms=1.9, kp=3.0) for n in names]
    return compare(
        audit([*rows, row("TIC-3")], old, spells(0.1)),
        audit([*after, row("A/TIC-3")], new, spells(0.2), lacks=("x",)),
    )


def test_it_says_what_got_worse_and_what_improved(found: Comparison) -> None:
    page = draw_changes(found)
    assert page == draw_changes(found)
    assert "What got worse: 2 loops" in page
    assert "Better in one, worse in another: 1 loop<" in page  # LIC-1's mean error is twice as large
    assert "go back to kp = 2, ti = 60 s" in page
    assert "TIC-3 → A/TIC-3" in page
    assert "has no x: what rests on them is not compared" in page


def test_nothing_of_a_name_is_run_and_nothing_asked_for(found: Comparison) -> None:
    page = draw_changes(found)
    assert "<script" not in page
    assert "\x1b" not in page
    assert "\u202e" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert not re.findall(r"(?:src|href)=\"(?!data:,)[^#]", page)


def test_a_large_fleet_has_its_lines_and_the_figures_of_the_worst() -> None:
    rows = [row(f"L{k:04}") for k in range(MOST_FIGURES + 10)]
    page = draw_changes(compare(audit(rows), audit(rows)))
    assert "10 more loops stand in compare.csv" in page
    assert page.count("<details") == MOST_FIGURES
    assert len(page) < 2e6


def test_page_one_of_a_report_says_what_has_changed(found: Comparison) -> None:
    plain = draw(contents(fleet()))
    assert "Since the last audit" not in plain
    shown = contents(fleet())
    page = draw(
        type(shown)(shown.about, shown.rows, shown.events, shown.windows, shown.answers, shown.summary, found)
    )
    part = page[page.index('id="since"') : page.index("What could not be judged")]
    assert "What got worse" in part
    assert 'data-loop="LIC-2"' in part
    assert "&lt;script&gt;" in part
    assert "<script" not in part
    assert since_of(found)["parts"][0][2] == 0


def test_an_audit_of_other_loops_is_said() -> None:
    shown = contents(fleet())
    other = compare(audit([row("X")]), audit([row("Y")]))
    page = draw(
        type(shown)(shown.about, shown.rows, shown.events, shown.windows, shown.answers, shown.summary, other)
    )
    assert "That audit has no loop of this one." in page
