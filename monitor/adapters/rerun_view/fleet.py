"""The fleet in Rerun: each loop a point, CI against Ms on log axes, coloured by what is to be done with it."""

from __future__ import annotations

import numpy as np
import rerun as rr

from monitor.contract.evidence import Fleet
from monitor.contract.fleet import (
    BOTTOM,
    CI_LEAST,
    CI_TICKS,
    HEIGHT,
    LEFT,
    MS_MOST,
    MS_TICKS,
    RIGHT,
    TOP,
    WIDTH,
    across,
    down,
)
from monitor.contract.looks import LOOKS
from monitor.contract.text import plain

NAMED = 40
"""Loops whose names are in the picture, the worst of those that need somebody; of all others the pointer shows them."""
HOVERED = 5000
"""Loops up to which the good ones have names for the pointer: of a larger fleet they are a crowd."""
POINT, FLAGGED_POINT = 2.5, 5.0
"""Radii on the screen [px]."""
STRETCH = 1.6
"""Of the report's picture, whose points these are: a viewer's pane is higher."""
ROW = 14
"""Height of a line of words."""
GRID_COLOUR, TEXT_COLOUR, SAFE_COLOUR = (70, 70, 75), (150, 150, 155), (0, 158, 115)


def frame() -> dict[str, rr.AsComponents]:
    """Return the axes and the region of the fast and safe, by entity."""
    left, right, top, bottom = LEFT, WIDTH - RIGHT, STRETCH * TOP, STRETCH * (HEIGHT - BOTTOM)
    upright = [[[x, top], [x, bottom]] for x in across(np.array(CI_TICKS))]
    level = [[[left, y], [right, y]] for y in STRETCH * down(np.array(MS_TICKS))]
    x, y = float(across(CI_LEAST)), STRETCH * float(down(MS_MOST))
    words = [(float(across(v)), bottom + 4, f"{v:g}") for v in CI_TICKS]
    words += [(left - ROW, STRETCH * float(down(v)) - ROW / 2, f"{v:g}") for v in MS_TICKS]
    words += [
        (
            (left + right) / 2,
            bottom + 2 * ROW,
            "closed-loop index CI (1 = the reference): faster to the right",
        ),
        (left + 6 * ROW, top - 2 * ROW, "peak sensitivity Ms: less robust upwards"),
        ((x + right) / 2, bottom - 2 * ROW, "fast and safe"),
        ((left + x) / 2, bottom - 2 * ROW, f"slow: CI below {CI_LEAST:g}"),
        ((x + right) / 2, top + ROW, f"near instability: Ms above {MS_MOST:g}"),
    ]
    return {
        "axes": rr.LineStrips2D(upright + level, colors=[GRID_COLOUR], radii=rr.Radius.ui_points(0.5)),
        "region": rr.Boxes2D(
            mins=[[x, y]],
            sizes=[[right - x, bottom - y]],
            colors=[SAFE_COLOUR],
            radii=rr.Radius.ui_points(1.5),
        ),
        "words": _words(words),
    }


def points(loops: Fleet) -> dict[str, rr.AsComponents]:
    """Return the loops, by entity: those that are good, all others, and the words for what is to be done."""
    place = np.column_stack([across(loops.ci), STRETCH * down(loops.ms)])[::-1]  # the worst on top
    kinds, names = list(loops.kinds)[::-1], list(loops.names)[::-1]
    good = np.array([kind == "good" for kind in kinds], dtype=np.bool_)
    flagged = np.flatnonzero(~good)
    colours = [_rgb(kind) for kind in kinds]
    shown = [plain(names[k], 40) for k in flagged]
    named, rest = flagged[-NAMED:], flagged[:-NAMED]
    hovered = (
        [plain(name, 40) for name, k in zip(names, good, strict=True) if k] if len(names) <= HOVERED else None
    )
    return {
        "good": rr.Points2D(
            place[good], colors=[_rgb("good")], radii=rr.Radius.ui_points(POINT), labels=hovered, show_labels=False
        ),
        "others": rr.Points2D(
            place[rest], colors=[colours[k] for k in rest], radii=rr.Radius.ui_points(FLAGGED_POINT),
            labels=shown[:-NAMED], show_labels=False,
        ),
        "named": rr.Points2D(
            place[named], colors=[colours[k] for k in named], radii=rr.Radius.ui_points(FLAGGED_POINT),
            labels=shown[-NAMED:], show_labels=True,
        ),
        "kinds": _legend(kinds),
    }  # fmt: skip


def _legend(kinds: list[str]) -> rr.Points2D:
    """Return what the colours mean, and how many loops are of each, above the picture."""
    words = [f"{look.words}: {kinds.count(kind)}" for kind, look in LOOKS.items()]
    step = (WIDTH - LEFT - RIGHT) / (len(words) + 1)
    places = [[LEFT + (k + 1.5) * step, STRETCH * TOP - 5 * ROW] for k in range(len(words))]
    return rr.Points2D(
        places,
        colors=[_rgb(kind) for kind in LOOKS],
        radii=rr.Radius.ui_points(FLAGGED_POINT),
        labels=words,
        show_labels=True,
    )


def _words(said: list[tuple[float, float, str]]) -> rr.Points2D:
    """Text in the picture: points that are not seen, with their labels."""
    places = [[x, y] for x, y, _ in said]
    return rr.Points2D(
        places,
        colors=[TEXT_COLOUR],
        radii=rr.Radius.ui_points(0.0),
        labels=[text for *_, text in said],
        show_labels=True,
    )


def _rgb(kind: str) -> tuple[int, int, int]:
    colour = LOOKS[kind].colour
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
