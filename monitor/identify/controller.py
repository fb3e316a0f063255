"""The controller, seen in the data: what settings, filter, delay and pace of execution explain OP by SP and PV.

From the cheapest question to the dearest: does the table explain OP to rounding, as it is; do other gains; does the
table with a PV filter or a delay; do other gains with these. A table is contradicted only where other gains explain OP
far better, and where its own lie outside of what the data allow: beyond four standard deviations, beyond what noise in
PV that the controller did not see could hide, and beyond what the way in which a block integrates may shift.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.settings import NotRepresentableError

from .controller_case import FREE, NOWHERE, Case, settings_of_gains
from .controller_cause import cause_of
from .controller_fit import (
    EXACT_SHARE,
    MOST_JUMPS_SHARE,
    THINNED_SHARE,
    VERY_LITTLE_SHARE,
    Estimate,
    Known,
    Place,
    estimate,
    explained,
    is_exact,
    left_at,
    placed,
)
from .controller_free import FAR_BETTER, free_fit, with_filter_found, without_table
from .controller_judge import (
    VERY_FINE,
    WELL_EXPLAINED,
    against,
    far,
    is_drawn,
    shown,
    well,
)
from .controller_law import INTEGRAL, P, columns, compared
from .controller_other import WEIGHTS, recorded_filter, setpoint_inside, varying_gain
from .controller_rows import LEAST_ROWS, Rows, lay_out
from .controller_seen import (
    AS_DECLARED,
    BESIDE,
    CONTRADICTED,
    NOT_LINEAR,
    UNRESOLVED,
    Controller,
    intervals,
)
from .correlation import correlation_time

EXACT_RATIO = 1.05
"""Ratio to the ends of its interval up to which kp is known where gains leave nothing: a response of one mode allows
for many of them."""
MUCH_BETTER = 0.1
"""Share of the squares that is left where a filter or a delay is taken to be there."""
LEAST_EXACT_ROWS = 7
"""Rows that show a law that leaves nothing."""
LEAST_FILTER_PERIODS = 0.05
"""A PV filter shorter than this is none."""
PACED_LEVELS, PACED_MOVES = 0.9, 0.5
"""Shares of OP's levels and moves that the table explains of a controller that runs between the rows."""
FAR_RATIO = 2.0
"""Ratio to the ends of its interval from which kp is hardly known."""


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
    known = known_of(loop)
    paced = [Case(rows.at_scans(late), rows, loop, known, late) for late in range(rows.scan) if rows.scan > 1]
    as_recorded = Case(rows, rows, loop, known)
    if known.given:
        for case in [*paced, as_recorded]:
            found = _as_declared(case.settled())
            if found is not None:
                return found
        odd = _at_odd_pace(as_recorded) if rows.pace else None
        if odd is not None:
            return odd
    found = None
    for case in [*paced[:1], as_recorded]:
        if len(case.rows) >= LEAST_ROWS and (found is None or found.said == UNRESOLVED):
            found = _searched(case.settled()) if known.given else without_table(case)
    return found


def known_of(loop: Loop) -> Known:
    """Return the table's settings as a law in standard form; without any, those of a PI that is not known."""
    own = loop.settings
    if own is None:
        return Known(1.0, 1.0, 0.0, 0.0, loop.b, loop.c, derivative=False, given=False)
    try:
        s = own.to("standard")
    except NotRepresentableError:  # numbers that no such block can have: read as they stand
        s = replace(own, form="standard")
    tf = float(own.filter_time)
    return Known(float(s.kp), float(s.ki), float(s.kd), tf, float(s.b), float(s.c), derivative=loop.td > 0)


def _as_declared(case: Case) -> Controller | None:
    """Return what is said where the table explains OP to rounding, but for sparse jumps of its own; cheap."""
    rows, known = case.rows, case.known
    for present in (1.0, 0.5, 0.0):
        found = _compared(rows, known, present)
        if found is None:
            continue
        at, share, x = found
        moved = at[np.diff(rows.sp)[at - 1] != 0]
        other = _other_weights(rows, known, present, len(at)) if len(moved) else None
        if other is not None:
            return _weights_said(replace(case, known=other), known, share)
        said = _jumps_said(np.setdiff1d(at, moved))
        return _declared(case, NOWHERE, share, said, _within_what_is_left(rows, known, x, at))
    return None


