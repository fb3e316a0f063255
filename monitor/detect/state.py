"""What the streaming kernel keeps of a loop and hands out: constants with their reasons, and record layouts."""

from __future__ import annotations

import numpy as np

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
"""A set point that moves at more samples than these is a ramp or a cascade's, not a step smeared by a historian or
clicked together by an operator."""
STEP_LASTS = 20
"""Periods that such a step may take from its first move to its last."""
STEP_REST = 7
"""Periods for which a set point must rest before its move counts as finished: masters scan every 1 to 5 s."""
RAMP_REST = 20
"""Periods for which a moving set point must rest before the loop is looked at again."""
RAMP_CALM = 200
"""Samples without a break for which the error must be quiet after a ramp before a load step may be suspected: the
ramp's end travels round the loop, too, and swings through zero."""
RESTLESS = 100.0
"""Periods between the moves of a set point, on average, below which a master moves it (those of model-predictive
controllers run once a minute), and nobody's step."""
PATIENCE = 5.0
"""Of these averages a restless set point must rest before it counts as resting."""
PACE = 300.0
"""Periods that count for a longer rest in that average, so that an operator's step after a long ramp is one."""
SAME_LEVEL = 0.5
"""Standard deviations of the error within which a set point is still where it was: jitter of an analog signal."""
ROUNDING = 2e-7
"""A set point's relative change that is nothing but a float of 32 bits."""
STEP_STANDS_OUT = 3.0
"""Standard deviations of the error, and least changes of PV, that a set-point step must exceed."""
TRIGGER = 5.0
"""Standard deviations of the short average, when quiet, by which it must leave its mean to suspect a load step."""
LOAD_STANDS_OUT = 8.0
"""Standard deviations of the short average, when quiet, that a load step must reach to be handed out: a wandering
load brings as much once in some loop-weeks."""
LOAD_QUANTA = 2.5
"""Least changes of PV that it must reach: a transmitter's last bit is no load."""
CALM = 40
"""Quiet samples since the last event that this takes otherwise."""
KNOWN = 60
"""Quiet samples before a load step may be suspected; with few, the band is wider (their spread is not well known)."""
AWAY = 500
"""Samples outside its band after which a loop's baseline begins anew."""
UNREST = 0.5
"""What a sample inside the band takes off the count of those outside: an oscillation that is outside for a third of
the time becomes the new baseline."""
TIMEOUT = 10_000
"""Periods after which an event is given up."""
HALF_WAVES = 40
"""Half waves after which an oscillating event is given up: at a damping of 0.05 twenty waves leave 0.2 %."""
STILLER = 1.5
"""Standard deviations of the short average within which a loop comes to rest after an event that show it to be far
quieter than was thought (the range over a minute is 4 to 5): what was known came from the transient before."""
OUTLIER = 5.0
"""Standard deviations by which one sample may pull the short average when quiet: a spike alone does not reach the
trigger (0.2 x 5 sd of the error are 3 sd of its average)."""
GLITCH = 10.0
"""Mean sizes of the error by which one sample may count while a baseline is learnt."""
NOISE_FREE = 1e6
"""Standard deviations of the error from which a deviation is no outlier: the signal is simulated, without noise."""
REBASE = 20
"""Late samples, each soon after the last, after which the loop's clock was set back, and they are the truth."""
REGAP = 8
"""Gaps in a row after which they are the sample period."""
BLIND = 3
"""Samples without a set point after which a change of it came at an unknown time."""
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

COUNTS = ("ok", "uncertain", "bad_value", "bad_quality", "duplicate", "conflict", "late")
"""What became of a sample; `ok` includes `uncertain`, `duplicate` includes `conflict`."""

_f, _i = np.float64, np.int64
_INTEGRALS = [
    (name, _f) for name in ("s1", "s2", "s3", "y1", "y2", "iae", "iae_noise", "good_time", "saturated_time")
]
_BASELINE = [(name, _f) for name in ("pv0", "op0", "error_sd", "noise")]

PARAM = np.dtype([("period", _f), ("pv_min", _f), ("pv_max", _f), ("op_low", _f), ("op_high", _f)])

_NOISE = ("mean_e", "var_e", "abs_e", "mean_s", "var_s")
"""The error's mean, variance and mean size when quiet, and mean and variance of its short average [PV]."""
_FACTS = "phase time seen warm based away ringed looks learn slot auto kind moved moves events".split()
_TROUBLE = "lates late_at rebased gaps blind spoilt".split()
"""Late samples in a row and the last one's time, how often the clock was set back, gaps in a row, samples in a row
without a set point, and bad ones since the last good one."""
_EVENT = "onset still end end_state end_cause points before stride skipped waves side".split()
_SINCE = ["ok_before", "uncertain_before"]
_SHAPE = "amplitude held low high sum_e sum_t quiet sp_from pace".split()
_LAST = "sp pv op dpv period short mean_pv mean_op var_d quantum least_gap unrest".split()

STATE = np.dtype(
    [
        *[(n, _i) for n in (*_FACTS, *_TROUBLE, *_EVENT, *_SINCE, *COUNTS)],
        *[(n, _f) for n in (*_LAST, *_SHAPE, *_NOISE)],
        # the noise at the last look, and at the one before
        *[(f"{n}_{k}", _f) for k in (1, 2) for n in _NOISE],
        *_INTEGRALS,
        *_BASELINE,
    ]
)

EVENT_OUT = [
    *[(n, _i) for n in "what row kind state cause slot points before onset end number".split()],
    *[(n, _f) for n in "amplitude duration quiet offset period quantum uncertain_share short_sd".split()],
    *_INTEGRALS,
    *_BASELINE,
]
"""Fields of an event handed out."""
