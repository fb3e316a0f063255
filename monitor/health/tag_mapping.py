"""Whether the tags are what they say: SP rests, OP answers to the error, PV follows slowly enough to be seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit, jit_inlined

from .fields import clearing, halving

MAPPING_SAMPLES = 500.0
"""Samples without which nothing is said of the wiring."""
ANSWERED_SHARE = 0.02
"""Least share of OP's moves that the error and its changes explain; a P, PI or PID controller's are near 1."""
MEAN_SAMPLES = 8
"""Samples in a mean of OP and of the error: an OP that arrives some samples late answers these, if not each sample."""
CHANCE_MEANS = 8.0
"""Over the number of such means: more is explained by chance once in fifty loops."""
ALIVE_SHARE = 0.5
"""Least share of samples at which OP moves, for that question."""
TRACKING_SHARE = 0.9
"""Share of samples from which on SP counts as tracking PV, or as being the measured one of the two."""
RESTING_SHARE = 0.1
"""Largest share of samples at which a PV moves that is really a set point."""
CASCADE_SHARE = 0.2
"""Share of samples at which SP moves, above which no single move of it is a disturbance."""
ANSWER_SAMPLES = 2
"""Samples after a move of SP at which the rest of the error is looked at."""
LEFT_SHARE = 0.2
"""Share of an SP move that is left then, below which the response is over before it is seen."""
STAYED_SHARE = 0.5
"""Share of an SP move that must still be there when the rest of the error is looked at: else it was a glitch."""
RESTED_SAMPLES, RESTED_SHARE = 10, 0.5
"""Samples for which SP must have rested before such a move, and error before it as a share of the move at most: PV that
still answers to the move before, or rolls, may be anywhere two samples later."""
LEAST_STEPS = 3.0
"""Moves of SP without which this is not judged."""
STEP_SD = 5.0
"""Standard deviations of noise that the moves must have (root mean square)."""
UNIT_FACTOR = 1.4
"""Least factor by which SP and PV must jump together to look like a change of unit; 1 degC is 1.8 degF and 32."""
UNIT_SHARE = 0.05
"""Relative difference of their factors at most."""
UNIT_ERRORS = 10.0
"""Errors that the jump of SP must have."""
UNIT_MOVE_SD = 3.0
"""Usual moves of OP (root mean square) that OP may make at it."""
UNIT_SAMPLES = 20
"""Samples after it at which OP must still be where it was: a loop too fast for its sampling holds another PV by another
OP."""
UNIT_CHANGES = 0.5
"""Such jumps, those of a month ago a quarter, from which on the unit counts as changed."""
GLITCH_SIZES = 10.0
"""Times the usual size from which on a sample counts less: one odd value outweighs thousands in a sum of squares."""
USUAL_SAMPLES = 64.0
"""Samples over which the usual size of what is not zero is taken."""

EACH, MEANS = 0, 1
SUMS: list[Any] = [
    ("samples", "f8"),  # in automatic
    ("sp_moves", "f8"),  # samples at which SP is another
    ("pv_moves", "f8"),
    ("op_moves", "f8"),
    ("tracked", "f8"),  # moves of PV at which SP is exactly PV
    ("rescaled", "f8"),  # jumps of SP and PV as if their unit had changed
    ("means", "f8"),  # differences of means of some samples
    # of each sample and of means: e e, e d, d d [PV^2], e o, d o [PV OP], o o [OP^2], of the error e, its change d and
    # OP's move o
    ("products", "f8", (2, 6)),
    ("steps", "f8"),  # moves of SP that have stayed
    ("step_squares", "f8"),  # [PV^2] these squared
    ("left", "f8"),  # [PV^2] times what is left of the error two samples later
]
RUNNING: list[Any] = [
    ("count", "f8"),  # samples in the mean that fills
    ("e_sum", "f8"),  # [PV] their errors
    ("op_sum", "f8"),  # [OP]
    ("e_mean", "f8"),  # [PV] of the mean before
    ("op_mean", "f8"),  # [OP]
    ("has_mean", "f8"),  # 1 if there is one
    ("rested", "i4"),  # samples since SP moved
    ("wait", "i8"),  # samples until the answer to a move of SP is looked at
    ("step", "f8"),  # [PV] that move
    ("e_from", "f8"),  # [PV] error before it
    ("sp_to", "f8"),  # [PV] where it went
    ("unit_wait", "i4"),  # samples until OP is looked at after a jump as of another unit
    ("unit_op", "f8"),  # [OP] where it was before
]
KEPT: list[Any] = [
    ("usual", "f8", (2, 3)),  # usual sizes of e, d [PV] and o [OP], of each sample and of means
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)
reset = clearing(RUNNING)


@jit_inlined
def update(own, last, sp, pv, op):
    """Take in one sample in automatic; ``last`` is the one before: sp, pv, op."""
    own.samples += 1.0
    before, e = last.sp - last.pv, sp - pv
    d, o = e - before, op - last.op
    _add(own.usual[EACH], own.products[EACH], e, d, o)
    _add_to_means(own, e, op)
    if o != 0.0:
        own.op_moves += 1.0
    if pv != last.pv:
        own.pv_moves += 1.0
        if e == 0.0:
            own.tracked += 1.0
    if own.wait > 0:
        own.wait -= 1
        if own.wait == 0 and abs(sp - own.sp_to) < (1.0 - STAYED_SHARE) * abs(own.step):
            own.left += own.step * (e - own.e_from)
            own.step_squares += own.step * own.step
            own.steps += 1.0
    _follow_unit(own, last, sp, pv, op)
    own.rested += 1
    if sp != last.sp:
        own.sp_moves += 1.0
        rested = own.rested > RESTED_SAMPLES and abs(before) < RESTED_SHARE * abs(sp - last.sp)
        if own.wait == 0 and rested:
            own.step, own.e_from, own.wait = sp - last.sp, before, ANSWER_SAMPLES
            own.sp_to = sp
        own.rested = 0


@jit_inlined
def _follow_unit(own, last, sp, pv, op):
    """Count a jump of SP and PV as if their unit had changed, once OP has been seen to take no notice."""
    if own.unit_wait > 0 and sp != last.sp:
        own.unit_wait = 0  # SP goes on moving: it is led, or tracks PV
    elif own.unit_wait > 0:
        own.unit_wait -= 1
        if own.unit_wait == 0 and _as_usual(own, op - own.unit_op):
            own.rescaled += 1.0
    elif (
        own.rested > RESTED_SAMPLES
        and sp != last.sp
        and pv != last.pv
        and _rescaled(own, last, sp, pv, op - last.op)
    ):
        own.unit_wait, own.unit_op = UNIT_SAMPLES, last.op


@jit
def _add_to_means(own, e, op):
    """Take in the means of some samples: how OP's move, and the error's own and its move, go together."""
    own.count += 1.0
    own.e_sum += e
    own.op_sum += op
    if own.count < MEAN_SAMPLES:
        return
    mean_e, mean_o = own.e_sum / MEAN_SAMPLES, own.op_sum / MEAN_SAMPLES
    own.count = own.e_sum = own.op_sum = 0.0
    if own.has_mean > 0.0:
        own.means += 1.0
        _add(own.usual[MEANS], own.products[MEANS], mean_e, mean_e - own.e_mean, mean_o - own.op_mean)
    own.e_mean, own.op_mean, own.has_mean = mean_e, mean_o, 1.0


@jit
def _add(usual, products, e, d, o):
    """Add the products of the error, its change and OP's move to their sums."""
    # scaled as one, so that what the controller makes of them stays the same
    share = min(_trust(usual[0], e), _trust(usual[1], d), _trust(usual[2], o))
    usual[0], usual[1], usual[2] = _usual(usual[0], e), _usual(usual[1], d), _usual(usual[2], o)
    a, b, c = share * e, share * d, share * o
    products[0] += a * a
    products[1] += a * b
    products[2] += b * b
    products[3] += a * c
    products[4] += b * c
    products[5] += c * c


