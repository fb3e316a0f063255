"""Whether the tags are what they say: SP rests, OP answers to the error, PV follows slowly enough to be seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit

CLEAR = 500.0
"""Samples without which nothing is said of the wiring."""
ANSWERS = 0.02
"""Least share of OP's moves that the error and its changes explain; a P, PI or PID controller's are near 1."""
TOGETHER = 8
"""Samples in a mean of OP and of the error: an OP that arrives some samples late answers these, if not each sample."""
BY_CHANCE = 8.0
"""Over the number of such means: more is explained by chance once in fifty loops."""
ALIVE = 0.5
"""Least share of samples at which OP moves, for that question."""
EXACT = 0.9
"""Share of samples from which on SP counts as tracking PV, or as being the measured one of the two."""
DEAD = 0.1
"""Largest share of samples at which a PV moves that is really a set point."""
AFTER = 2
"""Samples after a move of SP at which the rest of the error is looked at."""
GONE = 0.2
"""Share of an SP move that is left then, below which the response is over before it is seen."""
MOVES = 3.0
"""Moves of SP without which this is not judged."""
SEEN = 5.0
"""Standard deviations of noise that the moves must have (root mean square)."""
FACTOR = 1.4
"""Least factor by which SP and PV must jump together to look like a change of unit; 1 degC is 1.8 degF and 32."""
ALIKE = 0.05
"""Relative difference of their factors at most."""
GLITCH = 10.0
"""Times the usual size from which on a sample counts less: one odd value outweighs thousands in a sum of squares."""
USUAL = 64.0
"""Samples over which the usual size of what is not zero is taken."""
STAYED = 0.5
"""Share of an SP move that must still be there when the rest of the error is looked at: else it was a glitch."""

_f, _i = np.float64, np.int64
FIELDS = [
    *[(n, _f) for n in ("w_n", "w_sp", "w_pv", "w_op", "w_track", "w_units")],
    ("w_usual", _f, (2, 3)),
    ("w_squares", _f, (2, 6)),
    *[(n, _f) for n in ("m_n", "m_count", "m_sum_e", "m_sum_o", "m_last_e", "m_last_o", "m_known")],
    *[(n, _f) for n in ("w_moves", "w_move2", "w_rest", "w_move", "w_from", "w_to")],
    ("w_wait", _i),
]
"""What is kept. ``w_usual``, ``w_squares``: of each sample and of means of some, the usual sizes of the error, its
change and OP's move, and their products: e e, e d, d d, e o, d o, o o."""
EACH, MEANS = 0, 1


@jit
def trace(h, last, e, sp, pv, op):
    """Take in one sample in automatic."""
    h.w_n += 1.0
    d, o = e - (last.sp - last.pv), op - last.op
    _add(h.w_usual[EACH], h.w_squares[EACH], e, d, o)
    _together(h, e, op)
    if o != 0.0:
        h.w_op += 1.0
    if pv != last.pv:
        h.w_pv += 1.0
        if e == 0.0:
            h.w_track += 1.0
    if h.w_wait > 0:
        h.w_wait -= 1
        if h.w_wait == 0 and abs(sp - h.w_to) < (1.0 - STAYED) * abs(h.w_move):
            h.w_rest += h.w_move * (e - h.w_from)
            h.w_move2 += h.w_move * h.w_move
            h.w_moves += 1.0
    if sp != last.sp:
        h.w_sp += 1.0
        if h.w_wait == 0:
            h.w_move, h.w_from, h.w_wait = sp - last.sp, last.sp - last.pv, AFTER
            h.w_to = sp
        if pv != last.pv and _rescaled(h, last, sp, pv, o):
            h.w_units += 1.0


@jit
def _together(h, e, op):
    """Take in the means of some samples: how OP's move, and the error's own and its move, go together."""
    h.m_count += 1.0
    h.m_sum_e += e
    h.m_sum_o += op
    if h.m_count < TOGETHER:
        return
    mean_e, mean_o = h.m_sum_e / TOGETHER, h.m_sum_o / TOGETHER
    h.m_count = h.m_sum_e = h.m_sum_o = 0.0
    if h.m_known > 0.0:
        h.m_n += 1.0
        _add(h.w_usual[MEANS], h.w_squares[MEANS], mean_e, mean_e - h.m_last_e, mean_o - h.m_last_o)
    h.m_last_e, h.m_last_o, h.m_known = mean_e, mean_o, 1.0


