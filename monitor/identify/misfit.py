"""What a model leaves unexplained of a window, read as an error of the model that further settings have to bear.

Model error modelling (Reinelt, Garulli & Ljung 2002): what is left of PV is regressed on OP through a family of
second-order modes, one at a time. What gain, dead time, lags, or a load's size and onset could have explained is
taken out before: it belongs to the region of the model's parameters. Residuals are weighed against the noise before
the event, not against PV's movement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import median
from monitor.compiled import jit
from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from tuners.models import INTEGRATING

from .direct import parts_of_pv
from .fit import Fit
from .projection import Beside, filter_of, innovations
from .window import op_from_rest

MOST_CELLS = 400
"""Points of the grid on which residuals are looked at; means over more of them."""
MOST_FINE_POINTS = 4000
"""Points of the regular grid through the samples before that: long gaps between close samples are not filled up."""
LEAST_CELLS = 30
"""Points below which nothing is told apart."""
FREQUENCY_RATIO = 1.13
"""From one frequency to the next: powers of it, so that they are the same in all events of a loop."""
LEAST_CYCLES = 1.5
"""Cycles of the slowest mode in the window."""
NYQUIST_SHARE, CLOSE_NYQUIST_SHARE = 0.6, 0.85
"""Of the fastest mode in the grid's Nyquist frequency, and in the samples' own where these are looked at one by one."""
CLOSE_FROM_SHARE = 0.5
"""Of the fastest mode in means over several samples: from there on samples are looked at one by one."""
DAMPINGS = np.array([0.02, 0.05, 0.12, 0.3, 0.6])
"""From a resonance to a lag."""
OPEN_DAMPING = 0.05
"""Least damping of a mode that is not seen but might be there."""
OPEN_SD = 2.0
"""Standard deviations of an error that would not have been seen."""
SUSPECT_CHI = 6.0
"""Power from which a mode that is not seen is taken for as large as it looks: noise alone gives as much to one of
twenty."""
CLOSE_STEPS, CLOSE_COUNT, CLOSE_DAMPINGS = 0.8, 9, np.array([0.01, 0.02, 0.05, 0.12])
"""Steps of the grid to either side of the mode that explains most, frequencies there, and dampings."""
SEEN_CHI = 20.0
"""Power that a mode explains, in variances of the noise, from which it is no chance: 180 modes are tried."""
ALIKE_SHARE, ALIKE_BROAD_SHARE = 1e-6, 3e-4
"""Share of a mode's power that is left, once the parameters have had their part, below which it is none of its own.
Little is left of one that rings, for most of its power is its gain at rest; one that does not ring is then a lag."""
BROAD_DAMPING = 0.3
"""From which a mode hardly rings."""
LEAST_NOISE_SHARE = 0.007
"""Least noise that is reckoned with, as a share of PV's range: a model of few lags is no closer to many."""


@dataclass(frozen=True, eq=False, slots=True)
class OpenModes:
    """Modes of which none is seen, and what each might be: shape (m,)."""

    omega: Array
    """[rad/s]"""
    damping: Array
    in_phase: Array
    """Size of the error there as it looks, and by the mode's slope [PV/OP]."""
    across: Array
    sd: Array
    """Standard deviation of each of the two [PV/OP]."""

    @property
    def bound(self) -> Array:
        """Size of an error that is not excluded: two standard deviations, or as it looks where one is suspected."""
        open_ = np.where(self.damping >= OPEN_DAMPING, OPEN_SD * self.sd, 0.0)
        return np.maximum(open_, np.where(self.suspect, self._size, 0.0))

    @property
    def suspect(self) -> NDArray[np.bool_]:
        """Where there looks to be one."""
        return np.asarray(self._size**2 > SUSPECT_CHI * self.sd**2)

    @property
    def _size(self) -> Array:
        return np.asarray(np.hypot(self.in_phase, self.across))


