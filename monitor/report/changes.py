"""What has changed between two audits, as a page of its own, and as the part of a report's page one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from monitor.contract.changes import (
    BETTER,
    COMPARED,
    LEVEL,
    MISSING,
    MIXED,
    NEW,
    OUTCOMES,
    SAME,
    UNCLEAR,
    WORSE,
    Change,
    Comparison,
    LoopChange,
)
from monitor.contract.looks import OUTCOME_LOOKS

from .fleet import frame, labels_of, place
from .page import asset, environment
from .words import facts_of, number

SHOWN_SINCE = 5
"""Loops that page one of a report names, of those that got worse and of those that improved."""
SHOWN_SIGNS = 3
"""Of what has changed of such a loop, the heaviest first."""
SHOWN_NAMES = 20
"""Loops that are new, missing or look renamed, by name."""
MOST_FIGURES = 500
"""Loops whose figures stand in the page, the changed ones first: some 3 kB each."""
MOST_ARROWS = 300
"""In the picture, those that got worse first: more hide each other, and none has room for its name."""
RATIO_REACH = 4.0
"""Ratio at the ends of an interval's picture, and one over it."""
BAR_WIDTH, BAR_HEIGHT = 150, 14
IN_TABLE = ("ci_setpoint", "ci_load", "ms", "error", "error_rms", "op_path")
"""Figures that have a column in the table of all loops."""


def draw_changes(found: Comparison) -> str:
    """Return ``compare.html``; the same comparison gives the same text."""
    ordered = found.of(WORSE) + found.of(MIXED) + found.of(BETTER) + found.of(UNCLEAR) + found.of(SAME)
    page = (
        environment()
        .get_template("compare.html.j2")
        .render(
            before=facts_of(found.before),
            after=facts_of(found.after),
            found=found,
            tiles=[(o, OUTCOME_LOOKS[o]) for o in OUTCOMES],
            looks=OUTCOME_LOOKS,
            parts=[
                (title, outcome, found.of(outcome))
                for title, outcome in (
                    ("What got worse", WORSE),
                    ("Better in one, worse in another", MIXED),
                    ("What improved", BETTER),
                )
            ],
            kinds=[(o, OUTCOME_LOOKS[o]) for o in (WORSE, MIXED, BETTER)],
            others=[
                (title, [c.loop for c in found.of(o)]) for title, o in (("New", NEW), ("Missing", MISSING))
            ],
            shown_names=SHOWN_NAMES,
            picture=_picture(found.of(WORSE) + found.of(MIXED) + found.of(BETTER)),
            heads=[COMPARED[name] for name in IN_TABLE],
            most_arrows=MOST_ARROWS,
            level=LEVEL,
            lines=[(c, _cells(c)) for c in found.loops],
            sections=[(c, [_figure(f) for f in c.changes]) for c in ordered[:MOST_FIGURES]],
            left=max(len(ordered) - MOST_FIGURES, 0),
            bar=(BAR_WIDTH, BAR_HEIGHT),
            style=asset("report.css"),
        )
    )
    return page + "\n"


def since_of(found: Comparison) -> dict[str, Any]:
    """Return what page one of a report says of the change since the last audit."""
    return {
        "before": facts_of(found.before),
        "found": found,
        "shown_signs": SHOWN_SIGNS,
        "tiles": [(o, OUTCOME_LOOKS[o]) for o in OUTCOMES],
        "parts": [
            (OUTCOME_LOOKS[o], found.of(*of)[:SHOWN_SINCE], max(len(found.of(*of)) - SHOWN_SINCE, 0))
            for o, of in ((WORSE, (WORSE, MIXED)), (BETTER, (BETTER,)))
        ],
    }


def _picture(loops: Sequence[LoopChange]) -> dict[str, Any]:
    """Return arrows from where loops stood to where they stand, and the names that find room."""
    arrows: list[dict[str, Any]] = []
    for change in loops:
        ends = [place(row) for row in (change.before, change.after) if row is not None]
        if len(ends) < 2 or None in ends or len(arrows) == MOST_ARROWS:
            continue
        (x0, y0), (x1, y1) = (end for end in ends if end is not None)
        arrows.append({"loop": change.loop, "outcome": change.outcome, "x0": x0, "y0": y0, "x": x1, "y": y1})
    return {
        **frame(),
        "arrows": arrows[::-1],
        "labels": labels_of(arrows),
        "missing": len(loops) - len(arrows),
    }


def _cells(change: LoopChange) -> list[tuple[str, str]]:
    """Return the cells of a loop's line: before and after, and what that says."""
    by_name = {f.name: f for f in change.changes}
    return [_cell(by_name.get(name)) for name in IN_TABLE]


def _cell(figure: Change | None) -> tuple[str, str]:
    if figure is None:
        return "", ""
    return f"{number(figure.before) or '–'} → {number(figure.after) or '–'}", figure.says


def _figure(figure: Change) -> dict[str, Any]:
    """Return the line of a figure: words, numbers, interval, and that as a bar on a log axis about 1."""
    compared = COMPARED[figure.name]
    bar = None
    if figure.ratio is not None:
        ends = (figure.ratio_lo, figure.ratio, figure.ratio_hi)
        bar = [round(_along(v), 1) for v in ends if v is not None]
    return {
        "words": compared.words,
        "unit": compared.unit,
        "change": figure,
        "of": "events" if compared.from_events else "spells",
        "bar": bar,
    }


def _along(ratio: float) -> float:
    """Return where a ratio stands along the bar."""
    share = math.log(min(max(ratio, 1.0 / RATIO_REACH), RATIO_REACH)) / math.log(RATIO_REACH)
    return BAR_WIDTH / 2.0 * (1.0 + share)
