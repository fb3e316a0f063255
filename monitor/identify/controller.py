"""The controller, seen in the data: what settings, filter, delay and pace of execution explain OP by SP and PV."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.settings import NotRepresentableError, Settings

from .controller_cause import cause_of
from .controller_fit import (
    EXACT_SHARE,
    MOST_JUMPS_SHARE,
    THINNED_SHARE,
    Z95,
    Estimate,
    Known,
    Place,
    estimate,
    explained,
    left_at,
    placed,
    trimmed,
    walk_share,
)
from .controller_law import INTEGRAL, D, P, columns
from .controller_rows import LEAST_ROWS, Rows, lay_out
from .controller_seen import (
    AS_DECLARED,
    BESIDE,
    CONTRADICTED,
    FOUND,
    UNRESOLVED,
    Controller,
    Interval,
)

FAR_BETTER = 0.25
"""Share of the squares that is left where another law is taken for the true one."""
WELL_EXPLAINED, FINE = 0.98, 0.8
"""Shares of OP's levels, and of its moves from row to row, that such a law must explain."""
FAR_SD = 4.0
"""Standard deviations from which a gain is another one."""


def see_controller(window: EventWindow, period: float, loop: Loop) -> Controller | None:
    """Look in a window for the controller that explains OP; None where OP or the window tells nothing at all.

    Parameters
    ----------
    period
        Of the samples [s].
    """
    rows = lay_out(window, period, loop)
    if rows is None:
        return None
    sampled = rows.at_scans() if rows.scan > 1 else rows
    if len(sampled) < LEAST_ROWS:
        return None
    known = known_of(loop)
    if known is None:
        return _without_table(sampled, rows)
    return _as_declared(sampled, rows, known) or _searched(sampled, rows, loop, known)


def known_of(loop: Loop) -> Known | None:
    """Return the table's settings as a law in standard form, None where there are none."""
    if loop.settings is None:
        return None
    try:
        s = loop.settings.to("standard")
    except NotRepresentableError:
        return None
    return Known(float(s.kp), float(s.ki), float(s.kd), float(s.filter_time), float(s.b), float(s.c))


def _as_declared(rows: Rows, all_rows: Rows, known: Known) -> Controller | None:
    """Return what is said where the table explains OP to rounding, but for sparse jumps of its own; cheap."""
    for present in (1.0, 0.5, 0.0):
        x = columns(rows.time, rows.sp, rows.pv, known.law(rows, present), 0.0, 0)
        rest, wish = rows.op - x @ known.gains, x @ known.gains
        told = rows.use.copy()
        told[1:] &= rows.use[:-1] & ~rows.fresh[1:]
        told[0] = False
        v = np.diff(rest, prepend=rest[0])
        moved = float(np.std(wish[rows.use]))
        exact = max((EXACT_SHARE if rows.stride == 1 else THINNED_SHARE) * moved, 0.6 * rows.quantum)
        at = np.flatnonzero(told & (np.abs(v) > 4.0 * exact))
        if len(at) > max(MOST_JUMPS_SHARE * len(rows), 2) or moved <= 2.0 * rows.quantum:
            continue
        level = np.cumsum(rows.fresh | ~told | np.isin(np.arange(len(rows)), at))
        count = np.bincount(level[rows.use])
        mean = np.bincount(level[rows.use], rest[rows.use]) / np.maximum(count, 1)
        left_over = rest[rows.use] - mean[level[rows.use]]
        if float(np.std(left_over)) <= exact:
            share = 1.0 - float(np.var(left_over)) / max(float(np.var(rows.op[rows.use])), 1e-300)
            return _beside(rows, all_rows, known, Place(0.0, 0.0, 0.0), share, _jumps_said(at, rows))
    return None


def _jumps_said(at: NDArray[np.intp], rows: Rows) -> str:
    moved = np.zeros(len(rows), bool)
    moved[1:] = np.diff(rows.sp) != 0
    sudden = at[~moved[at]]
    if len(sudden) == 0:
        return ""
    times = "once" if len(sudden) == 1 else f"{len(sudden)} times"
    return f"OP jumps {times} where neither set point nor PV moves: a feed-forward or an operator"


