"""Whether a loop ran under other conditions: noise, loads, set-point steps, time in control, the process itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scipy import special

from monitor.contract.changes import LEVEL
from monitor.contract.records import LOAD, SETPOINT, Assessment, LoopRow, Spell

from .chance import ratio_of_events

NOISE_RATIO = 1.5
"""From which on noise is not the same: an estimate of it is good to some ten per cent."""
OFTEN_RATIO = 2.0
"""From which on moves and upsets come more often, or are larger, than is small talk."""
PROCESS_RATIO = 1.2
"""From which on a gain or a time of the process is another one, where the intervals do not meet."""
DAY_S = 86400.0
MUCH_SHARE = 0.2
"""Of the error's integral that belongs to set-point steps, from which on more or fewer of them explain its mean."""


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
    days = [sum(s.seconds for s in of) / DAY_S for of in spells]
    if min(days) > 0.0:
        said += [*_moves(events, spells, days), *_often(events, days)]
    sizes = [[abs(e.amplitude) for e in of if e.kind == LOAD and e.amplitude] for of in events]
    ratio = ratio_of_events(*sizes)
    if ratio is not None and not ratio.low <= 1.0 <= ratio.high and _far(ratio.value, OFTEN_RATIO):
        said.append(Condition(f"load steps {ratio.value:.2g} times as large [OP]", ratio.value > 1.0))
    return said


def _moves(
    events: Sequence[Sequence[Assessment]], spells: Sequence[Sequence[Spell]], days: Sequence[float]
) -> Iterator[Condition]:
    """Return by how much more, or less, the set point was moved, where that is a good part of the error."""
    steps = [[e for e in of if e.kind == SETPOINT] for of in events]
    moved = [sum(abs(e.amplitude) for e in of) / d for of, d in zip(steps, days, strict=True)]
    shares = [
        sum(e.iae or 0.0 for e in of) / (sum(s.error * s.seconds for s in hours) or math.inf)
        for of, hours in zip(steps, spells, strict=True)
    ]
    if max(shares) >= MUCH_SHARE and min(moved) * OFTEN_RATIO <= max(moved):
        yield Condition(f"set point moved {moved[0]:.3g} → {moved[1]:.3g} [PV] a day", moved[1] > moved[0])


def _often(events: Sequence[Sequence[Assessment]], days: Sequence[float]) -> Iterator[Condition]:
    """Return by what upsets and load steps come more or less often, in so many days that were watched."""
    n = [sum(e.kind != SETPOINT for e in of) for of in events]
    rates = [k / d for k, d in zip(n, days, strict=True)]
    if _more_often(n, days) and min(rates) * OFTEN_RATIO <= max(rates):
        yield Condition(f"upsets {rates[0]:.2g} → {rates[1]:.2g} a day", rates[1] > rates[0])


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
