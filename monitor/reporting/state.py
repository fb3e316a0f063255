"""What is known of the way in which a loop's rows come, and what the stage goes by: limits with their reasons."""

from __future__ import annotations

import numpy as np

RING_ROWS, SEEN_ROWS, NEXT_ROWS = 64, 32, 16
"""Most rows that wait; of them the last that are looked at together, and after how many more they are looked at again.
With fewer their changes do not show a dead band; of more some are from when the loop was quiet, and show its noise."""
PASSING, WATCHING, COLLECTING, HOLDING = range(4)
"""A loop's rows are handed on as they come; wait until it is known how they come; are handed on and looked at; come by
exception. Only a new loop's rows wait, or those after a long quiet time: else they would be late again and again."""
SLOW_NS = 60 * 10**9
"""Rows that far apart [ns] may be what an exception report sends while nothing changes."""
REGULAR_ROWS = 16
"""Rows at the same distance after which a loop that begins slowly is taken for one that is sampled slowly."""
SAME_SHARE = 0.25
"""Relative difference up to which an interval is the usual one."""
EARLY_SHARE = 0.5
"""Share of a slow loop's usual interval below which a row has come on change."""
LOOK_ROWS, ODD_ROWS = 64, 32
"""Of so many rows of a fast loop so many at other intervals: it is looked at. Lost rows and jitter are fewer."""
EARLY_LOOKS, MOST_BACKOFF = 3, 256
"""Looks one after the other that may find nothing; later ones double the rows until the next one, up to so many times
`LOOK_ROWS`. A loop whose rows do come by exception may be quiet for long, and shows its band only when it moves."""
LATE_ROWS = 20
"""Rows from before the loop's last one, in a row, after which its clock was set back, as detection says."""
IRREGULAR_RATIO = 3.0
"""Long intervals (one in ten) over the short ones from which rows do not come at a rate: a lost row doubles one."""
RATE_SHARE = 1.5
"""Of the usual interval, or of that at which values are held, below which nine in ten are of rows at a rate."""
TIGHT_RATIO, TIGHT_CHANGES = 1.16, 1.2
"""Mean size of PV's changes weighted by their squares over that weighted by their sizes: 1 where all are of one size,
the dead band, and any number are less. It must be less than the first, less the second over the number of changes. By
exception it is 1.01 to 1.12; kept by a swinging door 1.2 to 1.5; white noise has 1.27, and of 10 to 60 changes less
than the limit once in a hundred times (derived; measured on simulated steps, dead bands of 3 and 5 standard
deviations)."""
BEAT_SHARE, BEAT_TIMES = 0.05, 3
"""Relative difference within which so many of the longest intervals, one outlier left out, are the one after which a
row is sent anyway."""
LEAST_BEAT_PERIODS = 10.0
"""Periods that such an interval has at least: of few periods many rows are apart by chance."""
QUIET_BEATS = 1.5
"""Such intervals after which a silence is a gap."""
SAME_BAND_SHARE = 0.5
"""Share of the dead band by which PV must differ from what was handed on last to be another. A row that is sent anyway,
or for the sake of OP, brings a noise that other rows do not have, and detection cannot know how much to expect."""
MOST_HELD_ROWS = 3600
"""Rows for which a value holds where nothing says how long it may be silent: an hour of seconds."""

REPORTING = np.dtype(
    [
        ("mode", "i8"),
        ("given", "i8"),  # [ns] sample period that the table gives, 0: none
        ("rows", "i8"),  # good ones, up to 2: whether there is a last one, and an interval
        ("time", "i8"),  # [ns] of the last good row
        ("out_time", "i8"),  # [ns] of the last row handed on, held ones included
        ("sp", "f8"),  # [PV] last ones that were good
        ("pv", "f8"),  # [PV]
        ("op", "f8"),  # [OP]
        ("auto", "i8"),
        ("good", "i8"),  # whether the last row was
        ("late", "i8"),  # late rows in a row
        ("usual", "i8"),  # [ns] interval between rows
        ("looked", "i8"),  # rows since the count of the odd ones began
        ("odd", "i8"),  # of them at another interval
        ("backoff", "i8"),  # by which looks are put off; 0: it is new, and one odd interval is enough
        ("looks", "i8"),  # that found nothing
        ("n", "i8"),  # rows in the ring
        ("next", "i8"),  # the first of them that is still to be handed on
        ("period", "i8"),  # [ns] at which values are held, 0 where rows are handed on as they come
        ("beat", "i8"),  # [ns] after which a row is sent though nothing changed, 0 where that is not known
        ("band", "f8"),  # [PV] by which PV must change, about
        ("shown", "f8"),  # [PV] handed on last of a loop that is holding
        ("added", "i8"),  # rows made up
    ]
)
"""A loop's state."""
ROW = np.dtype(
    [
        *(("time", "i8"), ("sp", "f8"), ("pv", "f8"), ("op", "f8")),
        *(("auto", "?"), ("quality", "u1")),
    ]
)
"""A row that waits, or is looked at."""
