"""What the streaming kernel keeps of a loop and hands out: constants with their reasons, and record layouts."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

jit: Any = numba.njit(cache=True, error_model="numpy")
"""Compiled, cached on disk; 0/0 is NaN as in NumPy."""

WARM_UP = 20
"""Quiet samples before a baseline is trusted: the mean of 20 has 0.22 of one sample's noise."""
RING = 128
"""Samples kept from before an event: baseline for the fit, and the picture's left margin."""
COARSE = 8
"""Samples in a point of the coarse ring, which reaches this many times further back: a load step on a sluggish
loop is noticed long after it came."""
SNAPSHOT = 64
"""Samples between two looks at the noise. A load step is suspected against the noise of one to two looks ago, which
a slow response has not yet widened."""
LEAST_BEFORE = 8
"""Samples of the window from before the onset, even where the loop was not at rest."""
WINDOW = 1024
"""Points of an event's window; when full, every second one is dropped."""
MAX_GAP = 3.5
"""Sample periods; above it nothing is integrated across (three periods and jitter)."""
STEP_MOVES = 5
"""A set point that moves for more samples than these is a ramp or a cascade's, not a step smeared by a historian."""
STEP_REST = 3
"""Periods for which a set point must rest before its move counts as finished."""
RAMP_REST = 20
"""Periods for which a moving set point must rest before the loop is looked at again."""
TRIGGER = 5.0
"""Standard deviations of the short average, when quiet, by which it must leave its mean to suspect a load step."""
KNOWN = 60
"""Quiet samples before a load step may be suspected; with few, the band is wider (their spread is not well known)."""
AWAY = 500
"""Samples outside its band after which a loop's baseline begins anew."""
TIMEOUT = 10_000
"""Periods after which an event is given up."""
SHORT = 0.2
"""Weight of the short average of the error, per period (about five samples)."""
LONG = 0.002
"""Weight of its long-run mean and variance (about 500 samples)."""
BASE = 0.005
"""Weight of the baseline's PV and OP (about 200 samples)."""
TOO_LARGE = 1e30
"""A magnitude that no plant has: a gateway's placeholder."""

WARMING, QUIET, CANDIDATE, EVENT, MOVING = range(5)
DROP, CONFIRM, DONE, CUT, BEGIN, BEGIN_LOAD = 1, 2, 4, 8, 16, 32
"""What to do with a loop's window: forget it, report it open, hand it out (with or without this sample), open one."""
OPENED, CLOSED = 1, 2
SETPOINT_STEP, LOAD_STEP = 0, 1
SETTLED, INTERRUPTED, TIMED_OUT = "settled", "interrupted", "timeout"
STATES = ("", SETTLED, INTERRUPTED, TIMED_OUT)
CAUSES = (
    "",
    "the set point moved again",
    "a gap in the data",
    "a change to manual",
    "the end of the data",
    "a change of settings",
)
BY_STEP, BY_GAP, BY_MODE, BY_END, BY_SETTINGS = range(1, 6)

COUNTS = ("ok", "uncertain", "bad_value", "bad_quality", "duplicate", "conflict", "late")
"""What became of a sample; `ok` includes `uncertain`, `duplicate` includes `conflict`."""

_f, _i = np.float64, np.int64
_INTEGRALS = [(name, _f) for name in ("s1", "s2", "s3", "y1", "y2", "iae", "iae_noise", "good", "saturated")]
_BASELINE = [(name, _f) for name in ("pv0", "op0", "sd_e", "noise")]

PARAM = np.dtype([("period", _f), ("pv_min", _f), ("pv_max", _f), ("op_low", _f), ("op_high", _f)])

_NOISE = ("mean_e", "var_e", "abs_e", "mean_s", "var_s")
"""The error's mean, variance and mean size when quiet, and mean and variance of its short average [PV]."""
_FACTS = "phase time seen warm based away ringed looks slot auto kind moved moves events".split()
_EVENT = "onset still end end_state end_cause points before stride skipped".split()
_SHAPE = "amplitude held low high sum_e sum_t quiet sp_from".split()
_LAST = "sp pv op dpv period short mean_pv mean_op var_d quantum".split()

STATE = np.dtype(
    [
        *[(n, _i) for n in (*_FACTS, *_EVENT, *COUNTS)],
        *[(n, _f) for n in (*_LAST, *_SHAPE, *_NOISE)],
        # the noise at the last look, and at the one before
        *[(f"{n}_{k}", _f) for k in (1, 2) for n in _NOISE],
        *_INTEGRALS,
        *_BASELINE,
    ]
)

EVENT_OUT = [
    *[
        (n, _i)
        for n in (
            "what",
            "loop",
            "kind",
            "state",
            "cause",
            "slot",
            "points",
            "before",
            "onset",
            "end",
            "number",
        )
    ],
    *[(n, _f) for n in ("amplitude", "wall", "quiet", "offset", "period", "sp_from", "quantum")],
    *_INTEGRALS,
    *_BASELINE,
]
"""Fields of an event handed out."""
