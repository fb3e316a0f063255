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

CAP = 63
"""Averages in a cycle at most: those that a level's block still holds."""
LONG = 38.0
"""Averages in a mean cycle at most: from there on the next coarser level sees it, and longer ones, whole."""
FEWEST = 4
"""Averages in a cycle at least."""
MEMORY = 64
"""Averages over which the mean and the size of the error are taken: two to seven cycles."""
HYSTERESIS = 0.6
"""Of the error's mean size: how far it must go to the other side of its mean to count as crossing it; a third of the
amplitude."""
FINE = 8.0
"""A level at which a cycle has fewer averages than this is too coarse for its shape; the next finer one is taken."""
MANY = 1024.0
"""Cycles after which sums are halved."""
ENOUGH = 5.0
"""Cycles (ten half-waves) without which nothing is said."""
RED = 0.5
"""Power of the second harmonic beyond the fourth that a wandering load makes, over the squared spread of amplitudes
that it makes, too (0.4 where its power falls with the square of the frequency)."""
SIZES, PER_OCTAVE = 32, 6
"""Classes of amplitude, a sixth of an octave each, and all octaves beyond the first five folded onto these."""
PROOF = 12.0
"""Cycles whose likeness counts in full: a few that noise makes may be alike by chance."""
UNLIKE, UNEVEN = 0.7, 1.3
"""Spread of the cycles' amplitude and coefficient of variation of their length that are not regular at all, each
alone; at half of them the regularity is 0.5. Noise through a resonance makes 0.52 in amplitude (Rayleigh), sticking
valves 0.03 to 0.25, but up to 0.5 in length."""
CHANCE = 0.5
"""By how much the amplitudes of one cycle seem too alike; of many, over the root of their number."""
BROKEN = 0.25
"""Share of the time in cycles that were broken off, up to which it does not matter."""
NO_SINE, CERTAIN = 0.165, 0.1
"""Harmonics, as a share of the first, at which a sine and a sticking valve are equally likely (measured on simulated
loops: sines below 0.15 even in much noise, sticking valves above 0.18), and by how much more it is certain."""

_f, _i = np.float64, np.int32
_RUNNING = "wave_mean wave_size wave_unit".split()
_SUMS = "cycles length length2 lost".split()


def fields(levels: int) -> list[Any]:
    """Return what is kept at each level: the cycle that runs, and sums over those complete.

    ``wave_unit``: amplitude of the first cycle, to which the classes of amplitude refer; ``times``: averages in cycles
    of each class; ``shape``: power of the first harmonic, real and imaginary part of the third one locked to it, power
    of the second and of the fourth.
    """
    running: list[Any] = [(n, _i, (levels,)) for n in ("wave_n", "wave_at", "wave_side")]
    sums: list[Any] = [(n, _f, (levels,)) for n in (*_RUNNING, *_SUMS)]
    return [*running, *sums, ("times", np.uint16, (levels, SIZES)), ("shape", _f, (levels, 5))]


@jit
def forget(h):
    """Know of no cycle."""
    h.cycles[:] = 0.0
    h.length[:] = 0.0
    h.length2[:] = 0.0
    h.times[:] = 0
    h.lost[:] = 0.0
    h.shape[:] = 0.0
    h.wave_n[:] = 0
    h.wave_unit[:] = 0.0
    again(h)


@jit
def again(h):
    """Begin with a new cycle, after a gap, a change of mode or a step of the set point."""
    for k in range(len(h.wave_at)):
        h.wave_at[k] = -1
        h.wave_side[k] = 0


@jit
def track(h, k, e, at):
    """Take in an average of the error at a level; ``at``: its place in the level's block."""
    n = h.wave_n[k]
    if n < MEMORY:
        n += 1
        h.wave_n[k] = n
        if n == 1:
            h.wave_mean[k] = e
    d = e - h.wave_mean[k]
    weight = 1.0 / n
    h.wave_mean[k] += weight * d
    h.wave_size[k] += weight * (abs(d) - h.wave_size[k])
    band = HYSTERESIS * h.wave_size[k]
    if h.wave_side[k] >= 0:
        if d < -band:
            h.wave_side[k] = -1
    elif d > band:
        h.wave_side[k] = 1
        if h.wave_at[k] > 0:
            _close(h, k, e, at)
        h.wave_at[k] = 0
    if h.wave_at[k] >= 0:
        h.wave_at[k] += 1
        if h.wave_at[k] > CAP:
            h.lost[k] += CAP
            h.wave_at[k] = -1


