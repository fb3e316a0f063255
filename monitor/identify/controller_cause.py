"""Names for what a controller was found to do other than its table says: units, spans, sign, form."""

from __future__ import annotations

import math
from collections.abc import Iterator

from monitor.contract.loops import Loop
from tuners.settings import NotRepresentableError, Settings

ALIKE_RATIO = 1.04
"""Ratio of two numbers up to which one is taken for the other, whatever the intervals."""
KNOWN_RATIOS = (
    (100.0, "a fraction for a percentage"),
    (0.01, "a percentage for a fraction"),
    (2.55, "a byte (0 to 255) for a percentage"),
    (1 / 2.55, "a percentage for a byte (0 to 255)"),
)
"""What OP or a gain is multiplied by where units are mixed up."""


def cause_of(loop: Loop, declared: Settings, seen: Settings, slack: tuple[float, float, float]) -> str:
    """Say what the likely mistake in the table is.

    Parameters
    ----------
    declared, seen
        Standard form.
    slack
        Ratios up to which kp, ti and td count as the same.
    """
    slack = (max(slack[0], ALIKE_RATIO), max(slack[1], ALIKE_RATIO), max(slack[2], ALIKE_RATIO))
    for settings, said in _other_forms(loop):
        if _alike(settings, seen, slack):
            return f"OP behaves as with the {said}"
    parts = [
        _kp_said(loop, declared, seen, slack[0]),
        _time_said("Ti", float(declared.ti), float(seen.ti), slack[1]),
    ]
    if declared.td != 0 or seen.td != 0:
        parts.append(_time_said("Td", float(declared.td), float(seen.td), slack[2]))
    return "; ".join(p for p in parts if p)


def _other_forms(loop: Loop) -> Iterator[tuple[Settings, str]]:
    """Return the table's numbers read in the other forms."""
    if loop.kp is None or loop.td == 0:
        return
    for form in ("series", "standard"):
        if form == loop.canonical_form:
            continue
        try:
            own = Settings(loop.kp, loop.ti, loop.td, loop.filter_time, form, loop.b, loop.c)
            yield own.to("standard"), f"same numbers in the {form} form, the table says {loop.form}"
        except NotRepresentableError:
            continue


def same(one: float, other: float, slack: float) -> bool:
    """Whether two numbers are the same within a ratio."""
    if one == other:
        return True
    if not (math.isfinite(one) and math.isfinite(other)) or one * other <= 0:
        return False
    return abs(math.log(one / other)) <= math.log(slack)


def _alike(one: Settings, other: Settings, slack: tuple[float, float, float]) -> bool:
    pairs = ((one.kp, other.kp), (one.ti, other.ti), (one.td, other.td))
    return all(same(float(a), float(b), s) for (a, b), s in zip(pairs, slack, strict=True))


def _kp_said(loop: Loop, declared: Settings, seen: Settings, slack: float) -> str:
    kp, table = float(seen.kp), float(declared.kp)
    if same(kp, table, slack):
        return ""
    said = f"OP behaves as with kp = {short_number(kp)}, the table says {short_number(table)}"
    if same(kp, -table, slack):
        return f"{said}: the sign"
    for ratio, why in _spans(loop):
        if same(kp, table * ratio, slack):
            return f"{said}: {why}?"
    for ratio, why in KNOWN_RATIOS:
        if same(abs(kp), abs(table) * ratio, slack):
            return f"{said}: {why}?"
    if same(abs(kp), 100.0 / abs(table), slack):
        return f"{said}: a proportional band?"
    return f"{said}: a factor of {short_number(kp / table)}"


def _spans(loop: Loop) -> Iterator[tuple[float, str]]:
    if loop.op_span is None or loop.pv_low is None or loop.pv_high is None:
        return
    ratio = loop.op_span / (loop.pv_high - loop.pv_low)
    yield ratio, "in % of the spans (%/%)"
    yield 1.0 / ratio, "the spans the other way round"


def _time_said(name: str, declared: float, seen: float, slack: float) -> str:
    if same(seen, declared, slack):
        return ""
    said = f"OP behaves as with {name} = {_seconds(seen)}, the table says {_plain(declared)}"
    if declared == 0 or not (math.isfinite(declared) and math.isfinite(seen)) or seen == 0:
        return said
    for value, why in (
        (60.0 * declared, "minutes"),
        (60.0 / declared, "repeats a minute"),
        (1.0 / declared, "repeats a second"),
        (declared / 60.0, "seconds for minutes"),
        (3600.0 * declared, "hours"),
    ):
        if same(seen, value, slack):
            return f"{said}: {why}?"
    return f"{said}: a factor of {short_number(seen / declared)}"


def _seconds(value: float) -> str:
    return f"{short_number(value)} s" if math.isfinite(value) else "inf (no integral action)"


def _plain(value: float) -> str:
    return short_number(value) if math.isfinite(value) else "none"


def short_number(value: float) -> str:
    """Three digits."""
    return f"{value:.3g}"
