"""Gains of a controller's law by regression, with what can be said of their uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import median
from monitor.contract.samples import Array

from .controller_law import (
    INTEGRAL,
    OP,
    RIDGE_SHARE,
    START,
    WALK_SHARES,
    D,
    P,
    columns,
    left_by_known,
    products,
    scores,
    search,
    solved,
    whitened,
)
from .controller_rows import Rows

JUMP_SD = 8.0
"""Robust standard deviations of OP's innovations from which one is a jump: a feed-forward, an operator's hand."""
MOST_JUMPS_SHARE = 0.03
"""Share of the rows that may be jumps; of more, the law is wrong."""
MOST_LATE_ROWS, LEAST_LATE_ROWS = 12, -3
"""Rows by which OP is looked for later, and earlier, than what it answers to."""
LONGEST_FILTER_SHARE = 0.8
"""Longest PV filter that is looked for, as a share of the rows' time."""
SEARCHED_ROWS, SEARCHED_BEFORE_ROWS = 400, 80
"""Rows in which filter and delay are looked for, and how many of them lie before the onset."""
Z95 = 1.96
LEFT_SHARE, VERY_LITTLE_SHARE, MOST_ROUNDED_SHARE = 1e-5, 1e-9, 1e-2
"""Share of the squares of OP's moves that an exact law leaves; a computed one; most that rounding may have."""
OP_GAINS = 3
"""Gains of a law: kp, ki, kd."""
LEAST_PRODUCT = 1e-30
"""Of a column with itself; of less than rounding, it is nothing."""
LEAST_REST_SHARE = 1e-4
"""Share of OP (standard deviations) that is left, at the least, where gains are given their uncertainty: a response of
one mode alone is explained to rounding by many gains."""
EXACT_SHARE = 2e-3
"""Share of the law's own movement (standard deviations) below which what is left of OP is nothing."""

THINNED_SHARE = 1e-2
"""The same for a thinned window, in which PV between the rows is not known."""


@dataclass(frozen=True, slots=True)
class Known:
    """A law in standard form: the table's, or what is looked for."""

    kp: float
    ki: float
    kd: float
    tf: float
    b: float
    c: float
    derivative: bool
    """Whether a free fit has a derivative."""
    given: bool = True
    """Whether these are settings of a table."""
    integral: bool = True
    """Whether a free fit has an integral."""

    @property
    def gains(self) -> Array:
        """As the columns have them."""
        return np.array([self.kp, self.ki, self.kd, 0.0])

    @property
    def active(self) -> NDArray[np.int64]:
        """Columns of a free fit."""
        return np.array([P] + [INTEGRAL] * self.integral + [D] * self.derivative + [START])

    def law(self, rows: Rows, present: float = 1.0) -> tuple[float, float, float, float, float]:
        """As the columns take it."""
        return self.tf, self.b, self.c, present, rows.middle


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """A PV filter and a delay, with what the gains leave of OP there."""

    filter_time: float
    """[s]"""
    late: float
    """Rows."""
    squares: float


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """Gains with their uncertainty, at a filter and a delay."""

    gains: Array
    """(4,)"""
    sd: Array
    """(3,) Standard deviations of kp, ki, kd."""
    if_noise: Array
    """(3,) Gains if all that is left of OP is white noise of PV that the controller did not see (Frisch 1934)."""
    place: Place
    rows: int
    unsampled_ratio: float = 1.0
    """How many times larger ki may be if all that is left of OP is what a faster controller integrated between samples:
    the gain of the reverse regression over the direct one, and as much again."""

    @classmethod
    def exact(cls, gains: Array) -> Estimate:
        """Return gains that are beyond doubt."""
        return cls(gains, np.zeros(3), gains[:3].copy(), Place(0.0, 0.0, 0.0), 0)

    def farthest(self, which: int, z: float) -> tuple[float, float]:
        """Return the interval of a gain with all that a recording may hide of the integral."""
        low, high = self.ends(which, z)
        more = float(self.gains[which]) * (self.unsampled_ratio**2 if which == INTEGRAL else 1.0)
        return min(low, more), max(high, more)

    def ends(self, which: int, z: float) -> tuple[float, float]:
        """Return the interval of a gain: ``z`` standard deviations beyond it, and beyond what noise makes of it."""
        half = z * float(self.sd[which])
        both = float(self.gains[which]), float(self.if_noise[which])
        if math.isnan(both[1]):
            return -math.inf, math.inf
        return min(both) - half, max(both) + half