@jit
def _close(h, k, e, at):
    """Take a complete cycle into the sums; ``e`` is the first average of the next."""
    n = h.wave_at[k]
    if n < FEWEST:
        h.lost[k] += n
        return
    if h.cycles[k] > MANY:
        fade(h, k)
    a = np.sqrt(_harmonics(h.block[k], at - n, n, e, h.shape[k]))
    h.cycles[k] += 1.0
    h.length[k] += n
    h.length2[k] += n * n
    if h.wave_unit[k] == 0.0:
        h.wave_unit[k] = a
    if a > 0.0:
        i = int(np.floor(np.log2(a / h.wave_unit[k]) * PER_OCTAVE + 0.5)) % SIZES
        h.times[k, i] += n


@jit
def fade(h, k):
    """Halve a level's sums."""
    h.cycles[k] *= 0.5
    h.length[k] *= 0.5
    h.length2[k] *= 0.5
    h.lost[k] *= 0.5
    for i in range(SIZES):
        h.times[k, i] >>= 1
    for i in range(5):
        h.shape[k, i] *= 0.5


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
        if n >= FINE:
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
    if n >= FINE and power > 0.0:
        u = complex(r1, -i1) / np.sqrt(r1 * r1 + i1 * i1)
        locked = complex(r3, i3) * u * u * u * np.sqrt(scale * power)
        shape[0] += power
        shape[1] += locked.real
        shape[2] += locked.imag
        shape[3] += scale * (r2 * r2 + i2 * i2)
        shape[4] += scale * (r4 * r4 + i4 * i4)
    return power


def spread(h: Any, k: int) -> float:
    """Return how far the logarithms of the cycles' amplitudes spread, as a standard deviation.

    It is that of a normal distribution with the same shortest interval that holds half of the time: answers to steps
    and cycles cut in two by noise are left out (derived).
    """
    sizes = h["times"][k].astype(np.float64)
    half = 0.5 * float(sizes.sum())
    if half <= 0.0:
        return 1.0
    twice = np.concatenate([[0.0], np.cumsum(np.tile(sizes, 2))])
    edges = np.arange(len(twice), dtype=np.float64)
    after = np.interp(twice[: SIZES + 1] + half, twice, edges) - edges[: SIZES + 1]
    before = edges[SIZES:] - np.interp(twice[SIZES:] - half, twice, edges)
    width = min(float(after.min()), float(before.min()))
    return width * math.log(2.0) / PER_OCTAVE / 1.349


def likeness(h: Any, k: int, chance: float = CHANCE) -> float:
    """How alike a level's cycles are in amplitude and length, 0 to 1; less where few, or many broken off."""
    n = float(h["cycles"][k])
    if n < 1.0:
        return 0.0
    amplitude = spread(h, k) + chance / math.sqrt(n)
    length = math.sqrt(max(n * h["length2"][k] / h["length"][k] ** 2 - 1.0, 0.0))
    whole = min(float(h["length"][k] / (h["length"][k] + h["lost"][k])) / (1.0 - BROKEN), 1.0)
    return max(1.0 - math.hypot(amplitude / UNLIKE, length / UNEVEN), 0.0) * whole * min(n / PROOF, 1.0)


def harmonics(shape: Any) -> tuple[complex, float]:
    """Return the third harmonic locked to the first, and the second's size beyond noise, as shares of the first."""
    power = max(float(shape[0]), 1e-300)
    return complex(shape[1], shape[2]) / power, math.sqrt(max(float(shape[3] - shape[4]), 0.0) / power)


def stiction_of(h: Any, k: int) -> float | None:
    """How surely a level's cycles are a sticking valve's, 0 to 1; None without cycles enough."""
    n = float(h["cycles"][k])
    if n < ENOUGH or h["shape"][k][0] <= 0.0:
        return None
    third, second = harmonics(h["shape"][k])
    variation = spread(h, k)
    second = math.sqrt(max(second * second - RED * variation * variation, 0.0))
    shape = min(max(0.5 + 0.5 * (abs(third) + second - NO_SINE) / CERTAIN, 0.0), 1.0)
    steady = min(max(1.0 - 0.5 * (variation - 0.25) / 0.15, 0.0), 1.0)
    return shape * steady
