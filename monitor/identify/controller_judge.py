"""When a table is contradicted, and when a filter or a delay is believed: what the recording must show for it."""

from __future__ import annotations

import numpy as np

from monitor.contract.samples import Array

from .controller_cause import same
from .controller_fit import Estimate, Known, Place, estimate, explained
from .controller_law import INTEGRAL, D, P
from .controller_rows import LEAST_ROWS, Rows
from .controller_seen import intervals

WELL_EXPLAINED, FINE, VERY_FINE = 0.98, 0.8, 0.98
"""Shares of OP's levels, and of its moves from row to row, that a law must explain; of moves, with a filter."""
STRAIGHT_SHARE, MOST_STRAIGHT_SHARE = 1e-6, 0.5
"""Share of its slope by which OP may bend and still be straight; share of rows from which it was drawn straight."""
LEAST_DELAY_PERIODS = 0.25
"""A filter and a delay together that add less than this are none."""
FAR_SD = 4.0
"""Standard deviations from which a gain is another one."""
SLACK_SHARE, EXACT_SLACK_SHARE = 0.01, 0.003
"""Share of a gain that is no difference; where the law is exact."""
DERIVATIVE_SLACK_SHARE, EXACT_DERIVATIVE_SLACK_SHARE = 0.3, 0.02
"""The same of kd, which a block's filter and way of taking differences shift."""
NARROW_RATIO, NARROW_TIME_RATIO = 1.15, 1.25
"""Ratio to the ends of their intervals up to which kp and ti are known."""
FAR_KP_RATIO, FAR_TI_RATIO = 1.3, 2.0
"""Ratios from which inexact gains are other ones."""
LEAST_QUANTA = 12.0
"""Steps of a rounded OP over which it must range to show its law."""
MOVES_WITH_DERIVATIVE = 0.999
"""Share of OP's moves that is explained where the samples show a derivative."""
LEAST_MOVE_SHARE = 1e-4
"""Share of OP's range from which it moves."""
HALVES_KP_RATIO, HALVES_KI_RATIO = 1.25, 2.0
"""Ratios up to which gains seen in either half of the rows are those of one controller."""


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
        low, high = found.farthest(which, FAR_SD)
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


def far(known: Known, found: Estimate) -> bool:
    """Whether gains lie so far from the table's that no way of recording explains it."""
    kp, ki = float(found.gains[P]), float(found.gains[INTEGRAL])
    if known.ki == 0:
        return True
    return not same(kp, known.kp, FAR_KP_RATIO) or not same(ki / known.ki, kp / known.kp, FAR_TI_RATIO)


def shown(rows: Rows, known: Known, found: Estimate, walk: float) -> bool:
    """Whether the recording shows the controller well enough to contradict a table.

    A derivative lives on what PV does from sample to sample: where a controller runs faster than the samples come, it
    is taken for a large gain. Only where hardly anything is left of OP's moves, and the derivative time is the table's
    (or in minutes), has it been recorded. And both halves of the rows must show the same controller: another one that
    takes over, or a gain that depends on the error, is none of the table's numbers.
    """
    if float(np.ptp(rows.op[rows.use])) < LEAST_QUANTA * rows.quantum or is_drawn(rows):
        return False
    levels, moves = (explained(rows, known, found.gains, found.place, share) for share in (0.0, 1.0))
    placed = found.place.filter_time > 0 or found.place.late != 0
    if moves < VERY_FINE and (placed or (rows.stride == 1 and np.any(np.diff(rows.sp)))):
        return False  # a delay, or a set point that acts otherwise, bends gains that explain less
    if known.derivative:
        td = float(found.gains[D] / found.gains[P]) / (known.kd / known.kp) if known.kd else 1.0
        return moves > MOVES_WITH_DERIVATIVE and any(same(td, times, FAR_KP_RATIO) for times in (1.0, 60.0))
    kp, ti, _ = intervals(found)
    narrow = kp.ratio < NARROW_RATIO and ti.ratio < NARROW_TIME_RATIO
    return levels > WELL_EXPLAINED and (moves > FINE or narrow) and _in_both_halves(rows, known, found, walk)


def _in_both_halves(rows: Rows, known: Known, found: Estimate, walk: float) -> bool:
    """Whether each half of the rows, of those in which OP moves, shows the gains found, as far as it shows any."""
    moves: Array = np.abs(np.diff(rows.op, prepend=rows.op[0]))
    least = LEAST_MOVE_SHARE * float(np.ptp(rows.op))
    middle = int(np.median(np.flatnonzero(rows.use & (moves > least))))
    kp, ki = float(found.gains[P]), float(found.gains[INTEGRAL])
    for part in (slice(0, middle), slice(middle, len(rows))):
        half = rows.part(part)
        if np.count_nonzero(half.use) < LEAST_ROWS:
            continue
        own = estimate(half, known, walk, found.place)
        (low, high), (ki_low, ki_high) = own.ends(P, FAR_SD), own.ends(INTEGRAL, FAR_SD)
        if not low <= kp <= high and not same(float(own.gains[P]), kp, HALVES_KP_RATIO):
            return False
        if not ki_low <= ki <= ki_high and not same(float(own.gains[INTEGRAL]), ki, HALVES_KI_RATIO):
            return False
    return True


def well(rows: Rows, known: Known, gains: Array, place: Place) -> bool:
    """Whether gains explain OP's levels, and its moves from row to row, with a filter or delay that adds dead time.

    Noise that the controller did not see, and a historian that draws straight lines, look like a filter, too, but leave
    more of the moves.
    """
    if place.filter_time + place.late * rows.period < LEAST_DELAY_PERIODS * rows.period or is_drawn(rows):
        return False
    levels = explained(rows, known, gains, place, 0.0)
    return levels > WELL_EXPLAINED and explained(rows, known, gains, place, 1.0) > VERY_FINE


def is_drawn(rows: Rows) -> bool:
    """Whether OP consists of straight lines, as a historian draws them between the values that it kept."""
    moves: Array = np.diff(rows.op)
    moving = moves[1:] != 0
    straight = np.abs(np.diff(moves)) < STRAIGHT_SHARE * np.abs(moves[1:])
    return bool(
        np.count_nonzero(straight & moving) > MOST_STRAIGHT_SHARE * max(int(np.count_nonzero(moving)), 1)
    )
