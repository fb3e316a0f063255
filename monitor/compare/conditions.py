"""Whether a loop ran under other conditions: noise, loads, set-point steps, time in control, the process itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scipy import special

from monitor.contract.changes import LEVEL
from monitor.contract.records import SETPOINT, Assessment, LoopRow, Spell

from .chance import ratio_of_events

NOISE_RATIO = 1.5
"""From which on noise is not the same: an estimate of it is good to some ten per cent."""
OFTEN_RATIO = 2.0
"""From which on steps and upsets come more often, or are larger, than is small talk."""
PROCESS_RATIO = 1.2
"""From which on a gain or a time of the process is another one, where the intervals do not meet."""
DAY_S = 86400.0
STEPS, UPSETS = "set-point steps", "upsets"


class Condition(NamedTuple):
    """In what the later period differs."""

    words: str
    harder: bool
    """Whether it makes errors larger, rather than smaller."""


def conditions_of(
    rows: tuple[LoopRow, LoopRow],
    events: tuple[Sequence[Assessment], Sequence[Assessment]],
    spells: tuple[Sequence[Spell], Sequence[Spell]],
) -> list[Condition]:
    """Return in what the two periods differ much; nothing where they do not, or where that cannot be seen.

    Parameters
    ----------
    rows, events, spells
        Of one loop, before and after.
    """
    before, after = rows
    said = []
    if before.noise and after.noise and _far(after.noise / before.noise, NOISE_RATIO):
        words = f"noise {before.noise:.3g} → {after.noise:.3g} [PV]"
        said.append(Condition(words, after.noise > before.noise))
    said += _often(events, [sum(s.seconds for s in of) / DAY_S for of in spells])
    for kind, words, unit in (("load", "load steps", "OP"), (SETPOINT, STEPS, "PV")):
        sizes = [[abs(e.amplitude) for e in of if e.kind == kind and e.amplitude] for of in events]
        ratio = ratio_of_events(*sizes)
        if ratio is not None and not ratio.low <= 1.0 <= ratio.high and _far(ratio.value, OFTEN_RATIO):
            said.append(Condition(f"{words} {ratio.value:.2g} times as large [{unit}]", ratio.value > 1.0))
    return said


def _often(
    events: tuple[Sequence[Assessment], Sequence[Assessment]], days: Sequence[float]
) -> Iterator[Condition]:
    """Return by what steps and upsets come more or less often, in so many days that were watched."""
    if min(days) <= 0.0:
        return
    for name in (STEPS, UPSETS):
        n = [sum((STEPS if e.kind == SETPOINT else UPSETS) == name for e in of) for of in events]
        rates = [k / d for k, d in zip(n, days, strict=True)]
        if _more_often(n, days) and not min(rates) * OFTEN_RATIO > max(rates):
            yield Condition(f"{name} {rates[0]:.2g} → {rates[1]:.2g} a day", rates[1] > rates[0])


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


def _more_often(counts: Sequence[int], watched: Sequence[float]) -> bool:
    """Whether two counts differ by more than chance, given how long was watched (a binomial of their sum)."""
    n, p = sum(counts), watched[1] / sum(watched)
    above = special.bdtrc(counts[1] - 1, n, p) if counts[1] else 1.0
    return bool(n and min(special.bdtr(counts[1], n, p), above) < (1.0 - LEVEL) / 2.0)