def _beside(
    rows: Rows,
    all_rows: Rows,
    known: Known,
    place: Place,
    share: float,
    cause: str,
    bounds: Estimate | None = None,
) -> Controller:
    """Return what is said where the table holds, perhaps with a filter, a delay or a slow scan."""
    t, late = place.filter_time, place.late * rows.period
    found = []
    if t > 0.05 * rows.period:
        found.append(f"a PV filter of {t:.3g} s")
    if late > 0:
        found.append(f"a delay of {late:.3g} s")
    if rows.period > all_rows.period:
        found.append(f"a controller that runs each {rows.period:.3g} s")
    said = BESIDE if found else AS_DECLARED
    more = f"OP behaves as with {' and '.join(found)}" if found else ""
    settings = Settings(
        known.kp,
        known.kp / known.ki if known.ki else math.inf,
        known.kd / known.kp,
        known.tf,
        "standard",
        known.b,
        known.c,
    )
    kp, ti, td = (Interval(float(v), float(v), float(v)) for v in (settings.kp, settings.ti, settings.td))
    if bounds is not None:
        kp, ti, td = intervals(bounds)
    return Controller(
        said,
        settings,
        kp,
        ti,
        td,
        min(max(share, 0.0), 1.0),
        t,
        late,
        rows.period,
        all_rows.period,
        "; ".join(c for c in (more, cause) if c),
    )


def intervals(found: Estimate, z: float = Z95) -> tuple[Interval, Interval, Interval]:
    """Return kp, ti and td with their intervals."""
    kp, ki, kd = (float(g) for g in found.gains[:3])
    ends = found.ends(P, z)
    ti = td = Interval(math.inf, math.inf, math.inf)
    if ki != 0 and kp != 0:
        ti = _ratio(kp / ki, ends, found.ends(INTEGRAL, z))
    td = _ratio(kd / kp, found.ends(D, z), ends) if kd != 0 and kp != 0 else Interval(0.0, 0.0, 0.0)
    return Interval(kp, *ends), ti, td


def _ratio(value: float, above: tuple[float, float], below: tuple[float, float]) -> Interval:
    """Return a ratio with the ends that both ends allow together."""
    low_a, high_a = (
        sorted(abs(a) for a in above) if above[0] * above[1] > 0 else (0.0, max(abs(a) for a in above))
    )
    low_b, high_b = (
        sorted(abs(b) for b in below) if below[0] * below[1] > 0 else (0.0, max(abs(b) for b in below))
    )
    return Interval(value, low_a / high_b if high_b else math.inf, high_a / low_b if low_b else math.inf)


def _searched(rows: Rows, all_rows: Rows, loop: Loop, known: Known) -> Controller:
    """Return what is said where the table alone does not explain OP to rounding."""
    free = np.full(4, np.nan)
    rows = trimmed(rows, known.law(rows), known.active, 4.0 * rows.quantum)
    walk = walk_share(rows, known.law(rows), known.active, free)
    nowhere = Place(0.0, 0.0, 0.0)
    s0 = left_at(rows, known, known.gains, walk, nowhere)
    free_here = left_at(rows, known, free, walk, nowhere)
    by_table = placed(rows, known, known.gains, walk)
    s1 = left_at(rows, known, known.gains, walk, by_table)
    fine1 = explained(rows, known, known.gains, by_table, 1.0)
    share1 = explained(rows, known, known.gains, by_table, 0.0)
    if s1 <= FAR_BETTER * s0 and share1 > WELL_EXPLAINED and fine1 > FINE:
        return _beside(rows, all_rows, known, by_table, share1, "")
    anywhere = placed(rows, known, free, walk)
    s2 = left_at(rows, known, free, walk, anywhere)
    best = anywhere if s2 <= FAR_BETTER * free_here else nowhere
    found = estimate(rows, known, walk, best)
    share0 = explained(rows, known, known.gains, nowhere, 0.0)
    share2 = explained(rows, known, found.gains, best, 0.0)
    if not against(known, found, rows):
        return _beside(rows, all_rows, known, nowhere, share0, "", found)
    clear = share2 > WELL_EXPLAINED
    if clear and min(s0, s1) > found.place.squares / FAR_BETTER:
        return _contradicted(rows, all_rows, loop, known, found, share0)
    return Controller(
        UNRESOLVED,
        None,
        *intervals(found),
        min(max(share0, 0.0), 1.0),
        scan=rows.period,
        period=all_rows.period,
    )


