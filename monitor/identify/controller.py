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

from .controller_cause import cause_of, same
from .controller_fit import (
    EXACT_SHARE,
    MOST_JUMPS_SHARE,
    THINNED_SHARE,
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
from .controller_law import INTEGRAL, D, P, columns, compared
from .controller_rows import LEAST_ROWS, Rows, lay_out
from .controller_seen import (
    AS_DECLARED,
    BESIDE,
    CONTRADICTED,
    FOUND,
    UNRESOLVED,
    Controller,
    intervals,
)

FAR_BETTER = 0.25
"""Share of the squares that is left where another law is taken for the true one."""
MUCH_BETTER = 0.1
"""The same for a PV filter or a delay."""
WELL_EXPLAINED, FINE, VERY_FINE = 0.98, 0.8, 0.98
"""Shares of OP's levels, and of its moves from row to row, that such a law must explain; of moves, with a filter."""
STRAIGHT_SHARE, MOST_STRAIGHT_SHARE = 1e-9, 0.5
"""Share of OP's range by which it may bend and still be straight; share of rows from which it was drawn straight."""
LEAST_DELAY_PERIODS = 0.25
"""A filter and a delay together that add less than this are none."""
FAR_SD = 4.0
"""Standard deviations from which a gain is another one."""
SLACK_SHARE, EXACT_SLACK_SHARE = 0.01, 0.003
"""Share of a gain that is no difference; where the law is exact."""
DERIVATIVE_SLACK_SHARE, EXACT_DERIVATIVE_SLACK_SHARE = 0.3, 0.02
"""The same of kd, which a block's filter and way of taking differences shift."""
LEAST_EXACT_ROWS = 7
"""Rows that show a law that leaves nothing."""
FORGETS_FILTERS = 8.0
"""Derivative filter times after which its unknown start is forgotten."""
LEAST_FILTER_PERIODS = 0.05
"""A PV filter shorter than this is none."""
NARROW_RATIO, NARROW_TIME_RATIO = 1.15, 1.25
"""Ratio to the ends of their intervals up to which kp and ti are known."""
FAR_RATIO = 2.0
"""Ratio to the ends of its interval from which kp is hardly known."""
FAR_KP_RATIO, FAR_TI_RATIO = 1.15, 1.25
"""Ratios from which inexact gains are other ones."""
LEAST_QUANTA = 12.0
"""Steps of a rounded OP over which it must range to show its law."""
MOVES_WITH_DERIVATIVE = 0.999
"""Share of OP's moves that is explained where the samples show a derivative."""
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
        use[: 2 + math.ceil(FORGETS_FILTERS * tf / (tf + period))] = False
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
        x = columns(rows.time, rows.sp, rows.pv, known.law(rows, present), 0.0, 0)
        share = EXACT_SHARE if rows.stride == 1 else THINNED_SHARE
        jump, rest, allowed, moved, spread = compared(
            x, known.gains, rows.op, rows.use, rows.fresh, share, rows.quantum
        )
        told = np.count_nonzero(rows.use)
        few = (
            np.count_nonzero(jump) <= max(MOST_JUMPS_SHARE * told, told // LEAST_ROWS)
            and told >= LEAST_EXACT_ROWS
        )
        if few and rest <= allowed and moved > 2.0 * rows.quantum:
            at = np.flatnonzero(jump)
            return _declared(case, NOWHERE, 1.0 - (rest / max(spread, 1e-300)) ** 2, _jumps_said(rows, at))
    return None


def _jumps_said(rows: Rows, at: NDArray[np.intp]) -> str:
    """Say that OP jumps by itself, where it does."""
    moved = np.zeros(len(rows), bool)
    moved[1:] = np.diff(rows.sp) != 0
    sudden = at[~moved[at]]
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
    rows = trimmed(case.rows, known.law(case.rows), known.active, 4.0 * case.rows.quantum)
    case = replace(case, rows=rows)
    walk = walk_share(rows, known.law(rows), known.active, FREE)
    share = explained(rows, known, known.gains, NOWHERE, 0.0)
    s0 = left_at(rows, known, known.gains, walk, NOWHERE)
    here = estimate(rows, known, walk, NOWHERE)
    if is_exact(rows, known, here):
        if against(known, here, rows, exact=True):
            return _contradicted(case, here, share)
        return _declared(case, NOWHERE, share, "", here)
    table = placed(rows, known, known.gains, walk)
    s1 = left_at(rows, known, known.gains, walk, table)
    best = here
    if s1 <= MUCH_BETTER * s0 and _well(rows, known, known.gains, table):
        there = estimate(rows, known, walk, table)
        if there.place.squares > FAR_BETTER * s1 or not against(known, there, rows):
            return _declared(case, table, explained(rows, known, known.gains, table, 0.0))
        best = there
    free = estimate(rows, known, walk, placed(rows, known, FREE, walk))
    if free.place.squares <= FAR_BETTER * best.place.squares:
        best = free
    if not against(known, best, rows):
        sure = intervals(best)[0].ratio < FAR_RATIO or share > WELL_EXPLAINED
        return (
            _declared(case, NOWHERE, share, "", best)
            if sure
            else case.controller(UNRESOLVED, best, NOWHERE, share)
        )
    far_better = min(s0, s1) > best.place.squares / FAR_BETTER
    if far_better and _far(known, best) and _shown(case, best):
        return _contradicted(case, best, share)
    return case.controller(UNRESOLVED, best, NOWHERE, share)


def _far(known: Known, found: Estimate) -> bool:
    """Whether gains lie so far from the table's that no way of recording explains it."""
    kp, ki = float(found.gains[P]), float(found.gains[INTEGRAL])
    if known.ki == 0:
        return True
    return not same(kp, known.kp, FAR_KP_RATIO) or not same(ki / known.ki, kp / known.kp, FAR_TI_RATIO)


def _shown(case: Case, found: Estimate) -> bool:
    """Whether the recording shows the controller well enough to contradict a table.

    A derivative lives on what PV does from sample to sample: where a controller runs faster than the samples come, it
    is taken for a large gain. Only where hardly anything is left of OP's moves, and the derivative time is the table's
    (or in minutes), has it been recorded.
    """
    rows, known = case.rows, case.known
    if np.ptp(rows.op[rows.use]) < LEAST_QUANTA * rows.quantum:
        return False
    levels, moves = (explained(rows, known, found.gains, found.place, walk) for walk in (0.0, 1.0))
    if known.derivative:
        td = float(found.gains[D] / found.gains[P]) / (known.kd / known.kp) if known.kd else 1.0
        return moves > MOVES_WITH_DERIVATIVE and any(same(td, times, FAR_KP_RATIO) for times in (1.0, 60.0))
    kp, ti, _ = intervals(found)
    return levels > WELL_EXPLAINED and (
        moves > FINE or (kp.ratio < NARROW_RATIO and ti.ratio < NARROW_TIME_RATIO)
    )


def _well(rows: Rows, known: Known, gains: Array, place: Place) -> bool:
    """Whether gains explain OP's levels, and its moves from row to row, with a filter or delay that adds dead time.

    Noise that the controller did not see, and a historian that draws straight lines, look like a filter, too, but leave
    more of the moves.
    """
    if place.filter_time + place.late * rows.period < LEAST_DELAY_PERIODS * rows.period:
        return False
    levels = explained(rows, known, gains, place, 0.0)
    if np.mean(np.abs(np.diff(rows.op, 2)) < STRAIGHT_SHARE * np.ptp(rows.op)) > MOST_STRAIGHT_SHARE:
        return False
    return levels > WELL_EXPLAINED and explained(rows, known, gains, place, 1.0) > VERY_FINE


def against(known: Known, found: Estimate, rows: Rows, *, exact: bool = False) -> bool:
    """Whether the table's gains lie outside of what the data allow, and of what a block's own ways may shift.

    A block may count the present error to its integral, the last one, or half of each: kp then shifts by ``ki dt``, or
    half of it.
    """
    shift = float(found.gains[INTEGRAL]) * rows.period
    slack = EXACT_SLACK_SHARE if exact else SLACK_SHARE
    for which, declared in ((P, known.kp), (INTEGRAL, known.ki), (D, known.kd)):
        if which == D and not known.derivative:
            continue
        low, high = found.ends(which, FAR_SD)
        allowed = slack * max(abs(declared), abs(float(found.gains[which])) if declared == 0 else 0.0)
        shifts: tuple[float, ...] = (0.0,)
        if which == D:
            allowed = (EXACT_DERIVATIVE_SLACK_SHARE if exact else DERIVATIVE_SLACK_SHARE) * abs(declared)
        elif which == P and exact and known.derivative:
            shifts = (-1.0, -0.5, 0.0, 0.5, 1.0)
        elif which == P:
            allowed += abs(shift)
        if not any(low - allowed <= declared + s * shift <= high + allowed for s in shifts):
            return True
    return False


def _contradicted(case: Case, found: Estimate, share: float) -> Controller:
    """Return what is said where other settings explain OP and those of the table do not."""
    seen = settings_of_gains(found.gains, case.known)
    if seen is None:
        return case.controller(UNRESOLVED, found, NOWHERE, share)
    kp, ti, td = intervals(found)
    cause = cause_of(case.loop, seen, (kp.ratio, ti.ratio, td.ratio))
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
        free = estimate(rows, known, walk, placed(rows, known, FREE, walk))
        found = free if free.place.squares <= FAR_BETTER * found.place.squares else found
    kp, ti, _ = intervals(found)
    seen = settings_of_gains(found.gains, known)
    share = explained(rows, known, found.gains, found.place, 0.0)
    clear = share > WELL_EXPLAINED and kp.ratio < NARROW_RATIO and ti.ratio < NARROW_TIME_RATIO
    return case.controller(FOUND if clear and seen is not None else UNRESOLVED, found, found.place, share)
