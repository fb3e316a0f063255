"""What detection keeps of a loop, and the arrays that it keeps it in: layouts, every field with its unit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.contract.samples import Array
from monitor.health.observe import HEALTH

from .constants import BLOCK_SAMPLES, LEVELS, RING_SAMPLES

WARMING, QUIET, CANDIDATE, EVENT, MOVING = range(5)
"""Phases: without a baseline; at rest; a set point has begun to move; an event is open; a set point goes on moving."""
OPENED, CLOSED, STRETCH, BLOCK = 1, 2, 3, 4
"""What is handed out."""
COUNTS = ("ok", "uncertain", "bad_value", "bad_quality", "duplicate", "conflict", "late")
"""What became of a sample; `ok` includes `uncertain`, `duplicate` includes `conflict`."""

PARAM = np.dtype(
    [
        ("period", "f8"),  # as the table gives it, 0 where it does not [s]
        ("pv_min", "f8"),  # what PV and SP cannot fall below [PV]
        ("pv_max", "f8"),  # or exceed [PV]
        ("op_low", "f8"),  # OP's lower limit, -inf where there is none [OP]
        ("op_high", "f8"),  # and its upper one, inf where there is none [OP]
    ]
)
LAST = np.dtype(
    [
        ("time", "i8"),  # of the last good sample [ns since 1970]
        ("sp", "f8"),  # [PV]
        ("pv", "f8"),  # [PV]
        ("op", "f8"),  # held until the next sample [OP]
        ("auto", "i8"),  # 1 in automatic, 0 in manual
        ("pv_change", "f8"),  # from the sample before [PV]
        ("short_e", "f8"),  # short average of the error [PV]
    ]
)
CLOCK = np.dtype(
    [
        ("period", "f8"),  # of the samples, 0 while it is not known [s]
        ("gap_run", "i8"),  # gaps in a row
        ("least_gap", "f8"),  # the shortest of them [s]
        ("late_run", "i8"),  # late samples in a row
        ("late_at", "i8"),  # time of the last of them [ns since 1970]
        ("set_back", "i8"),  # times that the source's clock was set back
        ("bad_run", "i8"),  # bad samples since the last good one
        ("sp_missing_run", "i8"),  # samples in a row without a set point
    ]
)
ERROR = np.dtype(
    [
        ("mean_e", "f8"),  # mean of the error [PV]
        ("var_e", "f8"),  # its variance [PV^2]
        ("abs_e", "f8"),  # its mean size [PV]
        ("mean_s", "f8"),  # mean of its short average [PV]
        ("var_s", "f8"),  # and that one's variance [PV^2]
    ]
)
"""The error of a quiet loop."""
NOISE = np.dtype(
    [
        ("n", "i8"),  # quiet samples of which it is known
        ("least_n", "i8"),  # samples that must be exceeded before it counts as known
        ("snapshots", "i8"),  # how often it was kept
        ("outside_run", "i8"),  # samples in a row outside of the band
        ("unrest", "f8"),  # samples outside, less what those inside take off
        ("n_d", "i8"),  # second differences of PV since the loop began anew
        ("var_d", "f8"),  # their variance, 6 sigma^2 for white noise [PV^2]
        ("near_e", "f8"),  # mean of the error, of late [PV]
        ("near_var", "f8"),  # and its variance [PV^2]
        (
            "too_wide",
            "i8",
        ),  # looks in a row at which what is known was far wider than of late; -1: learnt anew
        ("quantum", "f8"),  # least change of PV that was seen [PV]
        ("now", ERROR),
        ("older", ERROR),  # at the snapshot before the last
        ("recent", ERROR),  # at the last snapshot
    ]
)
BASELINE = np.dtype(
    [
        ("n", "i8"),  # quiet samples in it
        ("began", "i8"),  # when the loop last began anew [ns since 1970]
        ("pv", "f8"),  # mean of PV at rest [PV]
        ("op", "f8"),  # mean of OP at rest [OP]
    ]
)
SETPOINT_MOVES = np.dtype(
    [
        ("level", "f8"),  # where it last rested or moved to [PV]
        ("came_from", "f8"),  # where it rested before it moved [PV]
        ("moved_at", "i8"),  # its last move [ns since 1970]
        ("moves", "i8"),  # samples at which it moved since it left its rest; 0 after an event
        ("pace", "f8"),  # mean time between its moves [periods]
        ("busy", "f8"),  # share of the samples at which it changes, of late
        ("jitter", "f8"),  # mean size of these changes [PV]
        ("beside", "i8"),  # 1 where its last move went beside a far larger one
        ("turns", "i8"),  # times that it turned since it left its rest
        ("way", "f8"),  # its last move, up or down [PV]
        ("next_way", "i8"),  # good samples from which a set point that goes on moving gets a window again
    ]
)
FATES = ("recorded", "in_noise", "cut_off", "in_manual", "beside", "unrecorded")
"""What became of a set point's moves: an event of its own; too small for the noise; a gap, a mode change or the loop's
beginning cut it off; made in manual; beside a far larger one, in whose event it is; or one of a set point that goes on
moving, of which only some stretches are recorded."""
OPEN_EVENT = np.dtype(
    [
        ("kind", "i8"),  # `SETPOINT_STEP`, `LOAD_STEP` or `SETPOINT_RAMP`
        ("number", "i8"),  # of the loop's events so far
        ("onset", "i8"),  # [ns since 1970]
        ("began", "i8"),  # when the loop had last begun anew [ns since 1970]
        ("end", "i8"),  # [ns since 1970]
        ("state", "i8"),  # how it ended, a place in `STATES`
        ("cause", "i8"),  # what cut it short, a place in `CAUSES`
        ("amplitude", "f8"),  # of the step, or the largest excursion of the error's short average [PV]
        ("quiet", "f8"),  # 1 where the loop was at rest before the onset
        ("pv0", "f8"),  # PV at rest before the onset [PV]
        ("op0", "f8"),  # OP at rest before the onset [OP]
        ("error_sd", "f8"),  # standard deviation of the error when quiet [PV]
        ("noise", "f8"),  # standard deviation of PV's white noise [PV]
        ("ok_before", "i8"),  # good samples before it
        ("uncertain_before", "i8"),  # and those of uncertain quality
    ]
)
SETTLING = np.dtype(
    [
        ("since", "i8"),  # since when the error's short average has lain still [ns since 1970]
        ("low", "f8"),  # the lowest that it was since [PV]
        ("high", "f8"),  # and the highest [PV]
        ("sum_e", "f8"),  # integral of the error since [PV s]
        ("sum_t", "f8"),  # and the time [s]
        ("half_waves", "i8"),  # times that it left to the other side
        ("side", "i8"),  # the side to which it left last: 1 upwards, -1 downwards
    ]
)
_INTEGRALS = [
    ("s1", "f8"),  # integral of OP from its rest [OP s]
    ("s2", "f8"),  # integral of s1 [OP s^2]
    ("y1", "f8"),  # integral of PV from its rest [PV s]
    ("iae", "f8"),  # integrated absolute error [PV s]
    ("iae_noise", "f8"),  # the noise's share of it [PV s]
    ("good_time", "f8"),  # time that good samples cover [s]
    ("saturated_time", "f8"),  # time that OP spent at a limit [s]
]
INTEGRALS = np.dtype(_INTEGRALS)
"""Over the open event, from its onset."""
POINTS = np.dtype(
    [
        ("slot", "i8"),  # of the slab that holds the open event's window, -1 without an event
        ("n", "i8"),  # points in it
        ("before", "i8"),  # of these, from before the onset
        ("stride", "i8"),  # samples from one point to the next
        ("skipped", "i8"),  # samples since the last point
    ]
)
LEVEL = np.dtype(
    [
        ("n", "i8"),  # values in the block
        ("start", "i8"),  # of its first value [ns since 1970]
        ("origin", "f8", (3,)),  # its first SP, PV and OP [PV], [PV], [OP]
    ]
)
BUFFER = np.dtype(
    [
        ("time", "i8"),  # of the last sample [ns since 1970]
        ("period", "f8"),  # of the samples in the blocks [s]
        ("clock", "f8"),  # time since the last value that is not yet one's own [s]
        ("sums", "f8", (3,)),  # of SP, PV and OP in the average that fills [PV], [PV], [OP]
        ("summed", "i8"),  # samples in them
        ("levels", LEVEL, (LEVELS,)),
    ]
)
STATE = np.dtype(
    [
        ("phase", "i8"),  # `WARMING` ... `MOVING`
        ("ring_n", "i8"),  # samples that went through the rings since the loop began anew
        ("next_stretch", "i8"),  # good samples from which a stretch is handed out again
        ("window", POINTS),
        ("last", LAST),
        ("clock", CLOCK),
        ("noise", NOISE),
        ("baseline", BASELINE),
        ("setpoint", SETPOINT_MOVES),
        ("moves", [(name, "i8") for name in FATES]),  # of the set point, by what became of them
        ("counts", [(name, "i8") for name in COUNTS]),  # samples, by what became of them
        ("event", OPEN_EVENT),
        ("settling", SETTLING),
        ("integrals", INTEGRALS),
        ("buffer", BUFFER),
    ]
)
"""A loop: its last sample, what is known of it when quiet, and its open event.

