"""Whether an oscillation is a sticking valve's: the shape of its cycles, each stretched to the same length.

A sticking valve jumps and rests, so a self-regulating process shows rounded squares and its controller triangles, an
integrating one shows triangles, seldom with equal flanks (Q. P. He, J. Wang, M. Pottmann, S. J. Qin, Ind. Eng. Chem.
Res. 46 (2007) 4549-4560: triangle against sine, half-wave by half-wave). Other oscillations are sines. And the jump
is always as large as the valve sticks: the cycles vary in length, hardly in amplitude, whereas noise that excites a
nervous loop makes cycles of any amplitude.

We compare in the frequency domain (derived), where a sine has one line, and noise averages out: the third harmonic,
turned by three times the phase of the first, summed over the cycles (equal flanks, squares), and the power of the
second harmonic beyond that of the fourth (unequal flanks, of either sign). A periodic disturbance that is no sine
itself, such as a neighbour's sticking valve, looks the same.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .state import jit

CAP = 80
"""Averages in a cycle at most; two thirds longer than the longest expected."""
HYSTERESIS = 0.35
"""Of the amplitude: how far the error must go to the other side of its mean to count as crossing it."""
FINE = 9.0
"""A level at which a cycle has fewer averages than this is too coarse for its shape; the next finer one is taken."""
MANY = 4096.0
"""Cycles after which sums are halved."""
ENOUGH = 5.0
"""Cycles (ten half-waves) without which nothing is said."""
PROOF = 12.0
"""Cycles whose likeness counts in full: a few that noise makes may be alike by chance."""
UNLIKE, UNEVEN = 0.7, 1.3
"""Coefficients of variation of the cycles' amplitude and length that are not regular at all, each alone; at half of
them the regularity is 0.5. Noise through a resonance makes 0.52 in amplitude (Rayleigh), sticking valves 0.03 to 0.25,
but up to 0.5 in length."""
BROKEN = 0.25
"""Share of the time in cycles that were broken off, up to which it does not matter."""
NO_SINE, CERTAIN = 0.165, 0.1
"""Harmonics, as a share of the first, at which a sine and a sticking valve are equally likely (measured on simulated
loops: sines below 0.15 even in much noise, sticking valves above 0.18), and by how much more it is certain."""

_f, _s, _i = np.float64, np.float32, np.int64
FIELDS = [
    *[(n, _i) for n in ("width", "wave_at", "wave_side", "wave_old", "wave_n")],
    *[(n, _f) for n in ("wave_period", "wave_band", "wave_weight", "wave_mean", "wave_e", "wave_op")],
    *[(n, _f) for n in ("cycles", "length", "length2", "swing", "swing2", "lost")],
    ("e_shape", _f, (5,)),
    ("op_shape", _f, (5,)),
    ("wave", _s, (2, CAP)),
]
"""What is kept: the cycle that runs, and sums over those complete. `*_shape`: power of the first harmonic, real and
imaginary part of the third one locked to it, power of the second."""


@jit
def follow(h, width, period, amplitude):
    """Follow an oscillation of this period [samples] and amplitude [PV] in averages over ``width`` samples."""
    if width != h.width or not 0.5 < period / h.wave_period < 2.0:
        forget(h)
        h.width = width
        h.wave_period = period
    h.wave_band = HYSTERESIS * amplitude
    h.wave_weight = min(width / (3.0 * period), 0.2)


@jit
def forget(h):
    """Follow nothing, and know of no cycle."""
    h.width = 0
    h.cycles = h.length = h.length2 = h.swing = h.swing2 = h.lost = 0.0
    h.e_shape[:] = 0.0
    h.op_shape[:] = 0.0
    again(h)


@jit
def again(h):
    """Begin with a new cycle, after a gap, a change of mode or a step of the set point."""
    h.wave_n = h.wave_side = h.wave_old = 0
    h.wave_at = -1
    h.wave_e = h.wave_op = 0.0


@jit
def track(h, e, op):
    """Take in one sample of a loop that is followed."""
    h.wave_e += e
    h.wave_op += op
    h.wave_n += 1
    if h.wave_n < h.width:
        return
    e, op = h.wave_e / h.width, h.wave_op / h.width
    h.wave_e = h.wave_op = 0.0
    h.wave_n = 0
    if h.wave_side == 0:
        h.wave_mean = e
        h.wave_side = -1
    h.wave_mean += h.wave_weight * (e - h.wave_mean)
    d = e - h.wave_mean
    if h.wave_side > 0 and d < -h.wave_band:
        h.wave_side = -1
    elif h.wave_side < 0 and d > h.wave_band:
        h.wave_side = 1
        if h.wave_at > 0:
            _close(h, e, op)
        h.wave_at = 0
    if h.wave_at >= CAP:
        h.lost += CAP
        h.wave_at = -1
    if h.wave_at >= 0:
        h.wave[0, h.wave_at] = e
        h.wave[1, h.wave_at] = op
        h.wave_at += 1


@jit
def _close(h, e, op):
    """Take a complete cycle into the sums; ``e`` and ``op`` are the first averages of the next."""
    n = h.wave_at
    if n < 4:
        h.lost += n
        return
    if h.cycles > MANY:
        h.cycles, h.length, h.length2 = 0.5 * h.cycles, 0.5 * h.length, 0.5 * h.length2
        h.swing, h.swing2, h.lost = 0.5 * h.swing, 0.5 * h.swing2, 0.5 * h.lost
        for i in range(5):
            h.e_shape[i] *= 0.5
            h.op_shape[i] *= 0.5
    a = np.sqrt(_harmonics(h.wave[0], n, e, h.e_shape))
    _harmonics(h.wave[1], n, op, h.op_shape)
    h.cycles += 1.0
    h.length += n
    h.length2 += n * n
    h.swing += a
    h.swing2 += a * a


@jit
def _harmonics(x, n, after, shape):
    """Add one cycle of ``n`` averages, less its drift, to the sums of its shape; return its first harmonic's power."""
    slope = (after - x[0]) / n
    z = np.exp(-2j * np.pi / n)
    z1 = 1.0 + 0j
    a1 = a2 = a3 = a4 = 0j
    for i in range(n):
        v = x[i] - x[0] - slope * i
        z2 = z1 * z1
        a1 += v * z1
        a2 += v * z2
        a3 += v * z1 * z2
        a4 += v * z2 * z2
        z1 *= z
    scale = 2.0 / n
    a1, a2, a3, a4 = scale * a1, scale * a2, scale * a3, scale * a4
    power = a1.real * a1.real + a1.imag * a1.imag
    if power > 0.0:
        size = np.sqrt(power)
        u = a1.conjugate() / size
        locked = a3 * u * u * u * size
        shape[0] += power
        shape[1] += locked.real
        shape[2] += locked.imag
        shape[3] += a2.real * a2.real + a2.imag * a2.imag
        shape[4] += a4.real * a4.real + a4.imag * a4.imag
    return power


