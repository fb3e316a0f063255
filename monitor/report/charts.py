"""Evidence as compact JSON: each column as 16-bit steps between its least and largest value, in base64.

What a picture shows is a few hundred pixels high: 65,000 steps lose nothing, and take a quarter of the text.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.evidence import Answers, Window
from monitor.contract.records import Assessment

from .words import clock, number, percent

STEPS = 65534
"""Of a column; the last code, 65535, says that there is no value."""

WORDS = {"setpoint": "set-point step", "load": "load step"}
"""By kind of event."""

EVEN_SHARE = 0.02
"""Of a step, by which points at even steps may be off: less than a pixel, and what float32 leaves."""
MOST_STEPS = 40
"""Changes of a column up to which naming them is shorter than all of its values."""

Floats = NDArray[np.float64]


def charts_of(
    events: Sequence[Assessment], windows: Sequence[Window], answers: Sequence[Answers]
) -> dict[str, list[dict[str, Any]]]:
    """Return what `report.js` draws of a loop: its events, the newest first, and its answers to steps."""
    by_id = {event.id: event for event in events}
    trend = [w for w in windows if not w.id][-1:]
    shown = [(by_id[w.id], w) for w in windows if w.id in by_id]
    return {
        "events": [_event(event, window) for event, window in reversed(shown)],
        "trend": [_trend(w) for w in trend],
        "answers": [_answer(answer) for answer in sorted(answers, key=lambda a: a.kind, reverse=True)],
    }


def _event(event: Assessment, window: Window) -> dict[str, Any]:
    time = np.asarray(window.time - window.onset, dtype=np.float64) * 1e-9
    unit = "OP" if event.kind == "load" else "PV"
    known = [("CI", number(event.ci)), ("fit", percent(event.fit)), ("method", event.method or "")]
    figures = ", ".join(f"{name} {value}" for name, value in known if value)
    return {
        "title": f"{WORDS.get(event.kind, event.kind)} of {number(event.amplitude)} [{unit}] at {clock(event.start)}",
        "note": f"{event.state}; {event.verdict}{'; ' + figures if figures else ''}",
        "end": round((event.end - window.onset) * 1e-9, 3),
        "t": pack_even(time),
        "sp": pack_steps(window.sp),
        "pv": pack(window.pv),
        "op": pack(window.op),
        "model": pack(window.model),
    }


def _trend(window: Window) -> dict[str, Any]:
    """Return a loop's newest samples, as an event that has no window."""
    time = np.asarray(window.time - window.onset, dtype=np.float64) * 1e-9
    first, last = clock(int(window.time[0])), clock(int(window.time[-1]))
    columns = {"sp": pack_steps(window.sp), "pv": pack(window.pv), "op": pack(window.op), "model": []}
    return {"title": f"{first} to {last}", "note": "", "end": None, "t": pack_even(time), **columns}


def _answer(answer: Answers) -> dict[str, Any]:
    curves = {"today": answer.today, "new": answer.new}
    return {
        "kind": answer.kind,
        "t": pack_even(answer.time),
        **{
            f"{n}{k}": pack(c)
            for n, three in curves.items()
            for k, c in zip(("", "_lo", "_hi"), three, strict=True)
        },
    }


def pack(values: Floats) -> list[Any]:
    """Return ``[least, step, codes]``, or ``[value]`` for a column of one value; empty for one of none.

    Examples
    --------
    >>> pack(np.array([2.0, 2.0])), pack(np.array([np.nan]))
    ([2.0], [])
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return []
    low, high = float(finite.min()), float(finite.max())
    if low == high and len(finite) == len(values):
        return [_short(low)]
    step = _short((high - low) / STEPS) or 1.0
    codes = np.full(len(values), STEPS + 1, dtype="<u2")
    scaled = np.rint((values - low) / step)
    codes[np.isfinite(values)] = np.clip(scaled[np.isfinite(values)], 0, STEPS).astype("<u2")
    return [_short(low), step, base64.b64encode(codes.tobytes()).decode()]


def pack_even(values: Floats) -> list[Any]:
    """Return ``[first, step, number, 0]`` for values at even steps, else as `pack`.

    Examples
    --------
    >>> pack_even(np.arange(0.0, 5.0, 0.5))
    [0.0, 0.5, 10, 0]
    """
    if len(values) > 2:
        step = (values[-1] - values[0]) / (len(values) - 1)
        if np.abs(values - values[0] - step * np.arange(len(values))).max() <= EVEN_SHARE * abs(step):
            return [_short(float(values[0])), _short(float(step)), len(values), 0]
    return pack(values)


def pack_steps(values: Floats) -> list[Any]:
    """Return ``[[row, value], ...]`` of a column that changes seldom, each value from its row on; else as `pack`.

    Examples
    --------
    >>> pack_steps(np.array([1.0, 1.0, 2.0, 2.0]))
    [[0, 1.0], [2, 2.0]]
    """
    changes = np.flatnonzero(np.diff(values) != 0) + 1
    if not len(values) or len(changes) > MOST_STEPS or not np.isfinite(values).all():
        return pack(values)
    return [[int(k), _short(float(values[k]))] for k in (0, *changes)]


def _short(value: float) -> float:
    """Return a number with seven significant digits, as many as the columns have."""
    return float(f"{value:.7g}")
