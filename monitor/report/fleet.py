"""The fleet picture: each loop's index against its peak sensitivity on log axes, as coordinates of an SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from monitor.contract.loops import Loop
from monitor.contract.records import LoopRow

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 940, 430, 52, 14, 14, 42
"""Of the picture and its margins [px]."""
CI_LOW, CI_HIGH, MS_LOW, MS_HIGH = 0.02, 2.0, 1.0, 10.0
"""Ends of the axes; what lies beyond is drawn at the edge."""
CI_TICKS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.6, 1.0, 2.0)
MS_TICKS = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
MS_MARGIN_RATIO = 1.25
"""Over `ms_max`, from which a loop is flagged."""
LETTER_PX, LINE_PX = 6.6, 12.0
"""Width of a letter of a label, and its height [px]."""
MOST_LABELS = 60
"""Names in the picture; as far as they find room, the worst first. Of all others the pointer shows them."""
MOST_SINGLE_POINTS = 1500
"""Points from which the good loops are one path without names, so that the picture of any fleet is there at once."""
_USUAL = Loop(name="usual")


def fleet_of(rows: Sequence[LoopRow], kinds: Mapping[str, str]) -> dict[str, Any]:
    """Return the picture's frame, its points (the worst drawn last, on top), its labels, and who is not in it."""
    points, missing = [], 0
    for row in rows:
        indices = [ci for ci in (row.ci_setpoint, row.ci_load) if ci is not None]
        at = place(row)
        if at is None:
            missing += 1
            continue
        points.append(
            {
                "loop": row.loop,
                "kind": kinds[row.loop],
                "x": at[0],
                "y": at[1],
                "scale": round(min(0.8 + 0.15 * math.log10(1 + row.events), 1.4), 2),
                "ci": min(indices),
                "ms": row.ms,
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
        "ci_limit": round(_x(_USUAL.ci_min), 1),
        "ms_limit": round(_y(MS_MARGIN_RATIO * _USUAL.ms_max), 1),
        "ci_min": _USUAL.ci_min,
        "ms_most": MS_MARGIN_RATIO * _USUAL.ms_max,
        "ci_ticks": [(round(_x(v), 1), f"{v:g}") for v in CI_TICKS],
        "ms_ticks": [(round(_y(v), 1), f"{v:g}") for v in MS_TICKS],
    }


def place(row: LoopRow) -> tuple[float, float] | None:
    """Return where a loop stands in the picture; None for one without an index or a model."""
    indices = [ci for ci in (row.ci_setpoint, row.ci_load) if ci is not None]
    if not indices or row.ms is None:
        return None
    return round(_x(min(indices)), 1), round(_y(row.ms), 1)


def _x(ci: float) -> float:
    share = math.log(min(max(ci, CI_LOW), CI_HIGH) / CI_LOW) / math.log(CI_HIGH / CI_LOW)
    return LEFT + share * (WIDTH - LEFT - RIGHT)


def _y(ms: float) -> float:
    share = math.log(min(max(ms, MS_LOW), MS_HIGH) / MS_LOW) / math.log(MS_HIGH / MS_LOW)
    return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)


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