def likeness(h: Any) -> float:
    """How alike the cycles are in amplitude and length, 0 to 1; less where there are few, or many were broken off."""
    n = float(h["cycles"])
    if n < 1.0 or h["swing"] <= 0.0:
        return 0.0
    amplitude = math.sqrt(max(n * h["swing2"] / h["swing"] ** 2 - 1.0, 0.0))
    length = math.sqrt(max(n * h["length2"] / h["length"] ** 2 - 1.0, 0.0))
    whole = min(float(h["length"] / (h["length"] + h["lost"])) / (1.0 - BROKEN), 1.0)
    return max(1.0 - math.hypot(amplitude / UNLIKE, length / UNEVEN), 0.0) * whole * min(n / PROOF, 1.0)


def harmonics(shape: Any) -> tuple[complex, float]:
    """Return the third harmonic locked to the first, and the second's size beyond noise, as shares of the first."""
    power = max(float(shape[0]), 1e-300)
    return complex(shape[1], shape[2]) / power, math.sqrt(max(float(shape[3] - shape[4]), 0.0) / power)


def stiction_of(h: Any) -> float | None:
    """How surely the cycles are a sticking valve's, 0 to 1; None without cycles enough."""
    n = float(h["cycles"])
    if n < ENOUGH or h["e_shape"][0] <= 0.0:
        return None
    third, second = harmonics(h["e_shape"])
    shape = min(max(0.5 + 0.5 * (abs(third) + second - NO_SINE) / CERTAIN, 0.0), 1.0)
    variation = math.sqrt(max(n * h["swing2"] / h["swing"] ** 2 - 1.0, 0.0))
    steady = min(max(1.0 - 0.5 * (variation - 0.25) / 0.15, 0.0), 1.0)
    return shape * steady