def walk_share(rows: Rows, law: tuple[float, ...], active: NDArray[np.int64], gains: Array) -> float:
    """Return the likeliest share of a walk in what OP holds beside the law; gains NaN = free."""
    x = columns(rows.time, rows.sp, rows.pv, law, 0.0, 0)
    best, out = math.inf, 1.0
    for walk in WALK_SHARES:
        white, log_f, n = whitened(x, rows.op, rows.use, rows.fresh, walk)
        m = products(white)
        s = solved(m, active)[1] if math.isnan(gains[0]) else left_by_known(m, gains)
        s = max(s, 1e-24 * m[OP, OP])
        unlikely = n * math.log(s / n) + log_f if n > 0 and s > 0 else math.inf
        if unlikely < best:
            best, out = unlikely, walk
    return out


def jumps(size: Array, use: NDArray[np.bool_], floor: float, usual: float) -> NDArray[np.intp]:
    """Return the rows at which OP jumped, by the size of its innovations; none where they are many.

    ``usual`` is the median of their size.
    """
    at = np.flatnonzero(use & (size > max(JUMP_SD * (1.4826 * usual), floor)))
    return at if len(at) <= max(MOST_JUMPS_SHARE * np.count_nonzero(use), 2) else at[:0]


def trimmed(rows: Rows, law: tuple[float, ...], active: NDArray[np.int64], floor: float) -> Rows:
    """Return the rows with the constant free anew at each jump of OP that the free law does not explain.

    Moves from row to row are looked at. The largest jumps go first: they bend the law with which the others are seen.
    """
    x = columns(rows.time, rows.sp, rows.pv, law, 0.0, 0)
    every, _, _ = whitened(x, rows.op, rows.use, rows.fresh, 1.0)
    kept = every
    at = np.zeros(0, np.intp)
    size: Array | None = None
    for part in (0.5, 0.25, 0.1, 0.0, 0.0, 0.0):
        if size is None:
            gains, _ = solved(products(kept), active)
            size = np.abs(every[:, OP] - every[:, :OP] @ gains)
            told = size[rows.use]
            largest, usual = float(np.max(size)), median(told) if len(told) else 0.0
        found = jumps(size, rows.use, max(floor, part * largest), usual)
        if not np.array_equal(found, at):  # of the same rows, the law is the same
            at, size, kept = found, None, every.copy()
            kept[at] = 0.0
    return rows.restarted(at) if len(at) else rows