@jit
def _add(usual, squares, e, d, o):
    """Add the products of the error, its change and OP's move to their sums."""
    # scaled as one, so that what the controller makes of them stays the same
    share = min(_trust(usual[0], e), _trust(usual[1], d), _trust(usual[2], o))
    usual[0], usual[1], usual[2] = _usual(usual[0], e), _usual(usual[1], d), _usual(usual[2], o)
    a, b, c = share * e, share * d, share * o
    squares[0] += a * a
    squares[1] += a * b
    squares[2] += b * b
    squares[3] += a * c
    squares[4] += b * c
    squares[5] += c * c


@jit
def _trust(usual, x):
    """Return the share of ``x`` that counts."""
    return GLITCH * usual / abs(x) if abs(x) > GLITCH * usual > 0.0 else 1.0


@jit
def _usual(usual, x):
    """Return the usual size after ``x``; what is zero tells nothing of it."""
    if x == 0.0:
        return usual
    return usual + (min(abs(x), GLITCH * usual) - usual) * (1.0 / USUAL) if usual > 0.0 else abs(x)


@jit
def _rescaled(h, last, sp, pv, o):
    """Whether SP and PV have jumped by the same large factor, which OP took no notice of."""
    if last.sp == 0.0 or last.pv == 0.0:
        return False
    a, b = sp / last.sp, pv / last.pv
    usual = h.w_squares[EACH, 5] / h.w_n
    return (
        a > 0.0
        and (a > FACTOR or a < 1.0 / FACTOR)
        and abs(a - b) < ALIKE * a
        and abs(a - 1.0) * abs(last.sp) > 10.0 * abs(last.sp - last.pv)
        and o * o <= 9.0 * usual
    )


@jit
def unhook(h):
    """Forget what ran, after a gap or a change of mode."""
    h.w_wait = 0
    h.m_count = h.m_sum_e = h.m_sum_o = h.m_known = 0.0


@jit
def fade(h):
    """Halve the sums."""
    h.w_n *= 0.5
    h.w_sp *= 0.5
    h.w_pv *= 0.5
    h.w_op *= 0.5
    h.w_track *= 0.5
    h.w_units *= 0.5
    h.m_n *= 0.5
    for k in range(6):
        h.w_squares[EACH, k] *= 0.5
        h.w_squares[MEANS, k] *= 0.5
    h.w_moves *= 0.5
    h.w_move2 *= 0.5
    h.w_rest *= 0.5


def sp_moving_of(h: Any) -> float | None:
    """Return the share of samples at which SP moved: near 1 for a cascade's slave or a ramp."""
    return float(h["w_sp"] / h["w_n"]) if h["w_n"] > 0 else None


def tracking_of(h: Any) -> float:
    """Return the share of PV's moves that SP went along with exactly: a loop in manual whose SP tracks PV."""
    return float(h["w_track"] / h["w_pv"]) if h["w_pv"] >= 1.0 else 0.0


def mapping_of(h: Any) -> bool:
    """Whether the tags look wrongly wired: SP the noisy one and PV the resting one, or OP deaf to the error."""
    n = float(h["w_n"])
    if n < CLEAR:
        return False
    if h["w_sp"] > EXACT * n and h["w_pv"] < DEAD * n:
        return True
    if h["w_op"] <= ALIVE * n or h["w_pv"] <= ALIVE * n or _explained(h["w_squares"][EACH]) >= ANSWERS:
        return False
    means = float(h["m_n"])
    return means > 0.0 and _explained(h["w_squares"][MEANS]) < max(ANSWERS, BY_CHANCE / means)


def _explained(squares: Any) -> float:
    """Return the share of OP's moves that the error and its change explain (least squares, no constant)."""
    ee, ed, dd, eo, do, oo = map(float, squares)
    det = ee * dd - ed * ed
    if oo <= 0.0 or det <= 1e-12 * ee * dd:
        return 1.0
    return (eo * eo * dd - 2.0 * eo * do * ed + do * do * ee) / (det * oo)


def undersampled_of(h: Any, noise: float) -> bool:
    """Whether PV is back at SP within two samples of SP's moves: the response is over before it is seen."""
    n = float(h["w_moves"])
    if n < MOVES or h["w_move2"] <= n * (SEEN * noise) ** 2:
        return False
    return bool(h["w_rest"] < GONE * h["w_move2"])
