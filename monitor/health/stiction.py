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

from monitor.compiled import jit

from .fields import clearing, halving

CYCLE_MOST_AVERAGES, CYCLE_LEAST_AVERAGES = 63, 4
"""Averages in a cycle at most, those that a level's block still holds, and at least."""
MEMORY_AVERAGES = 64
"""Averages over which the mean and the size of the error are taken: two to seven cycles."""
HYSTERESIS_SHARE = 0.6
"""Of the error's mean size: how far it must go to the other side of its mean to count as crossing it; a third of the
amplitude."""
SHAPE_AVERAGES = 8.0
"""A level at which a cycle has fewer averages than this is too coarse for its shape; the next finer one is taken."""
MANY_CYCLES = 1024.0
"""Cycles after which sums are halved."""
STICTION_CYCLES = 5.0
"""Cycles (ten half-waves) without which nothing is said."""
RED_POWER = 0.5
"""Power of the second harmonic beyond the fourth that a wandering load makes, over the squared spread of amplitudes
that it makes, too (0.4 where its power falls with the square of the frequency)."""
SIZE_CLASSES, CLASSES_PER_OCTAVE = 32, 6
"""Classes of amplitude, a sixth of an octave each, and all octaves beyond the first five folded onto these."""
PROOF_CYCLES = 12.0
"""Cycles whose likeness counts in full: a few that noise makes may be alike by chance."""
UNLIKE_LN, UNEVEN_SHARE = 0.7, 1.3
"""Spread of the cycles' amplitude and coefficient of variation of their length that are not regular at all, each
alone; at half of them the regularity is 0.5. Noise through a resonance makes 0.52 in amplitude (Rayleigh), sticking
valves 0.03 to 0.25, but up to 0.5 in length."""
CHANCE_LN = 0.5
"""By how much the amplitudes of one cycle seem too alike; of many, over the root of their number."""
BROKEN_SHARE = 0.25
"""Share of the time in cycles that were broken off, up to which it does not matter."""
HARMONICS_SHARE, CERTAIN_SHARE = 0.165, 0.1
"""Harmonics, as a share of the first, at which a sine and a sticking valve are equally likely (measured on simulated
loops: sines below 0.15 even in much noise, sticking valves above 0.18), and by how much more it is certain."""
STEADY_LN, UNSTEADY_LN = 0.25, 0.15
"""Spread of the cycles' amplitude up to which a sticking valve is as likely as the shape says, and by how much more
it is half as likely."""

SUMS: list[Any] = [
    ("cycles", "f8"),  # complete ones
    ("length", "f8"),  # averages in these
    ("length_squares", "f8"),  # averages^2, of each cycle
    ("lost", "f8"),  # averages in cycles too short or broken off
    # [PV^2] power of the first harmonic; third harmonic locked to it, real and imaginary part; power of the second
    # harmonic and power of the fourth
    ("shape", "f8", (5,)),
    ("times", "u2", (SIZE_CLASSES,)),  # averages in cycles of each class of amplitude
]
RUNNING: list[Any] = [
    ("averages", "i8"),  # in the cycle that runs, 0 if none does
    ("side", "i8"),  # of the mean on which the error was last: 1 or -1, 0 before that is known
]
KEPT: list[Any] = [
    ("mean", "f8"),  # [PV] of the error
    ("size", "f8"),  # [PV] mean distance from it
    ("unit", "f8"),  # [PV] amplitude of the first cycle, to which the classes refer; 0 before it
    ("seen", "i8"),  # averages in mean and size, up to those of the memory
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT])

decay = halving(SUMS)
reset = clearing(RUNNING)
forget = clearing([*SUMS, *RUNNING, *KEPT])


@jit
def update(own, block, e, at):
    """Take in an average of the error [PV] at a level; ``at``: its place in the level's block."""
    n = own.seen
    if n < MEMORY_AVERAGES:
        n += 1
        own.seen = n
        if n == 1:
            own.mean = e
    d = e - own.mean
    weight = 1.0 / n
    own.mean += weight * d
    own.size += weight * (abs(d) - own.size)
    band = HYSTERESIS_SHARE * own.size
    if own.side >= 0:
        if d < -band:
            own.side = -1
    elif d > band:
        own.side = 1
        if own.averages > 0:
            _close(own, block, e, at)
        own.averages = 1
        return
    if own.averages > 0:
        own.averages += 1
        if own.averages > CYCLE_MOST_AVERAGES:
            own.lost += CYCLE_MOST_AVERAGES
            own.averages = 0


@jit
def break_off(own):
    """Drop the cycle that runs, where noise hides it."""
    own.averages = 0


@jit
def _close(own, block, e, at):
    """Take a complete cycle into the sums; ``e`` is the first average of the next."""
    n = own.averages
    if n < CYCLE_LEAST_AVERAGES:
        own.lost += n
        return
    if own.cycles > MANY_CYCLES:
        decay(own)
    a = np.sqrt(_harmonics(block, at - n, n, e, own.shape))
    own.cycles += 1.0
    own.length += n
    own.length_squares += n * n
    if own.unit == 0.0:
        own.unit = a
    if a > 0.0:
        i = int(np.floor(np.log2(a / own.unit) * CLASSES_PER_OCTAVE + 0.5)) % SIZE_CLASSES
        own.times[i] += n