@jit
def _trust(usual, x):
    """Return the share of ``x`` that counts."""
    return GLITCH_SIZES * usual / abs(x) if abs(x) > GLITCH_SIZES * usual > 0.0 else 1.0


@jit
def _usual(usual, x):
    """Return the usual size after ``x``; what is zero tells nothing of it."""
    if x == 0.0:
        return usual
    return (
        usual + (min(abs(x), GLITCH_SIZES * usual) - usual) * (1.0 / USUAL_SAMPLES) if usual > 0.0 else abs(x)
    )


@jit
def _rescaled(own, last, sp, pv, o):
    """Whether SP and PV have jumped by the same large factor, which OP took no notice of."""
    if last.sp == 0.0 or last.pv == 0.0:
        return False
    a, b = sp / last.sp, pv / last.pv
    return (
        a > 0.0
        and (a > UNIT_FACTOR or a < 1.0 / UNIT_FACTOR)
        and abs(a - b) < UNIT_SHARE * a
        and abs(a - 1.0) * abs(last.sp) > UNIT_ERRORS * abs(last.sp - last.pv)
        and _as_usual(own, o)
    )


@jit
def _as_usual(own, o):
    """Whether OP moved no more than it does from sample to sample."""
    return o * o <= UNIT_MOVE_SD * UNIT_MOVE_SD * own.products[EACH, 5] / own.samples