What every sample of a quiet loop touches stands first, beside each other: with many loops it has to come from memory.
"""

RINGS = np.dtype(
    [
        ("time", "i8", (RING_SAMPLES,)),  # of the last samples [ns since 1970]
        ("values", "f8", (RING_SAMPLES, 3)),  # their SP, PV and OP [PV], [PV], [OP]
        ("coarse_time", "i8", (RING_SAMPLES,)),  # of every eighth sample [ns since 1970]
        ("coarse", "f8", (RING_SAMPLES, 3)),  # its SP, PV, and OP as the mean over all [PV], [PV], [OP]
    ]
)
BLOCKS = np.dtype([("values", "f4", (LEVELS, BLOCK_SAMPLES, 3))])
"""The blocks that fill, less their origin: SP, PV and OP [PV], [PV], [OP]."""

OUT = np.dtype(
    [
        ("what", "i8"),  # `OPENED`, `CLOSED`, `STRETCH` or `BLOCK`
        ("row", "i8"),  # of the loop
        ("slot", "i8"),  # of its window
        ("points", "i8"),  # of its window
        ("before", "i8"),  # of these, from before the onset
        *((name, "i8") for name in ("number", "kind", "state", "cause", "onset", "end")),
        *((name, "f8") for name in ("amplitude", "duration", "offset", "quiet", "period", "uncertain_share")),
        ("since_start", "f8"),
        *((name, "f8") for name in ("error_sd", "short_sd", "noise", "quantum", "pv0", "op0")),
        *_INTEGRALS,
        ("health", HEALTH),  # of a closed event: the loop's at that moment
    ]
)
"""What the kernel hands out, in the units of `event.ClosedEvent`; an opening fills in only what `Opened` says, a
stretch and a block what `Stretch` and `Block` say."""


class Stores(NamedTuple):
    """Detection's arrays: L loops, S windows of open events, M rows for what is handed out.

    All of a loop is in records: where a function of each sample took the arrays themselves, counting who holds them
    would cost more than the sample.
    """

    param: NDArray[np.void]
    """(L,) dtype `PARAM`."""
    state: NDArray[np.void]
    """(L,) dtype `STATE`."""
    health: NDArray[np.void]
    """(L,) dtype `HEALTH`."""
    rings: NDArray[np.void]
    """(L,) dtype `RINGS`."""
    blocks: NDArray[np.void]
    """(L,) dtype `BLOCKS`."""
    slab: Array
    """(S, WINDOW_POINTS, 4) windows of open events: time from the onset [s], SP [PV], PV [PV], OP [OP]."""
    free: NDArray[np.int64]
    """(S,) slots of the slab that are free: the first ``n_free[0]``."""
    n_free: NDArray[np.int64]
    """(1,)"""
    out: NDArray[np.void]
    """(M,) dtype `OUT`: what opened and closed."""