@jit
def _harmonics(ring, start, n, after, shape):
    """Add one cycle of ``n`` averages, less its drift, to the sums of its shape; return its first harmonic's power."""
    last = len(ring) - 1
    first = ring[start & last]
    slope = (after - first) / n
    c, s = np.cos(2.0 * np.pi / n), -np.sin(2.0 * np.pi / n)
    x1, y1 = 1.0, 0.0
    r1 = i1 = r2 = i2 = r3 = i3 = r4 = i4 = 0.0
    for i in range(n):
        v = ring[(start + i) & last] - first - slope * i
        r1 += v * x1
        i1 += v * y1
        if n >= SHAPE_AVERAGES:
            x2, y2 = x1 * x1 - y1 * y1, 2.0 * x1 * y1
            r2 += v * x2
            i2 += v * y2
            r3 += v * (x1 * x2 - y1 * y2)
            i3 += v * (x1 * y2 + y1 * x2)
            r4 += v * (x2 * x2 - y2 * y2)
            i4 += v * 2.0 * x2 * y2
        x1, y1 = x1 * c - y1 * s, x1 * s + y1 * c
    scale = 4.0 / (n * n)
    power = scale * (r1 * r1 + i1 * i1)
    if n >= SHAPE_AVERAGES and power > 0.0:
        u = complex(r1, -i1) / np.sqrt(r1 * r1 + i1 * i1)
        locked = complex(r3, i3) * u * u * u * np.sqrt(scale * power)
        shape[0] += power
        shape[1] += locked.real
        shape[2] += locked.imag
        shape[3] += scale * (r2 * r2 + i2 * i2)
        shape[4] += scale * (r4 * r4 + i4 * i4)
    return power


def spread_of(own: Any) -> float:
    """Return how far the logarithms of the cycles' amplitudes spread, as a standard deviation.

    It is that of a normal distribution with the same shortest interval that holds half of the time: answers to steps
    and cycles cut in two by noise are left out (derived).
    """
    sizes = own["times"].astype(np.float64)
    half = 0.5 * float(sizes.sum())
    if half <= 0.0:
        return 1.0
    twice = np.concatenate([[0.0], np.cumsum(np.tile(sizes, 2))])
    edges = np.arange(len(twice), dtype=np.float64)
    after = np.interp(twice[: SIZE_CLASSES + 1] + half, twice, edges) - edges[: SIZE_CLASSES + 1]
    before = edges[SIZE_CLASSES:] - np.interp(twice[SIZE_CLASSES:] - half, twice, edges)
    width = min(float(after.min()), float(before.min()))
    return width * math.log(2.0) / CLASSES_PER_OCTAVE / 1.349


def mean_length_of(own: Any) -> float:
    """Return the mean length of the cycles [averages]; there is one at least."""
    return float(own["length"] / own["cycles"])


def likeness_of(own: Any, chance: float = CHANCE_LN) -> float:
    """How alike a level's cycles are in amplitude and length, 0 to 1; less where few, or many broken off."""
    n = float(own["cycles"])
    if n < 1.0:
        return 0.0
    amplitude = spread_of(own) + chance / math.sqrt(n)
    length = math.sqrt(max(n * own["length_squares"] / own["length"] ** 2 - 1.0, 0.0))
    whole = min(float(own["length"] / (own["length"] + own["lost"])) / (1.0 - BROKEN_SHARE), 1.0)
    alike = max(1.0 - math.hypot(amplitude / UNLIKE_LN, length / UNEVEN_SHARE), 0.0)
    return alike * whole * min(n / PROOF_CYCLES, 1.0)


def stiction_of(own: Any) -> float | None:
    """How surely a level's cycles are a sticking valve's, 0 to 1; None without cycles enough."""
    n = float(own["cycles"])
    if n < STICTION_CYCLES or own["shape"][0] <= 0.0:
        return None
    third, second = _harmonics_of(own["shape"])
    variation = spread_of(own)
    second = math.sqrt(max(second * second - RED_POWER * variation * variation, 0.0))
    shape = min(max(0.5 + 0.5 * (abs(third) + second - HARMONICS_SHARE) / CERTAIN_SHARE, 0.0), 1.0)
    steady = min(max(1.0 - 0.5 * (variation - STEADY_LN) / UNSTEADY_LN, 0.0), 1.0)
    return shape * steady


def _harmonics_of(shape: Any) -> tuple[complex, float]:
    """Return the third harmonic locked to the first, and the second's size beyond noise, as shares of the first."""
    power = max(float(shape[0]), 1e-300)
    return complex(shape[1], shape[2]) / power, math.sqrt(max(float(shape[3] - shape[4]), 0.0) / power)