@jit
def sp_moves_often(own):
    """Whether SP moves at so many samples that none of its moves is a disturbance."""
    return own.sp_moves >= CASCADE_SHARE * own.samples + 1.0


def sp_moving_of(own: Any) -> float | None:
    """Return the share of samples at which SP moved: near 1 for a cascade's slave or a ramp."""
    return float(own["sp_moves"] / own["samples"]) if own["samples"] > 0 else None


def tracking_of(own: Any) -> float:
    """Return the share of PV's moves that SP went along with exactly, 0 unless it is nearly all: in manual, SP may."""
    share = float(own["tracked"] / own["pv_moves"]) if own["pv_moves"] >= 1.0 else 0.0
    return share if share > TRACKING_SHARE else 0.0


def mapping_of(own: Any) -> bool:
    """Whether the tags look wrongly wired: SP tracks PV, SP is noisy and PV rests, or OP is deaf to the error."""
    if tracking_of(own) > 0.0:
        return True
    n = float(own["samples"])
    if n < MAPPING_SAMPLES:
        return False
    if own["sp_moves"] > TRACKING_SHARE * n and own["pv_moves"] < RESTING_SHARE * n:
        return True
    if own["op_moves"] <= ALIVE_SHARE * n or own["pv_moves"] <= ALIVE_SHARE * n:
        return False
    if _explained(own["products"][EACH]) >= ANSWERED_SHARE:
        return False
    means = float(own["means"])
    return means > 0.0 and _explained(own["products"][MEANS]) < max(ANSWERED_SHARE, CHANCE_MEANS / means)


def unit_changed(own: Any) -> bool:
    """Whether SP and PV jumped by the same factor, as if their unit had changed."""
    return bool(own["rescaled"] >= UNIT_CHANGES)


def _explained(products: Any) -> float:
    """Return the share of OP's moves that the error and its change explain (least squares, no constant)."""
    ee, ed, dd, eo, do, oo = map(float, products)
    det = ee * dd - ed * ed
    if oo <= 0.0 or det <= 1e-12 * ee * dd:
        return 1.0
    return (eo * eo * dd - 2.0 * eo * do * ed + do * do * ee) / (det * oo)


def undersampled_of(own: Any, noise: float) -> bool:
    """Whether PV is back at SP within two samples of SP's moves: the response is over before it is seen."""
    n = float(own["steps"])
    if n < LEAST_STEPS or own["step_squares"] <= n * (STEP_SD * noise) ** 2:
        return False
    return bool(own["left"] < LEFT_SHARE * own["step_squares"])
