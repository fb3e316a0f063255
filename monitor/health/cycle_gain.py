"""What a sustained cycle tells of an integrating process: its gain, from the amplitudes of PV and OP.

At the cycle's frequency an integrating process of gain K and dead time theta answers OP with K/omega, late by a quarter
of a cycle and the dead time (K. J. Åström, T. Hägglund, Automatica 20 (1984) 645-651: of a relay's cycle; here it is
the loop's own). So K = omega A_pv / A_op, whatever the controller is.

That holds where the loop itself sustains its cycle. Under a load that swings by itself PV over OP is but the
controller's own answer upside down, and K too small or too large; both look the same in PV and OP. Whoever relies on K
asks whether such a gain, with the settings in use, makes the loop cycle at this frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.compiled import jit

from .episodes import Episode, episodes_of

Array = NDArray[np.float64]

LEAST_CYCLES = 4
"""Whole cycles, without which their scatter says little."""
PERIOD_SHARE = 0.15
"""By which the period may differ from the episode's, in the search for the one that explains most."""
PERIODS_TRIED = 61
"""In that range: half a per cent apart, a tenth of a cycle over twenty."""
PHASE_SLACK = math.radians(12.0)
"""By which the phase may lie outside an integrator's: a sample late of forty, and the error over some cycles."""
EXPLAINED_SHARE = 0.5
"""Least share of each signal's variance, freed of a slope in each cycle, at the cycle's frequency: sine 1, square
0.8, sawtooth 0.6."""
MODEL_SHARE = 0.05
"""Of the gain, added to its interval: a lag of a twentieth of the cycle takes that off, and no scatter shows it."""
ROUNDING_SHARE = 1e-9
"""Of a signal: what is left of a constant."""
T_95 = (12.7, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26, 2.23)
"""Student's t at 97.5 %, by degrees of freedom from 1 on; 2.2 from there on."""


@dataclass(frozen=True, slots=True)
class CycleGain:
    """What PV and OP do at the frequency of a cycle."""

    period: float
    """Of the cycle [s]."""
    cycles: int
    """Whole ones that were looked at."""
    pv_amplitude: float
    """Of the first harmonic [PV]."""
    op_amplitude: float
    """Of the first harmonic [OP]."""
    phase: float
    """Of PV against OP, -pi to pi; below 0: PV is late [rad]."""
    gain: float
    """Of an integrating process, signed [PV/(OP s)]."""
    gain_lo: float
    gain_hi: float
    """95 % interval by the scatter from cycle to cycle, and what a lag may hide [PV/(OP s)]."""
    dead_time: float
    """By which PV is later than an integrator's quarter of a cycle, lags among it [s]; 0 where it is not later."""
    integrating: bool
    """Whether the phase may be that of an integrator and a dead time: PV late by a quarter to half a cycle.

    It speaks against an integrator, never for one: behind a PI controller any process has that phase in a cycle.
    """


def cycle_gain(pv: Array, op: Array, period: float, cycle: Episode | None = None) -> CycleGain | None:
    """Return ratio and phase of PV against OP at a cycle's frequency; None where there is no sustained cycle in both.

    Parameters
    ----------
    pv, op : ndarray
        (N,) samples equally spaced in time, in automatic, without a gap, the set point at rest [PV], [OP].
    period : float
        Sample period [s].
    cycle : Episode, optional
        Where it is known from the error; without it the longest of PV's.
    """
    if cycle is None:
        spans = episodes_of(pv, period) or []
        cycle = max((s for s in spans if s.strong), key=lambda s: s.end - s.start, default=None)
    if cycle is None or not np.isfinite(op).all():
        return None
    part = slice(cycle.start, cycle.end)
    length = _sharpened(pv[part], cycle.period / period)
    y, y_share = _harmonics(pv[part], length)
    u, u_share = _harmonics(op[part], length)
    if len(y) < LEAST_CYCLES or min(y_share, u_share) < EXPLAINED_SHARE:
        return None
    power = float(np.sum(np.abs(u) ** 2))
    ratio = complex(np.sum(y * np.conj(u))) / power
    # one cycle's part in the scatter goes with its power (derived: weighted least squares)
    rest = float(np.sum(np.abs(y - ratio * u) ** 2)) / (2 * (len(y) - 1))
    t = T_95[len(y) - 2] if len(y) - 2 < len(T_95) else 2.2
    omega = 2.0 * math.pi / (length * period)
    phase = math.atan2(ratio.imag, ratio.real)
    later, sign = _integrators(phase)
    gain = sign * abs(ratio) * omega
    half = math.hypot(t * math.sqrt(rest / power) * omega, MODEL_SHARE * gain)
    return CycleGain(
        period=length * period,
        cycles=len(y),
        pv_amplitude=float(np.sqrt(np.mean(np.abs(y) ** 2))),
        op_amplitude=float(np.sqrt(np.mean(np.abs(u) ** 2))),
        phase=phase,
        gain=gain,
        gain_lo=gain - half,
        gain_hi=gain + half,
        dead_time=max(later, 0.0) / omega,
        integrating=-PHASE_SLACK <= later <= 0.5 * math.pi + PHASE_SLACK,
    )