def placed(rows: Rows, known: Known, gains: Array, walk: float) -> Place:
    """Search PV filter and delay at which known gains (NaN: free ones) explain OP best, around the onset."""
    most = min(MOST_LATE_ROWS, max(rows.before - 2, 0), len(rows) // 8)
    least = max(LEAST_LATE_ROWS, -(len(rows) // 8))
    use = rows.use.copy()
    use[:most] = False
    use[len(use) + least :] = False
    first = max(min(rows.before, len(rows)) - SEARCHED_BEFORE_ROWS, 0)
    around = slice(first, first + SEARCHED_ROWS)
    told: tuple[NDArray[Any], ...] = (rows.time, rows.sp, rows.pv, rows.op, use, rows.fresh)
    if np.count_nonzero(use[around]) >= SEARCHED_ROWS // 2:
        told = tuple(column[around] for column in told)
    longest = LONGEST_FILTER_SHARE * float(told[0][-1] - told[0][0])
    limits = (rows.period, longest, float(least), float(most))
    t, d, s = search(told, known.law(rows), known.active, gains, walk, limits)
    return Place(float(t), float(d), float(s))


def left_at(rows: Rows, known: Known, gains: Array, walk: float, place: Place) -> float:
    """Return the sum of squares at a place, of all rows that have their answer."""
    m = products(_white(rows, known, walk, place)[0])
    return float(solved(m, known.active)[1] if math.isnan(gains[0]) else left_by_known(m, gains))


def estimate(rows: Rows, known: Known, walk: float, place: Place) -> Estimate:
    """Fit the gains of the known structure at a place."""
    white, n = _white(rows, known, walk, place)
    m = products(white)
    active = known.active
    gains, s = solved(m, active)
    own = m.diagonal()[active]
    scale = np.where(own > LEAST_PRODUCT, np.sqrt(own), 1.0)  # a column that is nothing says nothing
    scales = scale[:, None] * scale
    scaled = m[active][:, active] / scales + RIDGE_SHARE * np.eye(len(active))
    inverse = np.linalg.inv(scaled) / scales
    reach = int(min(4 + n ** (1 / 3), n // 4))
    robust = inverse @ scores(white, gains, active, reach) @ inverse
    least = (LEAST_REST_SHARE if rows.stride == 1 else THINNED_SHARE) ** 2 * float(m[OP, OP]) / max(n, 1)
    plain = max(s / max(n - len(active), 1), least) * inverse
    variance = np.maximum(robust.diagonal(), plain.diagonal())
    sd = np.zeros(4)
    sd[active] = np.sqrt(np.maximum(variance, 0.0))
    if_noise = _without_noise(rows, known, walk, place, (m, gains, s))
    alone = math.inf
    if known.integral:
        alone = float(gains[INTEGRAL]) ** 2 / float(inverse[1, 1])  # what the integral alone explains
    ratio = 1.0 + s / alone if alone > 0 else math.inf
    return Estimate(gains, sd[:OP_GAINS], if_noise, Place(place.filter_time, place.late, float(s)), n, ratio)


@lru_cache(maxsize=32)
def _white_noise(n: int) -> Array:
    """Return the same noise each time."""
    return np.random.default_rng(0).standard_normal(n)


def _without_noise(
    rows: Rows, known: Known, walk: float, place: Place, fit: tuple[Array, Array, float]
) -> Array:
    """Return gains without the bias by as much noise of PV as would leave all that is left of OP; NaN: without bounds.

    Noise adds to the products of the columns what it adds to them alone, and the gains times that to the squares left:
    both are taken away (Koopmans 1937; the noise is white before the columns are made of it).
    """
    m, gains, s = fit
    active = known.active
    noise = replace(rows, sp=np.zeros(len(rows)), pv=_white_noise(len(rows)))
    own = products(_white(noise, known, walk, place)[0])
    per = float(gains @ own[:OP, :OP] @ gains)
    share = s / per if per > 0 else 0.0
    left = (m - share * own)[active][:, active]
    scale = np.sqrt(np.maximum(m.diagonal()[active], LEAST_PRODUCT))
    scaled = left / (scale[:, None] * scale) + RIDGE_SHARE * np.eye(len(active))
    out = np.full(4, np.nan)
    if np.isfinite(scaled).all() and np.linalg.eigvalsh(scaled)[0] > 0.0:
        out[:] = 0.0
        out[active] = np.linalg.solve(scaled, m[active, OP] / scale) / scale
    return out[:OP_GAINS]


def explained(rows: Rows, known: Known, gains: Array, place: Place, walk: float) -> float:
    """Return the share of OP that known gains explain: of levels (walk 0) or of moves from row to row (walk 1)."""
    m = products(_white(rows, known, walk, place)[0])
    allowed = _rounded_away(rows, walk)
    return float(1.0 - max(left_by_known(m, gains) - allowed, 0.0) / m[OP, OP]) if m[OP, OP] > 0 else 0.0


def is_exact(rows: Rows, known: Known, found: Estimate, share: float = LEFT_SHARE) -> bool:
    """Whether gains leave no more than a share of OP's moves beside rounding, and the moves are more than rounding."""
    m = products(_white(rows, known, 1.0, found.place)[0])
    allowed, moves = _rounded_away(rows, 1.0), float(m[OP, OP])
    return allowed < MOST_ROUNDED_SHARE * moves and left_by_known(m, found.gains) - allowed < share * moves


def _rounded_away(rows: Rows, walk: float) -> float:
    """Return the squares that rounding of OP leaves, of moves or of levels."""
    return float(rows.quantum**2 / (6.0 if walk == 1.0 else 12.0) * np.count_nonzero(rows.use))


def _white(rows: Rows, known: Known, walk: float, place: Place) -> tuple[Array, int]:
    late = int(place.late)
    use = rows.use.copy()
    use[: max(late, 0)] = False
    use[len(use) + min(late, 0) :] = False
    x = columns(rows.time, rows.sp, rows.pv, known.law(rows), place.filter_time, late)
    white, _, n = whitened(x, rows.op, use, rows.fresh, walk)
    return white, int(n)
