"""What a model leaves unexplained of a window, read as an error of the model that further settings have to bear.

Model error modelling (Reinelt, Garulli & Ljung 2002): what is left of PV is regressed on OP through a family of
second-order modes, one at a time. What gain, dead time, lags, or a load's size and onset could have explained is
taken out before: it belongs to the region of the model's parameters. Residuals are weighed against the noise before
the event, not against PV's movement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit
from monitor.contract.samples import Array
from monitor.detect.event import EventWindow
from monitor.median import median
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
FREQUENCY_COUNT = 36
LEAST_CYCLES = 1.5
"""Cycles of the slowest mode in the window."""
NYQUIST_SHARE = 0.6
"""Of the fastest mode in the grid's Nyquist frequency."""
DAMPINGS = np.array([0.02, 0.05, 0.12, 0.3, 0.6])
"""From a resonance to a lag."""
OPEN_DAMPING = 0.05
"""Least damping of a mode that is not seen but might be there."""
OPEN_SD = 2.0
"""Standard deviations of an error that would not have been seen."""
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
class ModelError:
    """The error of a model that a window shows, mode by mode; empty where none is seen."""

    omega: Array
    """(k,) [rad/s]."""
    bound: Array
    """(k,) Size of the error there, one standard deviation added [PV/OP]."""
    chi: Array
    """(k,) Power that the mode explains, in variances of the noise."""
    open_omega: Array
    """(m,) Modes of which none is seen [rad/s]."""
    open_bound: Array
    """(m,) Size of an error there that would not have been seen: two standard deviations [PV/OP]."""

    @property
    def size(self) -> float:
        """Largest error, weighed by its frequency: for an integrator a slow mode is then no larger than a fast one."""
        return float(np.max(self.bound * self.omega, initial=0.0))


NOTHING_SEEN = ModelError(*np.zeros((5, 0)))


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
    cells = _cells(window, fit)
    if cells is None:
        return NOTHING_SEEN
    n = len(cells.basis)
    fastest = NYQUIST_SHARE * math.pi / cells.step
    slowest = 2.0 * math.pi * LEAST_CYCLES / (n * cells.step)
    grid = np.geomspace(slowest, fastest, FREQUENCY_COUNT)
    least = max(noise, LEAST_NOISE_SHARE * float(np.ptp(window.pv))) ** 2 / cells.each
    found = _regressed(cells, grid, DAMPINGS, least)
    seen = found.alone & (found.chi > SEEN_CHI)
    unseen = found.alone & ~seen & (found.damping >= OPEN_DAMPING)
    parts = [found.take(seen)]
    if np.any(seen):
        top = int(np.argmax(np.where(seen, found.chi, 0.0)))
        if found.damping[top] < DAMPINGS[-2]:
            step = math.log(grid[1] / grid[0])
            close = found.omega[top] * np.exp(step * np.linspace(-CLOSE_STEPS, CLOSE_STEPS, CLOSE_COUNT))
            closer = _regressed(cells, close, CLOSE_DAMPINGS, least)
            parts.append(closer.take(closer.alone & (closer.chi > SEEN_CHI)))
    omega, bound, chi = (np.concatenate([getattr(p, n) for p in parts]) for n in ("omega", "bound", "chi"))
    return ModelError(omega, bound, chi, found.omega[unseen], OPEN_SD * found.sd[unseen])


class _Modes(NamedTuple):
    """What each of some modes explains."""

    omega: Array
    damping: Array
    bound: Array
    sd: Array
    chi: Array
    alone: NDArray[np.bool_]
    """Whether it differs from what the parameters explain."""

    def take(self, where: NDArray[np.bool_]) -> _Modes:
        """Return some of them."""
        omega, damping, bound, sd, chi = (
            x[where] for x in (self.omega, self.damping, self.bound, self.sd, self.chi)
        )
        return _Modes(omega, damping, bound, sd, chi, self.alone[where])


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
        bound = np.hypot(a1, a2) / (2.0 * damping) + sd
        alike = np.where(damping < BROAD_DAMPING, ALIKE_SHARE, ALIKE_BROAD_SHARE)
        alone = (np.minimum(g11 / power[0::2], g22 / power[1::2]) > alike) & (det > ALIKE_SHARE * g11 * g22)
        return _Modes(omega, damping, bound, sd, explained / var, alone & np.isfinite(bound))


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


def _cells(window: EventWindow, fit: Fit) -> _Cells | None:
    """Lay a window's residuals out on a regular grid; None where it is too short."""
    t, u = window.time, op_from_rest(window, fit.size is not None)
    kind = 0 if fit.process == INTEGRATING else 1
    # what came beside a set-point step may as well be the model's error
    moved = parts_of_pv(window, fit if fit.size is not None else replace(fit, other=None))
    span = float(t[-1] - t[0])
    fine = max(median(np.diff(t)), span / MOST_FINE_POINTS)
    count = int(span / fine * (1.0 + 1e-9)) + 1
    each = -(-count // MOST_CELLS)
    n = count // each
    if n < LEAST_CELLS:
        return None
    at = t[0] + fine * np.arange(n * each)
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
