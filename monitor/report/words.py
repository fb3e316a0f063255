"""Numbers, times and facts of an audit as a reader wants them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from monitor.contract.times import RELATIVE_NS, iso

MOST_INPUTS = 6
"""Files of an audit that are named."""


def number(value: object, digits: int = 3) -> str:
    """Return a number with so many significant digits, an empty text for none.

    Examples
    --------
    >>> number(0.123456), number(1234567.0), number(float("inf")), number(None), number(-0.5)
    ('0.123', '1.23e6', '∞', '', '−0.5')
    """
    if value is None or isinstance(value, bool | str):
        return "" if value is None else str(value)
    figure = float(value)  # type: ignore[arg-type]
    if not math.isfinite(figure):
        return "" if math.isnan(figure) else ("∞" if figure > 0 else "−∞")
    if figure != 0 and not 1e-4 <= abs(figure) < 1e5:
        mantissa, _, exponent = f"{figure:.{digits - 1}e}".partition("e")
        text = f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}e{int(exponent)}"
    else:
        text = f"{figure:.{digits}g}"
        if "e" in text:
            text = f"{float(text):.0f}"
    return text.replace("-", "−") if not text.startswith("e") else text


def percent(share: float | None, digits: int = 0) -> str:
    """Return a share in per cent.

    Examples
    --------
    >>> percent(0.987), percent(None)
    ('99 %', '')
    """
    return "" if share is None else f"{100.0 * share:.{digits}f} %"


def clock(time: int | None) -> str:
    """Return a time [ns since 1970] to the second; of times that count from a start, the second.

    Examples
    --------
    >>> clock(1_795_486_200 * 10**9), clock(90 * 10**9)
    ('2026-11-24 02:10:00', 'second 90')
    """
    if time is None:
        return ""
    if abs(time) < RELATIVE_NS:
        return f"second {time * 1e-9:.10g}"
    return iso(time, "ms")[:19].replace("T", " ")


def first_clauses(text: str, most: int = 2) -> str:
    """Return the first clauses of a reason, which are parted by semicolons; all are in the loop's section.

    Examples
    --------
    >>> first_clauses("slow; rolls; noisy", 2)
    'slow; rolls'
    """
    return "; ".join(text.split("; ")[:most])


def facts_of(about: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the head of the page says of an audit, from its ``audit.json``."""
    counts, inputs = about.get("counts", {}), [str(i.get("name", "")) for i in about.get("inputs", [])]
    skipped = about.get("skipped", {})
    return {
        "first": _day(about.get("first_sample")),
        "last": _day(about.get("newest_sample")),
        "inputs": inputs[:MOST_INPUTS],
        "more_inputs": max(len(inputs) - MOST_INPUTS, 0),
        "table": (about.get("settings", {}).get("loops") or {}).get("name", ""),
        "version": about.get("versions", {}).get("loopsight", ""),
        "samples": counts.get("ok", 0),
        "rows": counts.get("rows", 0),
        "events": counts.get("events", 0),
        "skipped_files": [f"{e['name']}: {e['reason']}" for e in skipped.get("files", [])],
        "skipped_loops": [f"{e['loop']}: {e['reason']}" for e in skipped.get("loops", [])],
        "zone": about.get("time_zone", "UTC"),
        "naive": bool(about.get("times_without_zone")),
    }


def _day(time: object) -> str:
    """Return an ISO time to the minute; of one that counts from a start, as it is."""
    text = str(time or "")
    return text[:16].replace("T", " ") if not text.startswith("1970") else f"{text[11:19]} from the start"
