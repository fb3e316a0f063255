"""Whether a loop ran under other conditions: noise, loads, set-point steps, time in control, the process itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from scipy import special

from monitor.contract.records import SETPOINT, Assessment, LoopRow, Spell

from .chance import LEVEL, ratio_of_events

NOISE_RATIO = 1.5
"""From which on noise is not the same: an estimate of it is good to some ten per cent."""
OFTEN_RATIO = 2.0
"""From which on steps and upsets come more often, or are larger, than is small talk."""
SHARE = 0.1
"""Of the time: from which on more of it at a limit, or in manual, is a change."""
PROCESS_RATIO = 1.2
"""From which on a gain or a time of the process is another one, where the intervals do not meet."""
STEPS, UPSETS = "set-point steps", "upsets"


def conditions_of(
    rows: tuple[LoopRow, LoopRow],
    events: tuple[Sequence[Assessment], Sequence[Assessment]],
    spells: tuple[Sequence[Spell], Sequence[Spell]],
) -> list[str]:
    """Say in what the two periods differ much; nothing where they do not, or where that cannot be seen.

    Parameters
    ----------
    rows, events, spells
        Of one loop, before and after.
    """
    before, after = rows
    said = []
    if before.noise and after.noise and _far(after.noise / before.noise, NOISE_RATIO):
        said.append(f"noise {before.noise:.3g} → {after.noise:.3g} [PV]")
    hours = [sum(s.seconds for s in of) / 3600.0 for of in spells]
    counts = [Counter(STEPS if e.kind == SETPOINT else UPSETS for e in of) for of in events]
    if min(hours) > 0.0:
        for name in (STEPS, UPSETS):
            n = [count[name] for count in counts]
            rates = [k / h for k, h in zip(n, hours, strict=True)]
            if _more_often(n, hours) and _far(rates[1] / rates[0] if rates[0] else 99.0, OFTEN_RATIO):
                said.append(f"{name} {24 * rates[0]:.2g} → {24 * rates[1]:.2g} a day")
    for kind, words, unit in (("load", "load steps", "OP"), (SETPOINT, STEPS, "PV")):
        sizes = [[abs(e.amplitude) for e in of if e.kind == kind and e.amplitude] for of in events]
        ratio = ratio_of_events(*sizes)
        if ratio is not None and ratio.low * ratio.high > 0 and not ratio.low <= 1.0 <= ratio.high:
            if _far(ratio.value, OFTEN_RATIO):
                said.append(f"{words} {ratio.value:.2g} times as large [{unit}]")
    for name, words in (("saturation", "at a limit"), ("manual", "in manual")):
        x, y = getattr(before, name), getattr(after, name)
        if x is not None and y is not None and abs(y - x) >= SHARE:
            said.append(f"{x:.0%} → {y:.0%} of the time {words}")
    return said


def process_change(before: LoopRow, after: LoopRow) -> str:
    """Say how the process has changed, by the models of all events together; empty where the intervals meet."""
    said = []
    for name, words in (("gain", "gain"), ("t0", "lags and dead time together")):
        values = [getattr(r, name) for r in (before, after)]
        ends = [getattr(r, f"{name}{end}") for r in (before, after) for end in ("_lo", "_hi")]
        if before.process != after.process or None in values or None in ends or not all(values):
            continue
        meet = ends[0] <= ends[3] and ends[2] <= ends[1]
        if not meet and _far(values[1] / values[0], PROCESS_RATIO):
            said.append(f"{words} {values[0]:.3g} → {values[1]:.3g}")
    return f"the process has changed ({', '.join(said)})" if said else ""


def _far(ratio: float, limit: float) -> bool:
    return not 1.0 / limit < ratio < limit


def _more_often(counts: Sequence[int], hours: Sequence[float]) -> bool:
    """Whether two counts differ by more than chance, given how long was watched (a binomial of their sum)."""
    n, p = sum(counts), hours[1] / sum(hours)
    tails = special.bdtr(counts[1], n, p), special.bdtrc(counts[1] - 1, n, p) if counts[1] else 1.0
    return bool(n and min(tails) < (1.0 - LEVEL) / 2.0)