def _compared(rows: Rows, known: Known, present: float) -> tuple[NDArray[np.intp], float, Array] | None:
    """Return the rows at which OP jumps, the share that the law explains beside, and the law's columns (n, 4).

    None where the law is not exact.
    """
    x = columns(rows.time, rows.sp, rows.pv, known.law(rows, present), 0.0, 0)
    share = EXACT_SHARE if rows.stride == 1 else THINNED_SHARE
    jump, rest, allowed, moved, spread = compared(
        x, known.gains, rows.op, rows.use, rows.fresh, share, rows.quantum
    )
    told, at = np.count_nonzero(rows.use), np.flatnonzero(jump)
    few = len(at) <= max(MOST_JUMPS_SHARE * told, told // LEAST_ROWS) and told >= LEAST_EXACT_ROWS
    if not few or rest > allowed or moved <= 2.0 * rows.quantum:
        return None
    return at, 1.0 - (rest / max(spread, 1e-300)) ** 2, x


def _within_what_is_left(rows: Rows, known: Known, x: Array, jumps: NDArray[np.intp]) -> Estimate:
    """Return the table's gains with what may be hidden in the little that they leave of OP.

    Where PV's noise goes through the gain to OP, the integral of a few minutes is as nothing, and so is a wrong one.
    """
    # between jumps OP may hold another constant
    between = np.isin(np.arange(len(rows.op)), jumps).cumsum()[rows.use]
    left, moved = (rows.op - x @ known.gains)[rows.use], x[rows.use, :3]
    count = np.maximum(np.bincount(between), 1)
    left = left - (np.bincount(between, left) / count)[between]
    moved = moved - np.column_stack([(np.bincount(between, m) / count)[between] for m in moved.T])
    independent = max(len(left) / correlation_time(left), 1.0)
    size = np.std(moved, axis=0) * math.sqrt(independent)
    sd = np.divide(np.std(left), size, out=np.full(3, math.inf), where=size > 0.0)
    there = known.gains[:3] != 0.0
    if_other = known.gains[:3].copy()  # what is left may be that of other gains
    if_other[there] += np.linalg.lstsq(moved[:, there], left, rcond=None)[0]
    return replace(Estimate.exact(known.gains), sd=np.where(there, sd, 0.0), if_noise=if_other)


def _other_weights(rows: Rows, known: Known, present: float, jumps: int) -> Known | None:
    """Return the law with the set-point weights that leave no jump at the set point's steps; None where none do."""
    for b, c in WEIGHTS:
        other = replace(known, b=b, c=c)
        found = _compared(rows, other, present) if (b, c) != (known.b, known.c) else None
        if found is not None and len(found[0]) < jumps and not np.any(np.diff(rows.sp)[found[0] - 1]):
            return other
    return None


def _at_odd_pace(case: Case) -> Controller | None:
    """Return what is said where the table explains OP at the moves of a controller whose pace is not the rows'.

    It ran between two rows: PV was that of the row before, or near to the row at which OP has moved. That it is slow
    shows in OP alone, so that its law need not be explained as well as at other times.
    """
    known, best = case.known, None
    for late in (1, 0):
        moved = replace(case, rows=case.rows.at_moves(late)).settled()
        if np.count_nonzero(moved.rows.use) < LEAST_EXACT_ROWS or moved.rows.quantum > 0.0:
            continue
        levels, moves = (explained(moved.rows, known, known.gains, NOWHERE, walk) for walk in (0.0, 1.0))
        if levels > PACED_LEVELS and moves > PACED_MOVES and (best is None or moves > best[0]):
            best = moves, levels, moved
    return None if best is None else _declared(best[2], NOWHERE, best[1])


def _set_point_said(case: Case) -> Controller | None:
    """Return what is said where the table's gains explain OP with another set point than the table and SP have it."""
    rows, known = case.rows, case.known
    if not np.any(np.diff(rows.sp)):
        return None
    squares = left_at(rows, known, known.gains, 1.0, NOWHERE) if _left_at_moves(rows, known) else 0.0
    for b, c in WEIGHTS:
        other = replace(known, b=b, c=c)
        better = left_at(rows, other, known.gains, 1.0, NOWHERE) < MUCH_BETTER * squares
        share = explained(rows, other, known.gains, NOWHERE, 0.0) if better else 0.0
        if share > WELL_EXPLAINED:
            return _weights_said(replace(case, known=other), known, share)
    inside = setpoint_inside(rows, known)
    return None if inside is None else case.controller(BESIDE, None, NOWHERE, 1.0, inside.words)


def _left_at_moves(rows: Rows, known: Known) -> bool:
    """Whether most of what the table leaves of OP's moves is left where the set point moves."""
    x = columns(rows.time, rows.sp, rows.pv, known.law(rows), 0.0, 0)
    left = np.diff(rows.op - x @ known.gains) ** 2 * (rows.use[1:] & rows.use[:-1])
    return bool(np.sum(left[np.diff(rows.sp) != 0]) > 0.5 * np.sum(left))


def _weights_said(case: Case, declared: Known, share: float) -> Controller:
    """Say that the set point acts otherwise than the table has it."""
    b, c = case.known.b, case.known.c
    name = {(1.0, 1.0): "PID", (1.0, 0.0): "PI-D", (0.0, 0.0): "I-PD"}[(b, c)]
    if not case.known.derivative:
        name = "I-P: no kick at a set-point step" if b == 0.0 else "PI"
    cause = f"OP behaves as with b = {b:g}, c = {c:g} ({name}), the table says {declared.b:.3g} and {declared.c:.3g}"
    return replace(case.controller(CONTRADICTED, None, NOWHERE, share, cause), setpoint_only=True)


def _jumps_said(sudden: NDArray[np.intp]) -> str:
    """Say that OP jumps by itself, where it does."""
    if len(sudden) == 0:
        return ""
    times = "once" if len(sudden) == 1 else f"{len(sudden)} times"
    return f"OP jumps {times} where neither set point nor PV moves: a feed-forward or an operator"


def _declared(
    case: Case, place: Place, share: float, cause: str = "", found: Estimate | None = None
) -> Controller:
    """Return what is said where the table holds, perhaps with a filter, a delay or a slow scan."""
    late = place.late * case.rows.period + case.late * case.recorded.period
    shown = []
    if place.filter_time > LEAST_FILTER_PERIODS * case.rows.period:
        shown.append(f"a PV filter of {place.filter_time:.3g} s")
    if late > 0:
        shown.append(f"a delay of {late:.3g} s")
    if len(case.rows) < len(case.recorded):
        shown.append(f"an execution (scan) each {case.rows.period:.3g} s")
    more = f"OP behaves as with {' and '.join(shown)}" if shown else ""
    said = BESIDE if shown else AS_DECLARED
    return case.controller(
        said, found, place if shown else NOWHERE, share, "; ".join(c for c in (more, cause) if c)
    )


def _searched(case: Case) -> Controller:
    """Return what is said where the table alone does not explain OP to rounding."""
    known = case.known
    whole = case.rows
    moved = _set_point_said(case)
    if moved is not None:
        return moved
    filtered = recorded_filter(whole, known)
    if filtered:
        words = f"PV is recorded through a filter of {filtered:.3g} s that the controller does not see"
        return case.controller(BESIDE, None, NOWHERE, 1.0, words)
    case, walk, best = free_fit(case)
    rows = case.rows
    share = explained(rows, known, known.gains, NOWHERE, 0.0)
    if not is_exact(rows, known, best):
        case, best = with_filter_found(case, best, walk)
    if is_exact(rows, case.known, best):
        known = case.known
        other = against(known, best, rows, exact=True) and (
            known.derivative or far(known, best) or is_exact(rows, known, best, VERY_LITTLE_SHARE)
        )
        if is_drawn(rows) or not other or intervals(best)[0].ratio > EXACT_RATIO:
            return _declared(case, NOWHERE, share, "", best)
        return _contradicted(case, best, share)
    s0 = left_at(rows, known, known.gains, walk, NOWHERE)
    table = placed(rows, known, known.gains, walk)
    s1 = left_at(rows, known, known.gains, walk, table)
    if s1 <= MUCH_BETTER * s0 and well(rows, known, known.gains, table):
        there = estimate(rows, known, walk, table)
        if there.place.squares > FAR_BETTER * s1 or not against(known, there, rows):
            return _declared(case, table, explained(rows, known, known.gains, table, 0.0))
        best = there
    free = estimate(rows, known, walk, placed(rows, known, FREE, walk))
    if free.place.squares <= FAR_BETTER * best.place.squares:
        best = free
    return _judged(case, whole, best, (share, min(s0, s1), walk))


def _judged(case: Case, whole: Rows, best: Estimate, facts: tuple[float, float, float]) -> Controller:
    """Return what is said where nothing is exact.

    ``facts`` are the share of OP that the table explains, the squares that it leaves at its best place, and the share
    of the walk; ``whole`` the rows with all jumps.
    """
    known, rows, (share, left, walk) = case.known, case.rows, facts
    other = against(known, best, rows)
    if not is_drawn(whole) and (other or explained(whole, known, best.gains, best.place, 1.0) < VERY_FINE):
        varying = varying_gain(whole, known, left_at(whole, known, FREE, 1.0, best.place))
        if varying:
            return case.controller(NOT_LINEAR, best, NOWHERE, share, varying)
    if share > WELL_EXPLAINED or (not other and intervals(best)[0].ratio < FAR_RATIO):
        return _declared(case, NOWHERE, share, "", best)
    far_better = left > best.place.squares / FAR_BETTER
    if other and far_better and far(known, best) and shown(rows, known, best, walk):
        return _contradicted(case, best, share)
    return case.controller(UNRESOLVED, best, NOWHERE, share)


def _contradicted(case: Case, found: Estimate, share: float) -> Controller:
    """Return what is said where other settings explain OP and those of the table do not."""
    seen = settings_of_gains(found.gains, case.known)
    if seen is None:
        return case.controller(UNRESOLVED, found, NOWHERE, share)
    kp, ti, td = intervals(found)
    # how a block integrates shifts kp by up to this share
    own = 1.0 + abs(float(found.gains[INTEGRAL] / found.gains[P])) * case.rows.period
    cause = cause_of(case.loop, seen, (kp.ratio * own, ti.ratio * own, td.ratio * own))
    return case.controller(CONTRADICTED, found, found.place, share, cause)
