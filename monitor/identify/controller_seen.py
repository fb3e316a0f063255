"""What was seen of a controller; whether two windows show the same one, and what several show together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tuners.settings import NotRepresentableError, Settings

from .controller_fit import Estimate
from .controller_law import INTEGRAL, D, P

AS_DECLARED, BESIDE, CONTRADICTED = "as declared", "as declared, and more", "contradicted"
NOT_LINEAR, UNRESOLVED, FOUND = "not linear", "unresolved", "found"


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval; not known: NaN between infinities."""

    value: float = math.nan
    low: float = -math.inf
    high: float = math.inf

    @property
    def ratio(self) -> float:
        """Ratio of the value to its farther end, or the other way round: 1 or more, inf where the sign is not known."""
        ends = abs(self.low), abs(self.high), abs(self.value)
        if self.low == self.high == self.value:
            return 1.0
        if not all(0.0 < end < math.inf for end in ends) or self.low * self.high < 0:
            return math.inf
        return (
            max(ends) / min(ends[:2])
            if self.value == 0
            else max(max(ends[:2]) / ends[2], ends[2] / min(ends[:2]))
        )

    def including(self, other: Interval) -> Interval:
        """Return the interval, wide enough to hold another's value."""
        return Interval(self.value, min(self.low, other.value), max(self.high, other.value))

    def widened(self, times: float) -> tuple[float, float]:
        """Return the ends, this many times as far away."""
        return self.value - times * (self.value - self.low), self.value + times * (self.high - self.value)


NOT_KNOWN = Interval()


@dataclass(frozen=True, slots=True)
class Controller:
    """What a window shows of the loop's controller."""

    said: str
    """`AS_DECLARED`, `BESIDE` (as declared, with a filter, a delay or a slower scan), `CONTRADICTED`, `NOT_LINEAR` (no
    PID of the measured error explains OP), `UNRESOLVED` (the recording does not show it), `FOUND` (no table)."""
    settings: Settings | None = None
    """As seen, standard form; None where that is not resolved."""
    kp: Interval = NOT_KNOWN
    ti: Interval = NOT_KNOWN
    td: Interval = NOT_KNOWN
    explained: float | None = None
    """Share of OP's movement that the settings in use explain, 0 to 1."""
    pv_filter: float = 0.0
    """[s]"""
    op_delay: float = 0.0
    """[s]"""
    scan: float = 0.0
    """Time from one run of the controller to the next [s]."""
    period: float = 0.0
    """[s]"""
    cause: str = ""
    """What is found beside or against the table, in plain words."""
    setpoint_only: bool = False
    """Nothing but how the set point acts is other than the table has it: kp, ti and td are the table's."""

    @property
    def delay(self) -> float:
        """Dead time in the loop beyond the model's and half a sample: filter, delay, half the longer scan [s]."""
        return max(self.pv_filter + self.op_delay + 0.5 * max(self.scan - self.period, 0.0), 0.0)

    def settings_in(self, form: str) -> Settings | None:
        """Return the settings seen in a form, None where there are none or the form cannot hold them."""
        try:
            return None if self.settings is None else self.settings.to(form)
        except NotRepresentableError:
            return None


Z95 = 1.96


def intervals(found: Estimate, z: float = Z95) -> tuple[Interval, Interval, Interval]:
    """Return kp, ti and td with their intervals, ``z`` standard deviations to either side."""
    kp, ki, kd = (float(g) for g in found.gains[:3])
    above = found.ends(P, z)
    ti, td = Interval(math.inf, math.inf, math.inf), Interval(0.0, 0.0, 0.0)
    if ki != 0 and kp != 0:
        ti = _ratio(kp / ki, above, found.ends(INTEGRAL, z))
    if kd != 0 and kp != 0:
        td = _ratio(kd / kp, found.ends(D, z), above)
    return Interval(kp, *above), ti, td


def _ratio(value: float, above: tuple[float, float], below: tuple[float, float]) -> Interval:
    """Return a ratio with the ends that the ends of both allow together."""
    low_a, high_a = _sizes(above)
    low_b, high_b = _sizes(below)
    return Interval(value, low_a / high_b if high_b else math.inf, high_a / low_b if low_b else math.inf)


def _sizes(ends: tuple[float, float]) -> tuple[float, float]:
    """Return the least and the largest size between two ends."""
    low, high = sorted((abs(ends[0]), abs(ends[1])))
    return (low, high) if ends[0] * ends[1] > 0 else (0.0, high)


DIFFERENT_TIMES, DIFFERENT_SHARE = 2.0, 0.05
"""How many half intervals (95 %), and shares of the value, lie at least between settings that have been changed."""


