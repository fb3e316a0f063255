"""Naive twins of what is fast, in plain Python."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def step_response(h: float, kind: int, lag: float, lag2: float) -> float:
    """Unit-gain model without dead time, a time ``h`` after a unit step of its input: the textbook's formulas.

    0 at the instant of the step itself: PV is measured before OP moves.
    """
    if h <= 0:
        return 0.0
    e1 = math.exp(-h / lag) if lag else 0.0
    e2 = math.exp(-h / lag2) if lag2 else 0.0
    if lag == lag2:  # the limit of the formulas below
        rise = 1.0 - e1 * (1.0 + h / lag) if lag else 1.0
        return h - 2.0 * lag + e1 * (h + 2.0 * lag) if kind == 0 else rise
    if kind == 0:
        return h - lag - lag2 + (lag**2 * e1 - lag2**2 * e2) / (lag - lag2)
    return 1.0 - (lag * e1 - lag2 * e2) / (lag - lag2)


def response(t: Array, u: Array, kind: int, dead_time: float, lag: float, lag2: float) -> Array:
    """Unit-gain model's response to held input, from rest: the sum of what each move of the input does."""
    moves = np.diff(u, prepend=0.0)
    return np.array(
        [
            sum(
                move * step_response(now - dead_time - at, kind, lag, lag2)
                for at, move in zip(t, moves, strict=True)
            )
            for now in t
        ]
    )


def integrals(window: Array, pv0: float, op0: float) -> dict[str, float]:
    """Running integrals over a window that starts at the onset: OP held, PV and integrals by trapezoids."""
    s1 = s2 = s3 = y1 = y2 = iae = 0.0
    for (t0, sp, pv_a, op), (t1, _, pv_b, _) in pairwise(window):
        dt = t1 - t0
        s1_new = s1 + (op - op0) * dt
        s2_new = s2 + (s1 + s1_new) / 2 * dt
        s3 += (s2 + s2_new) / 2 * dt
        s1, s2 = s1_new, s2_new
        y1_new = y1 + (pv_a - pv0 + pv_b - pv0) / 2 * dt
        y2 += (y1 + y1_new) / 2 * dt
        y1 = y1_new
        iae += (abs(sp - pv_a) + abs(sp - pv_b)) / 2 * dt
    return {"s1": s1, "s2": s2, "s3": s3, "y1": y1, "y2": y2, "iae": iae}


def noise_through(kp: float, td: float, tf: float, period: float, noise: Array) -> float:
    """Standard deviation of OP that this noise causes in a standard P(D) controller, backward differences."""
    d = last = 0.0
    out = []
    for v in noise:
        d = (tf * d + v - last) / (tf + period)
        last = float(v)
        out.append(kp * (v + td * d))
    return float(np.std(out))


def load_integrals(
    s1: float, s2: float, s3: float, y1: float, y2: float, u_end: float
) -> tuple[float, float, float, float]:
    """Size [OP], age of the onset [s before the end], gain and T0 from a load step's integrals (derived).

    ``Ad = -u(inf)``, ``L = -S1/Ad``, ``mu = Y1/(S2 + Ad L^2/2)``, ``T0 = (mu (S3 + Ad L^3/6) - Y2)/Y1``.
    Under noise size and onset stay good, T0 does not.
    """
    size = -u_end
    age = -s1 / size
    gain = y1 / (s2 + size * age**2 / 2)
    return size, age, gain, (gain * (s3 + size * age**3 / 6) - y2) / y1