@dataclass(frozen=True, eq=False, slots=True)
class ModelError:
    """The error of a model that a window shows, mode by mode; empty where none is seen."""

    omega: Array
    """(k,) [rad/s]."""
    bound: Array
    """(k,) Size of the error there, one standard deviation added [PV/OP]."""
    chi: Array
    """(k,) Power that the mode explains, in variances of the noise."""
    unseen: OpenModes
    """What may be there beside."""

    @property
    def size(self) -> float:
        """Largest error, weighed by its frequency: for an integrator a slow mode is then no larger than a fast one."""
        return float(np.max(self.bound * self.omega, initial=0.0))


NOTHING_UNSEEN = OpenModes(*np.zeros((5, 0)))
NOTHING_SEEN = ModelError(np.zeros(0), np.zeros(0), np.zeros(0), NOTHING_UNSEEN)


def together(errors: Sequence[ModelError]) -> ModelError:
    """Return the least of the errors that events of a loop show, and what all of those as small leave open.

    An error of the model shows in every event. What an event leaves open is noise, and less in several: the mean of
    each mode's size, weighed by its variance.
    """
    least = min(errors, key=lambda error: error.size)
    alike = [error.unseen for error in errors if error.size == least.size]
    names = ("omega", "damping", "in_phase", "across", "sd")
    omega, damping, in_phase, across, sd = (np.concatenate([getattr(m, n) for m in alike]) for n in names)
    modes, which = np.unique(np.stack([omega, damping]), axis=1, return_inverse=True)
    weight = 1.0 / sd**2
    total = np.bincount(which, weight)
    in_phase, across = (np.bincount(which, weight * size) / total for size in (in_phase, across))
    return replace(least, unseen=OpenModes(modes[0], modes[1], in_phase, across, 1.0 / np.sqrt(total)))