def differ(one: Controller, other: Controller) -> str:
    """Say how settings seen in a later window (``other``) differ from those before; empty where they may be the same.

    Examples
    --------
    >>> before = Controller(FOUND, kp=Interval(2.0, 1.9, 2.1), ti=Interval(80.0, 75.0, 85.0))
    >>> after = Controller(FOUND, kp=Interval(3.5, 3.4, 3.6), ti=Interval(81.0, 78.0, 84.0))
    >>> differ(before, after)
    'kp 2 to 3.5'
    """
    if {one.said, other.said} <= {AS_DECLARED, BESIDE}:
        return ""
    said = []
    for name, unit in (("kp", ""), ("ti", " s"), ("td", " s")):
        a, b = getattr(one, name), getattr(other, name)
        if _apart(a, b):
            said.append(f"{name} {a.value:.3g} to {b.value:.3g}{unit}")
    return ", ".join(said)


def _apart(a: Interval, b: Interval) -> bool:
    if not (math.isfinite(a.value) or math.isfinite(b.value)) or math.isnan(a.value) or math.isnan(b.value):
        return False
    if math.isinf(a.value) or math.isinf(b.value):  # integral action came or went
        found = b if math.isinf(a.value) else a
        return math.isfinite(found.high)
    (low_a, high_a), (low_b, high_b) = a.widened(DIFFERENT_TIMES), b.widened(DIFFERENT_TIMES)
    slack = DIFFERENT_SHARE * min(abs(a.value), abs(b.value))
    return low_a > high_b + slack or low_b > high_a + slack


_RANK = (CONTRADICTED, NOT_LINEAR, BESIDE, AS_DECLARED, FOUND)
"""Which of what several windows say is taken where as many say the one as the other."""


def combined(seen: Sequence[Controller]) -> Controller | None:
    """Return what several windows of one loop, under the same settings, show together; None without any.

    What most windows say that say something is said, and a law that is not linear where any shows it; among these,
    values are means weighted by their intervals. Each interval is as wide as the weights make it, and at least as the
    scatter of the values among the windows does.

    Examples
    --------
    >>> a = Controller(FOUND, kp=Interval(2.0, 1.9, 2.1), ti=Interval(80.0, 70.0, 90.0))
    >>> b = Controller(FOUND, kp=Interval(2.1, 2.0, 2.2), ti=Interval(80.0, 70.0, 90.0))
    >>> round(combined([a, b]).kp.value, 6)
    2.05
    """
    if not seen:
        return None
    told = [c for c in seen if c.said != UNRESOLVED]
    if not told:
        return min(
            seen, key=lambda c: (c.kp.high - c.kp.low) if math.isfinite(c.kp.high - c.kp.low) else math.inf
        )
    count = {said: sum(c.said == said for c in told) for said in _RANK}
    count[BESIDE] += count[AS_DECLARED] * (count[BESIDE] > 0)  # the same, where the window shows less
    # a gain that varies shows only where the error crosses its edge, the set point's weights only where it moves
    said = NOT_LINEAR if count[NOT_LINEAR] else max(_RANK, key=lambda r: count[r])
    if said in {AS_DECLARED, BESIDE} and any(c.setpoint_only for c in told):
        said = CONTRADICTED
    own = [c for c in told if c.said == said]
    best = min(own, key=lambda c: _width(c.kp) + _width(c.ti))
    kp, ti, td = (together([getattr(c, name) for c in own]) for name in ("kp", "ti", "td"))
    settings = best.settings
    if settings is not None and said in {FOUND, CONTRADICTED} and math.isfinite(kp.value):
        settings = replace(settings, kp=kp.value, ti=ti.value, td=max(td.value, 0.0))
    shares = [c.explained for c in own if c.explained is not None]
    return replace(
        best,
        settings=settings,
        kp=kp,
        ti=ti,
        td=td,
        explained=sum(shares) / len(shares) if shares else None,
        pv_filter=_median([c.pv_filter for c in own]),
        op_delay=_median([c.op_delay for c in own]),
        scan=_median([c.scan for c in own]),
    )


def _width(interval: Interval) -> float:
    width = (interval.high - interval.low) / abs(interval.value) if interval.value else 0.0
    return width if math.isfinite(width) else 0.0 if math.isinf(interval.value) else 1e9


def together(parts: Sequence[Interval]) -> Interval:
    """Return the mean of values by their intervals, with one as wide as these and the values' scatter ask for."""
    known = [p for p in parts if math.isfinite(p.value) and math.isfinite(p.high - p.low)]
    if not known:
        return parts[0] if parts else NOT_KNOWN
    if len(known) == 1:
        return known[0]
    least = 1e-9 * max(abs(p.value) for p in known) + 1e-100
    weights = [1.0 / max(p.high - p.low, least) ** 2 for p in known]
    total = sum(weights)
    value = sum(w * p.value for w, p in zip(weights, known, strict=True)) / total
    scatter = sum(w * (p.value - value) ** 2 for w, p in zip(weights, known, strict=True)) / total
    half = 0.5 / math.sqrt(total)
    # one window's interval holds what all share (noise that the controller does not see): no better than the best one
    half = max(half, 2.0 * math.sqrt(scatter / (len(known) - 1)))
    low = min(value - half, max(p.low for p in known))
    high = max(value + half, min(p.high for p in known))
    return Interval(value, low, high)


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]
