"""Names for what a controller was found to do other than its table says: units, spans, sign, form."""

from __future__ import annotations

import math
from collections.abc import Iterator

from monitor.contract.loops import Loop
from tuners.settings import FORMS, NotRepresentableError, Settings

ALIKE_RATIO = 1.05
"""Ratio of two numbers up to which one is taken for the other, where the intervals are narrower."""
MOST_ALIKE_RATIO = 1.4
"""The same where they are wider: beyond it, nearly anything would be alike."""
KNOWN_RATIOS = (
    (100.0, "a fraction for a percentage"),
    (0.01, "a percentage for a fraction"),
    (2.55, "a byte (0 to 255) for a percentage"),
    (1 / 2.55, "a percentage for a byte (0 to 255)"),
)
"""What OP or a gain is multiplied by where units are mixed up."""

Slack = tuple[float, float, float]


def cause_of(loop: Loop, seen: Settings, slack: Slack) -> str:
    """Say what the likely mistake in the table is.

    Parameters
    ----------
    seen
        Standard form.
    slack
        Ratios up to which kp, ti and td count as the same.
    """
    kp_slack, ti_slack, td_slack = (min(max(s, ALIKE_RATIO), MOST_ALIKE_RATIO) for s in slack)
    limits = kp_slack, ti_slack, td_slack
    for form in FORMS if loop.td > 0 else ():
        if form != loop.canonical_form and _alike(loop, _in_form(seen, form), slack):
            return f"OP behaves as with the same numbers in the {form} form, the table says {loop.form}"
    own = _in_form(seen, loop.canonical_form) or seen
    parts = [
        _kp_said(loop, float(own.kp), limits[0]),
        _time_said("Ti", loop.ti, float(own.ti), limits[1]),
        _time_said("Td", loop.td, float(own.td), limits[2]) if loop.td > 0 or own.td > 0 else "",
    ]
    return "; ".join(p for p in parts if p)


def same(one: float, other: float, slack: float) -> bool:
    """Whether two numbers are the same within a ratio."""
    if one == other:
        return True
    if not (math.isfinite(one) and math.isfinite(other)) or one * other <= 0:
        return False
    return abs(math.log(one / other)) <= math.log(slack)


def _in_form(seen: Settings, form: str) -> Settings | None:
    try:
        return seen.to(form)
    except NotRepresentableError:
        return None


def _alike(loop: Loop, own: Settings | None, slack: Slack) -> bool:
    """Whether settings are the table's numbers; closer than the forms lie to each other."""
    if own is None or loop.kp is None:
        return False
    least = 1.0 + 0.2 * min(loop.td / loop.ti, 1.0)  # the forms differ in kp by 1 + td/ti
    pairs = ((loop.kp, own.kp), (loop.ti, own.ti), (loop.td, own.td))
    return all(
        same(float(a), float(b), min(max(s, least), MOST_ALIKE_RATIO))
        for (a, b), s in zip(pairs, slack, strict=True)
    )


def _kp_said(loop: Loop, kp: float, slack: float) -> str:
    table = loop.kp or math.nan
    if same(kp, table, slack):
        return ""
    said = f"OP behaves as with kp = {short_number(kp)}, the table says {short_number(table)}"
    if same(kp, -table, slack):
        return f"{said}: the sign?"
    ratios = (*_spans(loop), *KNOWN_RATIOS, (100.0 / table**2, "a proportional band"))
    ratio, why = min(ratios, key=lambda r: abs(math.log(abs(kp / table) / r[0])))
    if same(abs(kp), abs(table) * ratio, slack):
        return f"{said}: {why}?"
    return f"{said}: a gain {short_number(kp / table)} times the table's"


def _spans(loop: Loop) -> Iterator[tuple[float, str]]:
    if loop.op_span is None or loop.pv_low is None or loop.pv_high is None:
        return
    ratio = loop.op_span / (loop.pv_high - loop.pv_low)
    if not same(ratio, 1.0, ALIKE_RATIO):
        yield ratio, "in % of the spans (%/%)"
        yield 1.0 / ratio, "the spans the other way round"


def _time_said(name: str, declared: float, seen: float, slack: float) -> str:
    if same(seen, declared, slack):
        return ""
    said = f"OP behaves as with {name} = {_seconds(seen)}, the table says {_plain(declared)}"
    if declared == 0 or not (math.isfinite(declared) and math.isfinite(seen)) or seen <= 0:
        return said
    units = (
        (60.0 * declared, "minutes"),
        (60.0 / declared, "repeats a minute"),
        (1.0 / declared, "repeats a second"),
        (declared / 60.0, "seconds for minutes"),
        (3600.0 * declared, "hours"),
    )
    value, why = min(units, key=lambda u: abs(math.log(seen / u[0])))
    if same(seen, value, slack):
        return f"{said}: {why}?"
    return f"{said}: {short_number(seen / declared)} times as much"


def _seconds(value: float) -> str:
    return f"{short_number(value)} s" if math.isfinite(value) else "inf (no integral action)"


def _plain(value: float) -> str:
    return short_number(value) if math.isfinite(value) else "none"


def short_number(value: float) -> str:
    """Three digits."""
    return f"{value:.3g}"
