"""The gains that explain OP best, whatever a table says; and a controller of which no table says anything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .controller_case import FREE, NOWHERE, Case, settings_of_gains
from .controller_fit import (
    VERY_LITTLE_SHARE,
    Z95,
    Estimate,
    Known,
    estimate,
    explained,
    is_exact,
    placed,
    trimmed,
    walk_share,
)
from .controller_judge import NARROW_RATIO, NARROW_TIME_RATIO, WELL_EXPLAINED, is_drawn
from .controller_law import INTEGRAL, D, P
from .controller_other import WEIGHTS, with_derivative
from .controller_rows import Rows
from .controller_seen import FOUND, UNRESOLVED, Controller, intervals

FAR_BETTER = 0.25
"""Share of the squares that is left where other gains are taken for the true ones."""
LEAST_TD_PERIODS = 2.0
"""Sample periods from which a derivative that nobody declared is one: a shorter one may be coarse sampling."""
SMEARED_ROWS = (-1, 0, 1, 2)
"""Rows around a move of the set point in which a historian may have drawn it together with others."""
NO_INTEGRAL_RATIO = 1.02
"""Ratio of the squares left without and with an integral up to which there is none."""


def free_fit(case: Case) -> tuple[Case, float, Estimate]:
    """Return the case with its jumps set free, the likeliest share of a walk, and the gains that explain OP best.

    Where a recording draws the moves of a set point together, the rows around them fit no law: they are left out where
    the others then leave far less. Where slow movement shows what noise from row to row hides, levels count.
    """
    known = case.known
    rows = trimmed(case.rows, known.law(case.rows), known.active, 4.0 * case.rows.quantum)
    walk = walk_share(rows, known.law(rows), known.active, FREE)
    best = estimate(rows, known, walk, NOWHERE)
    if is_exact(rows, known, best):
        return replace(case, rows=rows), walk, best
    apart = _without_moves(rows)
    if apart is not None:
        other_walk = walk_share(apart, known.law(apart), known.active, FREE)
        other = estimate(apart, known, other_walk, NOWHERE)
        if other.place.squares / other.rows <= FAR_BETTER * best.place.squares / max(best.rows, 1):
            rows, walk, best = apart, other_walk, other
    if walk > 0.0 and explained(rows, known, best.gains, NOWHERE, 0.0) < WELL_EXPLAINED:
        levels = estimate(rows, known, 0.0, NOWHERE)
        if explained(rows, known, levels.gains, NOWHERE, 0.0) > WELL_EXPLAINED:
            walk, best = 0.0, levels
    return replace(case, rows=rows), walk, best


def _without_moves(rows: Rows) -> Rows | None:
    """Return the rows without those around moves of the set point; None where it does not move, or all the time."""
    moved = np.flatnonzero(np.diff(rows.sp)) + 1
    if len(moved) == 0 or len(moved) > len(rows) // 8 or rows.stride > 1:
        return None
    use = rows.use.copy()
    around = (moved[:, None] + np.array(SMEARED_ROWS)).ravel()
    use[around[(around >= 0) & (around < len(rows))]] = False
    return replace(rows, use=use) if np.count_nonzero(use) > len(rows) // 2 else None


def with_filter_found(case: Case, best: Estimate, walk: float) -> tuple[Case, Estimate]:
    """Return the case with a derivative, or its filter, as the data have them, where that leaves far less."""
    if case.rows.stride > 1:
        return case, best
    other = with_derivative(case.rows, case.known, walk)
    found = estimate(case.rows, other, walk, NOWHERE)
    td = float(found.gains[D] / found.gains[P]) if found.gains[P] else 0.0
    least = 0.0 if case.known.derivative else LEAST_TD_PERIODS * case.rows.period
    if found.place.squares > FAR_BETTER * best.place.squares or td <= least:
        return case, best
    if (
        case.known.given
        and not case.known.derivative
        and not is_exact(case.rows, other, found, VERY_LITTLE_SHARE)
    ):
        return case, best  # coarse samples of a PI look like a derivative, too
    return replace(case, known=other), found


def without_table(case: Case) -> Controller:
    """Return what is seen of a controller of which the table says nothing."""
    case, walk, found = _with_weights_found(case)
    known, rows = case.known, case.rows
    if not is_exact(rows, known, found):
        free = estimate(rows, known, walk, placed(rows, known, FREE, walk))
        found = free if free.place.squares <= FAR_BETTER * found.place.squares else found
    found = _without_integral(rows, known, walk, found)
    kp, ti, _ = intervals(found)
    seen = settings_of_gains(found.gains, known)
    share = explained(rows, known, found.gains, found.place, 0.0)
    clear = share > WELL_EXPLAINED and kp.ratio < NARROW_RATIO and ti.ratio < NARROW_TIME_RATIO
    if seen is None or not clear or is_drawn(rows):
        return case.controller(UNRESOLVED, found, NOWHERE, share)
    return case.controller(FOUND, found, found.place, share)


def _with_weights_found(case: Case) -> tuple[Case, float, Estimate]:
    """Return the free fit with the set-point weights, of the usual ones, that leave nothing, a derivative included."""
    fitted, walk, found = free_fit(case)
    if not is_exact(fitted.rows, fitted.known, found):
        fitted, found = with_filter_found(fitted, found, walk)
    if is_exact(fitted.rows, fitted.known, found) or not np.any(np.diff(case.rows.sp)):
        return fitted, walk, found
    for b, c in WEIGHTS:
        other, other_walk, by_weights = free_fit(replace(case, known=replace(case.known, b=b, c=c)))
        if not is_exact(other.rows, other.known, by_weights):
            other, by_weights = with_filter_found(other, by_weights, other_walk)
        if is_exact(other.rows, other.known, by_weights):
            return other, other_walk, by_weights
    return fitted, walk, found


def _without_integral(rows: Rows, known: Known, walk: float, found: Estimate) -> Estimate:
    """Return the gains without an integral where it explains nothing."""
    less = estimate(rows, replace(known, integral=False), walk, found.place)
    low, high = found.ends(INTEGRAL, Z95)
    as_good = less.place.squares <= NO_INTEGRAL_RATIO * found.place.squares
    nothing = as_good or is_exact(rows, known, less, VERY_LITTLE_SHARE)
    return less if nothing and low <= 0.0 <= high else found