def model_error(window: EventWindow, fit: Fit, noise: float) -> ModelError:
    """Return what a window shows of its model's error, mode by mode.

    For each mode of frequency w and damping zeta (derived): ``z1 = w^2/(s^2 + 2 zeta w s + w^2) u``,
    ``z2 = w s/(...) u``, exact for held OP, and ``a = (Z'Z)^-1 Z'r`` of the residuals r, all projected. It is seen
    where ``chi = a'(Z'Z)a/var > 20``, and the process may differ from its model by ``|a|/(2 zeta)`` and one
    standard deviation of that at w. About the mode that explains most, frequencies and dampings are closer.

    Parameters
    ----------
    window
        The event's window.
    fit
        Its own model.
    noise
        Standard deviation of PV's noise before the event [PV].
    """
    # what came beside a set-point step may as well be the model's error
    moved = parts_of_pv(window, fit if fit.size is not None else replace(fit, other=None))
    cells = _cells(window, fit, moved)
    if cells is None:
        return NOTHING_SEEN
    slowest = 2.0 * math.pi * LEAST_CYCLES / (len(cells.basis) * cells.step)
    fastest = NYQUIST_SHARE * math.pi / cells.step
    least = max(noise, LEAST_NOISE_SHARE * float(np.ptp(window.pv))) ** 2
    # means over several samples show nothing of what is faster
    close = _cells(window, fit, moved, one_by_one=True) if cells.each > 1 else None
    if close is None:
        parts = _looked_at(cells, _grid(slowest, fastest), least)
    else:
        between = CLOSE_FROM_SHARE * fastest
        parts = _looked_at(cells, _grid(slowest, between), least)
        parts += _looked_at(close, _grid(between, CLOSE_NYQUIST_SHARE * math.pi / close.step), least)
    every = _Modes(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    seen, unseen = every.take(every.chi > SEEN_CHI), every.take(every.chi <= SEEN_CHI)
    left_open = OpenModes(unseen.omega, unseen.damping, unseen.in_phase, unseen.across, unseen.sd)
    return ModelError(seen.omega, seen.bound, seen.chi, left_open)


def _grid(low: float, high: float) -> Array:
    """Return the frequencies from one on and below another [rad/s]."""
    first, last = (math.ceil(math.log(x) / math.log(FREQUENCY_RATIO)) for x in (low, high))
    return np.asarray(FREQUENCY_RATIO ** np.arange(first, last, dtype=float))


def _looked_at(cells: _Cells, grid: Array, least: float) -> list[_Modes]:
    """Return the modes of a grid of frequencies, and closer ones about that which explains most.

    ``least`` is the variance of a sample's noise.
    """
    least = least / cells.each
    found = _regressed(cells, grid, DAMPINGS, least)
    seen = found.alone & (found.chi > SEEN_CHI)
    parts = [found.take(found.alone)]
    if np.any(seen):
        top = int(np.argmax(np.where(seen, found.chi, 0.0)))
        if found.damping[top] < DAMPINGS[-2]:
            near = np.linspace(-CLOSE_STEPS, CLOSE_STEPS, CLOSE_COUNT)
            closer = _regressed(cells, found.omega[top] * FREQUENCY_RATIO**near, CLOSE_DAMPINGS, least)
            parts.append(closer.take(closer.alone & (closer.chi > SEEN_CHI)))
    return parts


class _Modes(NamedTuple):
    """What each of some modes explains."""

    omega: Array
    damping: Array
    in_phase: Array
    across: Array
    sd: Array
    chi: Array
    alone: NDArray[np.bool_]
    """Whether it differs from what the parameters explain."""

    @property
    def bound(self) -> Array:
        """Size, and one standard deviation."""
        return np.asarray(np.hypot(self.in_phase, self.across) + self.sd)

    def take(self, where: NDArray[np.bool_]) -> _Modes:
        """Return some of them."""
        columns = (self.omega, self.damping, self.in_phase, self.across, self.sd, self.chi)
        omega, damping, in_phase, across, sd, chi = (column[where] for column in columns)
        return _Modes(omega, damping, in_phase, across, sd, chi, self.alone[where])


def _regressed(cells: _Cells, frequencies: Array, dampings: Array, least: float) -> _Modes:
    """Regress the residuals on each mode of these frequencies and dampings; ``least`` is the noise's variance."""
    n, p = cells.basis.shape
    omega, damping = np.repeat(frequencies, len(dampings)), np.tile(dampings, len(frequencies))
    modes = _responses(cells.op, cells.step, omega, damping, cells.beside)
    one, two, b = modes[0::2], modes[1::2], modes @ cells.residual
    taken = modes @ cells.basis
    power = np.einsum("ij,ij->i", modes, modes)
    own = power - np.einsum("ij,ij->i", taken, taken)
    g11, g22 = own[0::2], own[1::2]
    g12 = np.einsum("ij,ij->i", one, two) - np.einsum("ij,ij->i", taken[0::2], taken[1::2])
    with np.errstate(divide="ignore", invalid="ignore"):
        det = g11 * g22 - g12 * g12
        a1, a2 = (g22 * b[0::2] - g12 * b[1::2]) / det, (g11 * b[1::2] - g12 * b[0::2]) / det
        explained = a1 * b[0::2] + a2 * b[1::2]
        rest = float(cells.residual @ cells.residual) - explained
        var = np.maximum(rest / (n - p - 2), least)
        sd = np.sqrt(var * (g11 + g22) / det / 2.0) / (2.0 * damping)
        in_phase, across = a1 / (2.0 * damping), a2 / (2.0 * damping)
        alike = np.where(damping < BROAD_DAMPING, ALIKE_SHARE, ALIKE_BROAD_SHARE)
        alone = (np.minimum(g11 / power[0::2], g22 / power[1::2]) > alike) & (det > ALIKE_SHARE * g11 * g22)
        alone &= np.isfinite(in_phase + across + sd)
        return _Modes(omega, damping, in_phase, across, sd, explained / var, alone)


class _Cells(NamedTuple):
    """A window on a regular grid."""

    step: float
    """[s]"""
    each: int
    """Points of a cell."""
    op: Array
    """(n,) mean, from rest [OP]."""
    residual: Array
    """(n,) mean, projected [PV]."""
    basis: Array
    """(n, p) orthonormal: what parameters explain."""
    beside: Beside
    """What goes on in PV's noise: all of these are innovations then."""


def _cells(window: EventWindow, fit: Fit, moved: list[Array], *, one_by_one: bool = False) -> _Cells | None:
    """Lay a window's residuals out on a regular grid; None where it is too short.

    ``moved`` are the parts of PV's movement that the model explains, each (n,). ``one_by_one``: not all of it in means
    over several samples, but each of the first ones since the step.
    """
    t, u = window.time, op_from_rest(window, fit.size is not None)
    kind = 0 if fit.process == INTEGRATING else 1
    span = float(t[-1] - t[0])
    fine = max(median(np.diff(t)), span / MOST_FINE_POINTS)
    count = int(span / fine * (1.0 + 1e-9)) + 1
    each = 1 if one_by_one else -(-count // MOST_CELLS)
    at = t[0] + fine * np.arange(count // each * each)
    if one_by_one:
        at = at[at >= (fit.onset or 0.0) - fine][:MOST_CELLS]
    n = len(at) // each
    if n < LEAST_CELLS:
        return None
    # OP is held from sample to sample, PV is not
    held = u[np.searchsorted(t, at + 1e-6 * fine, side="right") - 1]
    residual = window.pv - sum(moved)
    r = np.mean(np.interp(at, t, residual).reshape(n, each), axis=1)
    # where each cell begins, and backwards: what comes later answers, through OP, the very noise that is in it
    shapes = [np.interp(at[::each], t, x) for x in moved]
    line = np.linspace(-1.0, 1.0, n)
    parts = [np.ones(n)] + ([line] if kind == 0 else [])
    for x in shapes:
        slope = np.diff(x, prepend=x[0])
        parts += [x, slope, np.diff(slope, prepend=slope[0])]
    walk = fit.wander
    beside = Beside(False) if walk is None else Beside(False, walk.order, walk.ratio * each)
    if walk is not None:
        by = filter_of(at[::each].copy(), beside)
        for x in (r, *parts):
            innovations(x, by.walk)
    basis = _orthonormal(np.column_stack(parts))
    r = r - basis @ (basis.T @ r)
    op = np.ascontiguousarray(np.mean(held.reshape(n, each), axis=1))
    return _Cells(each * fine, each, op, r, basis, beside)


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis of what the columns span, but for what is rounding."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    left, values, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return np.ascontiguousarray(left[:, values > 1e-7 * values[0]])


@jit
def _responses(u, step, omega, damping, beside):
    """Response of each mode, and its slope over its frequency, to held input, where each of its steps begins.

    (2 k, n), the two of a mode one after the other. Inside a step the controller may have answered PV's noise in it.
    """
    n = len(u)
    out = np.empty((2 * len(omega), n))
    by = filter_of(step * np.arange(n), beside)
    for k in range(len(omega)):
        w, zeta = omega[k], damping[k]
        root = math.sqrt(1.0 - zeta * zeta)
        decay = math.exp(-zeta * w * step)
        cos, sin = decay * math.cos(w * root * step), decay * math.sin(w * root * step) / root
        f11, f12, f22 = cos + zeta * sin, sin, cos - zeta * sin
        a = b = 0.0
        for i in range(n):
            away = a - u[i]
            a_next = u[i] + f11 * away + f12 * b
            b_next = f22 * b - f12 * away
            out[2 * k, i] = a
            out[2 * k + 1, i] = b
            a, b = a_next, b_next
        innovations(out[2 * k], by.walk)
        innovations(out[2 * k + 1], by.walk)
    return out
