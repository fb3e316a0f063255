"""The controller, seen in the data: what settings, filter, delay and pace of execution explain OP by SP and PV.

From the cheapest question to the dearest: does the table explain OP to rounding, as it is; do other gains; does the
table with a PV filter or a delay; do other gains with these. A table is contradicted only where other gains explain OP
far better, and where its own lie outside of what the data allow: beyond four standard deviations, beyond what noise in
PV that the controller did not see could hide, and beyond what the way in which a block integrates may shift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

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
    VERY_LITTLE_SHARE,
    Estimate,
    Known,
    Place,
    estimate,
    explained,
    is_exact,
    left_at,
    placed,
    trimmed,
    walk_share,
)
from .controller_judge import (
    NARROW_RATIO,
    NARROW_TIME_RATIO,
    VERY_FINE,
    WELL_EXPLAINED,
    against,
    far,
    is_drawn,
    shown,
    well,
)
from .controller_law import INTEGRAL, D, P, columns, compared
from .controller_other import WEIGHTS, setpoint_inside, varying_gain, with_derivative
from .controller_rows import LEAST_ROWS, Rows, lay_out
from .controller_seen import (
    AS_DECLARED,
    BESIDE,
    CONTRADICTED,
    FOUND,
    NOT_LINEAR,
    UNRESOLVED,
    Controller,
    intervals,
)

FAR_BETTER, MUCH_BETTER = 0.25, 0.1
"""Share of the squares that is left where other gains are taken for the true ones; where a filter or a delay is."""
LEAST_EXACT_ROWS = 7
"""Rows that show a law that leaves nothing."""
FORGETS_LN = 9.0
"""Of the share to which the derivative filter\'s unknown start fades, until its rows count."""
LEAST_FILTER_PERIODS = 0.05
"""A PV filter shorter than this is none."""
LEAST_TD_PERIODS = 2.0
"""Sample periods from which a derivative that nobody declared is one: a shorter one may be coarse sampling."""
FAR_RATIO = 2.0
"""Ratio to the ends of its interval from which kp is hardly known."""
NOWHERE = Place(0.0, 0.0, 0.0)
FREE = np.full(4, np.nan)


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """Rows, as recorded and at which the controller ran, and the law that is asked for."""

    rows: Rows
    recorded: Rows
    loop: Loop
    known: Known
    late: int = 0
    """Rows as recorded by which OP follows its inputs, within a run of a slow controller."""

    def settled(self) -> Case:
        """Return the case without the first rows, in which the derivative's unknown start is seen."""
        if not self.known.derivative:
            return self
        use = self.rows.use.copy()
        period, tf = self.rows.period, self.known.tf
        fading = FORGETS_LN / math.log1p(period / tf) if tf > 0 else 0.0
        use[: min(2 + math.ceil(fading), len(use) // 4)] = False
        return replace(self, rows=replace(self.rows, use=use))

    def controller(
        self, said: str, found: Estimate | None, place: Place, share: float, cause: str = ""
    ) -> Controller:
        """Return what is said, of settings as found or, without, of the table's."""
        exact = Estimate.exact(self.known.gains) if found is None else found
        kp, ti, td = intervals(exact)
        if said in {AS_DECLARED, BESIDE}:  # what the discretisation may shift is no difference
            exact = Estimate.exact(self.known.gains)
            kp, ti, td = (i.including(o) for i, o in zip((kp, ti, td), intervals(exact), strict=True))
        return Controller(
            said=said,
            settings=None if said == UNRESOLVED else settings_of_gains(exact.gains, self.known),
            kp=kp,
            ti=ti,
            td=td,
            explained=min(max(share, 0.0), 1.0),
            pv_filter=place.filter_time,
            op_delay=place.late * self.rows.period + self.late * self.recorded.period,
            scan=self.rows.period if self.rows.stride == 1 else self.rows.period / self.rows.stride,
            period=self.recorded.period / self.recorded.stride,
            cause=cause,
        )


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
    found = None
    for case in [*paced[:1], as_recorded]:
        if len(case.rows) >= LEAST_ROWS and (found is None or found.said == UNRESOLVED):
            found = _searched(case.settled()) if known.given else _without_table(case)
    return found


def known_of(loop: Loop) -> Known:
    """Return the table's settings as a law in standard form; without any, those of a PI that is not known."""
    own = loop.settings
    if own is None:
        return Known(1.0, 1.0, 0.0, 0.0, 1.0, 1.0, derivative=False, given=False)
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
        at, share = found
        moved = at[np.diff(rows.sp)[at - 1] != 0]
        other = _other_weights(rows, known, present, len(at)) if len(moved) else None
        if other is not None:
            return _weights_said(replace(case, known=other), known, share)
        return _declared(case, NOWHERE, share, _jumps_said(np.setdiff1d(at, moved)))
    return None


def _compared(rows: Rows, known: Known, present: float) -> tuple[NDArray[np.intp], float] | None:
    """Return the rows at which OP jumps, and the share that the law explains beside; None where it is not exact."""
    x = columns(rows.time, rows.sp, rows.pv, known.law(rows, present), 0.0, 0)
    share = EXACT_SHARE if rows.stride == 1 else THINNED_SHARE
    jump, rest, allowed, moved, spread = compared(
        x, known.gains, rows.op, rows.use, rows.fresh, share, rows.quantum
    )
    told, at = np.count_nonzero(rows.use), np.flatnonzero(jump)
    few = len(at) <= max(MOST_JUMPS_SHARE * told, told // LEAST_ROWS) and told >= LEAST_EXACT_ROWS
    if not few or rest > allowed or moved <= 2.0 * rows.quantum:
        return None
    return at, 1.0 - (rest / max(spread, 1e-300)) ** 2


def _other_weights(rows: Rows, known: Known, present: float, jumps: int) -> Known | None:
    """Return the law with the set-point weights that leave no jump at the set point's steps; None where none do."""
    for b, c in WEIGHTS:
        other = replace(known, b=b, c=c)
        found = _compared(rows, other, present) if (b, c) != (known.b, known.c) else None
        if found is not None and len(found[0]) < jumps and not np.any(np.diff(rows.sp)[found[0] - 1]):
            return other
    return None


def _set_point_said(case: Case) -> Controller | None:
    """Return what is said where the table's gains explain OP with another set point than the table and SP have it."""
    rows, known = case.rows, case.known
    if not np.any(np.diff(rows.sp)):
        return None
    squares = left_at(rows, known, known.gains, 1.0, NOWHERE)
    for b, c in WEIGHTS:
        other = replace(known, b=b, c=c)
        better = left_at(rows, other, known.gains, 1.0, NOWHERE) < MUCH_BETTER * squares
        share = explained(rows, other, known.gains, NOWHERE, 0.0) if better else 0.0
        if share > WELL_EXPLAINED:
            return _weights_said(replace(case, known=other), known, share)
    inside = setpoint_inside(rows, known)
    return None if inside is None else case.controller(BESIDE, None, NOWHERE, 1.0, inside.words)


def _weights_said(case: Case, declared: Known, share: float) -> Controller:
    """Say that the set point acts otherwise than the table has it."""
    b, c = case.known.b, case.known.c
    name = {(1.0, 1.0): "PID", (1.0, 0.0): "PI-D", (0.0, 0.0): "I-PD"}[(b, c)]
    if not case.known.derivative:
        name = "I-P: no kick at a set-point step" if b == 0.0 else "PI"
    cause = f"OP behaves as with b = {b:g}, c = {c:g} ({name}), the table says {declared.b:.3g} and {declared.c:.3g}"
    return case.controller(CONTRADICTED, None, NOWHERE, share, cause)


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
    rows = trimmed(whole, known.law(whole), known.active, 4.0 * whole.quantum)
    case = replace(case, rows=rows)
    walk = walk_share(rows, known.law(rows), known.active, FREE)
    share = explained(rows, known, known.gains, NOWHERE, 0.0)
    best = estimate(rows, known, walk, NOWHERE)
    if not is_exact(rows, known, best):
        case, best = _with_filter_found(case, best, walk)
    if is_exact(rows, case.known, best):
        known = case.known
        other = against(known, best, rows, exact=True) and (
            known.derivative or far(known, best) or is_exact(rows, known, best, VERY_LITTLE_SHARE)
        )
        if is_drawn(rows) or not other:
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
    if other or explained(whole, known, best.gains, best.place, 1.0) < VERY_FINE:
        varying = varying_gain(whole, known, left_at(whole, known, FREE, 1.0, best.place))
        if varying:
            return case.controller(NOT_LINEAR, best, NOWHERE, share, varying)
    if not other:
        if share > WELL_EXPLAINED or intervals(best)[0].ratio < FAR_RATIO:
            return _declared(case, NOWHERE, share, "", best)
    elif left > best.place.squares / FAR_BETTER and far(known, best) and shown(rows, known, best, walk):
        return _contradicted(case, best, share)
    return case.controller(UNRESOLVED, best, NOWHERE, share)


def _with_filter_found(case: Case, best: Estimate, walk: float) -> tuple[Case, Estimate]:
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


def settings_of_gains(gains: Array, known: Known) -> Settings | None:
    """Return gains as settings in standard form, with the filter and weights of the law; None where they are none."""
    kp, ki, kd = (float(g) for g in gains[:3])
    if kp == 0 or ki / kp < 0:
        return None
    td = max(kd / kp, 0.0)
    return Settings(
        kp, kp / ki if ki else math.inf, td, known.tf if td > 0 else 0.0, "standard", known.b, known.c
    )


def _without_table(case: Case) -> Controller:
    """Return what is seen of a controller of which the table says nothing."""
    known = case.known
    rows = trimmed(case.rows, known.law(case.rows), known.active, 4.0 * case.rows.quantum)
    case = replace(case, rows=rows)
    walk = walk_share(rows, known.law(rows), known.active, FREE)
    found = estimate(rows, known, walk, NOWHERE)
    if not is_exact(rows, known, found):
        case, found = _with_filter_found(case, found, walk)
        known = case.known
    if not is_exact(rows, known, found):
        free = estimate(rows, known, walk, placed(rows, known, FREE, walk))
        found = free if free.place.squares <= FAR_BETTER * found.place.squares else found
    kp, ti, _ = intervals(found)
    seen = settings_of_gains(found.gains, known)
    share = explained(rows, known, found.gains, found.place, 0.0)
    clear = share > WELL_EXPLAINED and kp.ratio < NARROW_RATIO and ti.ratio < NARROW_TIME_RATIO
    if seen is None or not clear or is_drawn(rows):
        return case.controller(UNRESOLVED, found, NOWHERE, share)
    return case.controller(FOUND, found, found.place, share)
