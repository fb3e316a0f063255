"""What the streaming kernel goes by: limits and weights with their reasons. A name ends in what it counts."""

from __future__ import annotations

WARM_UP_SAMPLES = 20
"""Quiet samples before a baseline is trusted: the mean of 20 has 0.22 of one sample's noise."""
RING_SAMPLES = 128
"""Samples kept from before an event: baseline for the fit, and the picture's left margin."""
COARSE_SAMPLES = 8
"""Samples in a point of the coarse ring, which reaches this many times further back: a load step on a sluggish
loop is noticed long after it came."""
SNAPSHOT_SAMPLES = 64
"""Samples between two looks at the noise. A load step is suspected against the noise of one to two looks ago, which
a slow response has not yet widened."""
LEAST_BEFORE_SAMPLES = 8
"""Samples of the window from before the onset, even where the loop was not at rest."""
UNRESTED_BEFORE_SAMPLES = 32
"""Samples of it where the loop was not at rest: from them a fit learns how PV moved already."""
STRETCH_SAMPLES, ALL_STRETCHES_SAMPLES = 8192, 1024
"""Samples from one stretch that is handed out, for the controller to be seen in it, to the next; of a loop that is new
every one is, up to so many samples, and then one whenever they have doubled."""
WINDOW_POINTS = 1024
"""Points of an event's window; when full, every second one is dropped."""
OPENING_SAMPLES = 96
"""Samples of an event after which the last `RING_SAMPLES` are handed out, as they came: its window may be thinned by
the end, and then shows little of the controller."""
BLOCK_SAMPLES, LEVEL_SAMPLES, LEVELS = 1024, 16, 2
"""Values in a block in which a valve, a cycle or no answer is looked for; samples in an average of the next level, so
that its block reaches over 16,384 of them; and levels."""
LEAST_BLOCK_SAMPLES, LAST_BLOCK_SAMPLES = 256, 64
"""Values without which a block that a gap or manual ends is let go; and one that ends with the data."""
SLOTS_OF_SAMPLE, ROWS_OF_SAMPLE = 12, 14
"""Windows that one sample may need, and rows of what is handed out: an event's, two stretches', and of blocks two that
a gap ends, one so far, and up to seven where missing samples are filled and complete them."""
MAX_GAP_PERIODS = 3.5
"""Above it nothing is integrated across (three periods and jitter)."""
STEP_MOVES_SAMPLES = 5
"""A set point that moves at more samples than these is a ramp or a cascade's, not a step smeared by a historian or
clicked together by an operator."""
STEP_LASTS_PERIODS = 20
"""Periods that such a step may take from its first move to its last."""
STEP_REST_PERIODS = 7
"""Periods for which a set point must rest before its move counts as finished: masters scan every 1 to 5 s."""
RAMP_REST_PERIODS = 20
"""Periods for which a moving set point must rest before the loop is looked at again."""
RAMP_CALM_SAMPLES = 200
"""Samples without a break for which the error must be quiet after a ramp before a load step may be suspected: the
ramp's end travels round the loop, too, and swings through zero."""
RESTLESS_PERIODS = 100.0
"""Periods between the moves of a set point, on average, below which a master moves it (those of model-predictive
controllers run once a minute), and nobody's step."""
REST_PACES = 5.0
"""Of these averages a restless set point must rest before it counts as resting."""
MOST_PACE_PERIODS = 300.0
"""Periods that count for a longer rest in that average, so that an operator's step after a long ramp is one."""
SAME_LEVEL_SD = 0.5
"""Standard deviations of the noise within which a set point is still where it was: jitter of an analog signal."""
BUSY_SHARE, JITTERY_SHARE = 0.1, 0.5
"""Share of the samples at which a set point changes, from which its noise is the error's, and not PV's white one alone;
and from which it is an analog signal, or a slave's."""
JITTER_SIZES = 4.0
"""Mean changes of an analog set point within which it is still where it was: they are 1.13 standard deviations."""
JITTER_WEIGHT = 0.02
"""Weight of a sample in what is known of a set point's changes."""
MOVING_SAMPLES, MOST_MOVING_SAMPLES = 1024, 8192
"""Samples of a window while a set point goes on moving: back and forth, as of a master; or one way, as of a ramp."""
NET_SHARE = 0.1
"""Of the farthest that it went, from which where a set point came to rest is the size of its move."""
LEAST_TURNS = 4
"""Turns from which it goes back and forth."""
NEAR_WEIGHT = 1.0 / 32.0
"""Weight of a sample in what the error is like of late."""
TOO_WIDE_RATIO = 25.0
"""Variance known over that of late, from which the noise known is that of an upset."""
TOO_WIDE_LOOKS, TOO_WIDE_SAMPLES = 4, 2000
"""Looks in a row (`SNAPSHOT_SAMPLES` apart) after which it is learnt anew; quiet samples since the loop began, up to
which that is asked: a load that wanders is as calm at times."""
UNRESTED_SD = 3.0
"""White standard deviations, by PV's second differences, that a set-point step's noise may have at most where the
loop was not at rest: the rest is the upset."""
ROUNDING_SHARE = 2e-7
"""A set point's relative change that is nothing but a float of 32 bits."""
STEP_STANDS_OUT_SD = 3.0
"""Standard deviations of the error, and least changes of PV, that a set-point step must exceed."""
BESIDE_SHARE = 0.02
"""Of an open move's size, up to which another one goes beside it, and opens no event of its own."""
TRIGGER_SD = 5.0
"""Standard deviations of the short average, when quiet, by which it must leave its mean to suspect a load step."""
SUSPECTED_LOAD_SD = 8.0
"""Standard deviations of the short average, when quiet, that a load step must reach to be handed out: a wandering
load brings as much once in some loop-weeks."""
SUSPECTED_LOAD_QUANTA = 2.5
"""Least changes of PV that it must reach: a transmitter's last bit is no load."""
CALM_SAMPLES = 40
"""Quiet samples since the last event that this takes otherwise."""
KNOWN_SAMPLES = 60
"""Quiet samples before a load step may be suspected; with few, the band is wider (their spread is not well known)."""
OUTSIDE_SAMPLES = 500
"""Samples outside its band after which a loop's baseline begins anew."""
INSIDE_COUNTS_SAMPLES = 0.5
"""What a sample inside the band takes off the count of those outside: an oscillation that is outside for a third of
the time becomes the new baseline."""
TIMEOUT_PERIODS = 10_000
"""Periods after which an event is given up."""
MOST_HALF_WAVES = 40
"""Half waves after which an oscillating event is given up: at a damping of 0.05 twenty waves leave 0.2 %."""
STILL_SETPOINT_SHARE, STILL_LOAD_SHARE = 1e-4, 1e-3
"""Least half width of the band in which the short average comes to rest, as a share of the event's size: without noise
nothing else ends it. The integrals of a set-point step want all of it, a load's long tail only thins its window."""
STILLER_SD = 1.5
"""Standard deviations of the short average within which a loop comes to rest after an event that show it to be far
quieter than was thought (the range over a minute is 4 to 5): what was known came from the transient before."""
TAIL_SHARE = 2e-3
"""Of the last event's size, below which what is left of it is no load, and no unrest."""
SPIKE_SD = 5.0
"""Standard deviations by which one sample may pull the short average when quiet: a spike alone does not reach the
trigger (0.2 x 5 sd of the error are 3 sd of its average)."""
GLITCH_MEAN_SIZES = 10.0
"""Mean sizes of the error by which one sample may count while a baseline is learnt."""
NOISE_FREE_SD = 1e6
"""Standard deviations of the error from which a deviation is no spike: the signal is simulated, without noise."""
SET_BACK_SAMPLES = 20
"""Late samples, each soon after the last, after which the loop's clock was set back, and they are the truth."""
NEW_PERIOD_GAPS = 8
"""Gaps in a row after which they are the sample period."""
SP_MISSING_SAMPLES = 3
"""Samples without a set point after which a change of it came at an unknown time."""
SHORT_WEIGHT = 0.2
"""Weight of the short average of the error, per period (about five samples)."""
LONG_WEIGHT = 0.002
"""Weight of its long-run mean and variance (about 500 samples)."""
BASELINE_WEIGHT = 0.005
"""Weight of the baseline's PV and OP (about 200 samples)."""
TOO_LARGE = 1e30
"""A magnitude that no plant has: a gateway's placeholder."""