def _integrators(phase: float) -> tuple[float, float]:
    """Return by how much a phase is later than an integrator's [rad], and the integrator's sign: that which fits."""
    late = [
        (-phase - quarter + math.pi) % (2.0 * math.pi) - math.pi
        for quarter in (0.5 * math.pi, -0.5 * math.pi)
    ]
    # from 0 to a quarter of a cycle later is possible: the sign nearer to its middle
    direct = abs(late[0] - 0.25 * math.pi) <= abs(late[1] - 0.25 * math.pi)
    return (late[0], 1.0) if direct else (late[1], -1.0)


def _sharpened(x: Array, length: float) -> float:
    """Return the period near the given one at which most of a signal swings [samples]."""
    # in steps of a fraction of what a record of so many cycles tells apart
    reach = min(PERIOD_SHARE, 2.0 * length / len(x))
    tried = length * np.linspace(1.0 - reach, 1.0 + reach, PERIODS_TRIED)
    return float(tried[_strongest((x - np.mean(x)) * np.hanning(len(x)), 2.0 * np.pi / tried)])


@jit
def _strongest(x, turns):
    """Return which of some frequencies, each in turns from sample to sample [rad], is the strongest."""
    cos, sin = np.cos(turns), np.sin(turns)
    real, imag, at_real, at_imag = np.zeros((4, len(turns)))
    at_real += 1.0
    for v in x:
        for k in range(len(turns)):  # over frequencies the compiler takes four at a time, over samples none
            real[k] += v * at_real[k]
            imag[k] += v * at_imag[k]
            before = at_real[k]
            at_real[k] = before * cos[k] - at_imag[k] * sin[k]
            at_imag[k] = before * sin[k] + at_imag[k] * cos[k]
    return np.argmax(real * real + imag * imag)


@jit
def _harmonics(x, length):
    """Return each whole cycle's first harmonic, and its share of the variance about a slope in each cycle."""
    n, count = len(x), 0
    harmonics, of_first, of_all = np.empty(n, np.complex128), 0.0, 0.0
    for k in range(int((n + 0.5) / length)):
        first, last = round(k * length), min(round((k + 1) * length), n)
        if last - first < 4:
            break
        angle = 2.0 * np.pi * np.arange(first, last) / length
        cos, sin, y = np.cos(angle), np.sin(angle), x[first:last] - x[first:last].mean()
        slope, real, imag = _fitted(cos - cos.mean(), sin - sin.mean(), y)
        harmonics[count] = complex(real, -imag)
        count += 1
        for i in range(last - first):
            of_all += (y[i] - slope * (i - 0.5 * (last - first - 1))) ** 2
            of_first += (real * cos[i] + imag * sin[i]) ** 2
    least = n * (ROUNDING_SHARE * np.abs(x).max()) ** 2
    return harmonics[:count], of_first / of_all if of_all > least else 0.0


@jit
def _fitted(cos, sin, y):
    """Return the slope and the parts of cosine and sine that explain a signal best, all of them without their means."""
    uu = uc = us = uy = cc = cs = ss = cy = sy = 0.0
    for i in range(len(y)):
        u = i - 0.5 * (len(y) - 1)
        uu += u * u
        uc += u * cos[i]
        us += u * sin[i]
        uy += u * y[i]
        cc += cos[i] * cos[i]
        cs += cos[i] * sin[i]
        ss += sin[i] * sin[i]
        cy += cos[i] * y[i]
        sy += sin[i] * y[i]
    cc, cs, ss = cc - uc * uc / uu, cs - uc * us / uu, ss - us * us / uu  # what the slope leaves
    cy, sy = cy - uc * uy / uu, sy - us * uy / uu
    det = cc * ss - cs * cs
    real, imag = (cy * ss - sy * cs) / det, (sy * cc - cy * cs) / det
    return (uy - uc * real - us * imag) / uu, real, imag