def against(known: Known, found: Estimate, rows: Rows) -> bool:
    """Whether the table's gains lie outside of what the data allow, and of what a discretisation may shift."""
    shift = abs(float(found.gains[INTEGRAL])) * rows.period
    for which, declared in ((P, known.kp), (INTEGRAL, known.ki), (D, known.kd)):
        if declared == 0.0:
            continue
        low, high = found.ends(which, FAR_SD)
        slack = 0.01 * abs(declared) + (shift if which == P else 0.0)
        if which == D:
            slack += 0.3 * abs(declared) + shift * rows.period
        if not low - slack <= declared <= high + slack:
            return True
    return False


def _contradicted(
    rows: Rows, all_rows: Rows, loop: Loop, known: Known, found: Estimate, share0: float
) -> Controller:
    """Return what is said where other settings explain OP and those of the table do not."""
    kp, ti, td = intervals(found)
    seen = settings_of_gains(found.gains, known)
    declared = settings_of_gains(known.gains, known)
    slack = _slack(kp), _slack(ti), _slack(td)
    cause = "" if seen is None or declared is None else cause_of(loop, declared, seen, slack)
    return Controller(
        CONTRADICTED,
        seen,
        kp,
        ti,
        td,
        min(max(share0, 0.0), 1.0),
        found.place.filter_time,
        found.place.late * rows.period,
        rows.period,
        all_rows.period,
        cause,
    )


def _slack(interval: Interval) -> float:
    """Return the ratio that an interval spans to its farther end."""
    v, low, high = abs(interval.value), abs(interval.low), abs(interval.high)
    if not (
        v > 0 and math.isfinite(v) and low > 0 and high > 0 and math.isfinite(low) and math.isfinite(high)
    ):
        return 1.0
    return max(v / low, low / v, high / v, v / high)


def settings_of_gains(gains: Array, known: Known) -> Settings | None:
    """Return gains as settings of the standard form, with the table's filter and weights."""
    kp, ki, kd = (float(g) for g in gains[:3])
    if kp == 0 or ki / kp < 0:
        return None
    td = max(kd / kp, 0.0)
    return Settings(
        kp, kp / ki if ki else math.inf, td, known.tf if td > 0 else 0.0, "standard", known.b, known.c
    )


def _without_table(rows: Rows, all_rows: Rows) -> Controller:
    """Return what is seen of a controller of which the table says nothing: PI, or P alone."""
    known = Known(1.0, 1.0, 0.0, 0.0, 1.0, 1.0)
    free = np.full(4, np.nan)
    rows = trimmed(rows, known.law(rows), known.active, 4.0 * rows.quantum)
    walk = walk_share(rows, known.law(rows), known.active, free)
    nowhere = Place(0.0, 0.0, 0.0)
    anywhere = placed(rows, known, free, walk)
    best = (
        anywhere
        if left_at(rows, known, free, walk, anywhere)
        <= FAR_BETTER * left_at(rows, known, free, walk, nowhere)
        else nowhere
    )
    found = estimate(rows, known, walk, best)
    kp, ti, td = intervals(found)
    seen = settings_of_gains(found.gains, known)
    share = explained(rows, known, found.gains, best, 0.0)
    resolved = seen is not None and share > WELL_EXPLAINED and _slack(kp) < 1.15 and _slack(ti) < 1.25
    return Controller(
        FOUND if resolved else UNRESOLVED,
        seen if resolved else None,
        kp,
        ti,
        td,
        min(max(share, 0.0), 1.0),
        best.filter_time,
        best.late * rows.period,
        rows.period,
        all_rows.period,
    )
