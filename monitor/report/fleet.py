"""The fleet picture: each loop's index against its peak sensitivity on log axes, as coordinates of an SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

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
    ci_and_ms,
    down,
)
from monitor.contract.records import LoopRow

LETTER_PX, LINE_PX = 6.6, 12.0
"""Width of a letter of a label, and its height [px]."""
MOST_LABELS = 60
"""Names in the picture; as far as they find room, the worst first. Of all others the pointer shows them."""
MOST_SINGLE_POINTS = 1500
"""Points from which the good loops are one path without names, so that the picture of any fleet is there at once."""


def fleet_of(rows: Sequence[LoopRow], kinds: Mapping[str, str]) -> dict[str, Any]:
    """Return the picture's frame, its points (the worst drawn last, on top), its labels, and who is not in it."""
    points, missing = [], 0
    for row in rows:
        found, at = ci_and_ms(row), place(row)
        if found is None or at is None:
            missing += 1
            continue
        ci, ms = found
        points.append(
            {
                "loop": row.loop,
                "kind": kinds[row.loop],
                "x": at[0],
                "y": at[1],
                "scale": round(min(0.8 + 0.15 * math.log10(1 + row.events), 1.4), 2),
                "ci": ci,
                "ms": ms,
                "events": row.events,
            }
        )
    good = [p for p in points if p["kind"] == "good"]
    crowd = ""
    if len(points) > MOST_SINGLE_POINTS:
        crowd = "".join(f"M{p['x']} {p['y']}h0" for p in good)
        points = [p for p in points if p["kind"] != "good"]
    return {
        **frame(),
        "crowd": crowd,
        "points": points[::-1],
        "labels": labels_of([p for p in points if p["kind"] != "good"]),
        "missing": missing,
    }


def frame() -> dict[str, Any]:
    """Return the picture's frame: its edges, limits and ticks."""
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "left": LEFT,
        "right": WIDTH - RIGHT,
        "top": TOP,
        "bottom": HEIGHT - BOTTOM,
        "ci_limit": round(float(across(CI_LEAST)), 1),
        "ms_limit": round(float(down(MS_MOST)), 1),
        "ci_min": CI_LEAST,
        "ms_most": MS_MOST,
        "ci_ticks": [(round(float(across(v)), 1), f"{v:g}") for v in CI_TICKS],
        "ms_ticks": [(round(float(down(v)), 1), f"{v:g}") for v in MS_TICKS],
    }


def place(row: LoopRow) -> tuple[float, float] | None:
    """Return where a loop stands in the picture; None for one without an index or a model."""
    found = ci_and_ms(row)
    return None if found is None else (round(float(across(found[0])), 1), round(float(down(found[1])), 1))


def labels_of(points: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Place names beside their points where they hide no other name and leave the picture nowhere; worst first."""
    taken: list[tuple[float, float, float, float]] = [
        (p["x"] - 5, p["y"] - 5, p["x"] + 5, p["y"] + 5) for p in points
    ]
    labels: list[dict[str, Any]] = []
    for k, point in enumerate(points):
        if len(labels) >= MOST_LABELS:
            break
        name = point["loop"] if len(point["loop"]) <= 24 else point["loop"][:23] + "…"
        wide = LETTER_PX * len(name)
        for dx, dy, anchor in ((8, 4, "start"), (-8, 4, "end"), (0, -9, "middle"), (0, 17, "middle")):
            x, y = point["x"] + dx, point["y"] + dy
            left = x - {"start": 0.0, "end": wide, "middle": wide / 2}[anchor]
            box = left, y - LINE_PX + 2, left + wide, y + 3
            inside = (
                box[0] >= LEFT and box[2] <= WIDTH - RIGHT and box[1] >= TOP and box[3] <= HEIGHT - BOTTOM
            )
            others = (b for n, b in enumerate(taken) if n != k)
            if inside and not any(_overlap(box, other) for other in others):
                taken.append(box)
                labels.append({"x": round(x, 1), "y": round(y, 1), "anchor": anchor, "name": name})
                break
    return labels


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
