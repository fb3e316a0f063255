"""The autocorrelation of a loop's error at five levels of averaging, block by block (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.compiled import jit, jit_inlined

from . import level
from .block import BLOCK_LENGTH
from .fields import clearing

ACF_LEVELS = 5
"""The samples, and averages over four steps of time, each four times the last and near a power of 4 seconds."""
NEW_PERIOD_FACTOR = 2.2
"""Factor by which the sample period must change for the levels to be laid out anew: one that wanders between two
values is no new one."""
MISSED_SAMPLES = 3
"""Missed samples that are filled with the last value."""

SUMS: list[Any] = []
RUNNING: list[Any] = [
    ("clock", "f8"),  # [s] since the last sample's place on the grid of time
    ("taken", "i8"),  # samples
    ("filled", "i8"),  # samples in the finest average that fills
    ("grouped", "i8"),  # finest averages
]
KEPT: list[Any] = [
    ("spacing", "f8"),  # [s] grid of time: the sample period for which the levels are laid out
    ("group", "i8"),  # samples in the finest average
]
DTYPE = np.dtype([*SUMS, *RUNNING, *KEPT, ("levels", level.DTYPE, (ACF_LEVELS,))])
"""About 3.6 kB, whatever the period. Each level halves its sums by itself, as its blocks go by."""

_reset = clearing(RUNNING)


@jit
def reset(own):
    """Begin all blocks and cycles anew."""
    _reset(own)
    for k in range(ACF_LEVELS):
        level.reset(own.levels[k])


@jit
def taint(own):
    """Leave out the blocks and the cycles now open at every level: the set point has stepped."""
    for k in range(ACF_LEVELS):
        level.taint(own.levels[k])


@jit_inlined
def places(own, dt, period):
    """Return how often the next sample counts, ``dt`` after the last [s]: a missed one is filled with its value.

    The levels are laid out anew first where they do not suit the sample period [s].
    """
    new = not own.spacing / NEW_PERIOD_FACTOR <= period <= own.spacing * NEW_PERIOD_FACTOR
    if new and own.taken & (BLOCK_LENGTH - 1) == 0:
        _lay_out(own, period)
    own.clock += dt
    n = int(own.clock / own.spacing + 0.5)
    own.clock -= n * own.spacing
    return min(n, MISSED_SAMPLES + 1)


@jit_inlined
def update(own, e):
    """Take in one error [PV]; return whether that completes a block of samples, and whether no step of SP is in it."""
    at = own.taken & (BLOCK_LENGTH - 1)
    clean = own.levels[0].tainted == 0
    _enter(own, 0, e, at)
    own.taken += 1
    own.levels[0].carry += e
    own.filled += 1
    if own.filled == own.group:
        _average(own)
    return at == BLOCK_LENGTH - 1, clean


@jit
def _average(own):
    """Take in the finest average, which is complete, and those that it completes."""
    n = own.grouped
    own.grouped = n + 1
    own.filled = 0
    e = own.levels[0].carry / own.group
    own.levels[0].carry = 0.0
    for k in range(1, ACF_LEVELS):
        _enter(own, k, e, n & (BLOCK_LENGTH - 1))
        own.levels[k].carry += e
        if n & 3 != 3:
            return
        e = 0.25 * own.levels[k].carry
        own.levels[k].carry = 0.0
        n >>= 2


@jit
def _enter(own, k, e, at):
    """Take an average into a level, and the block that it completes."""
    level.update(own.levels[k], e, at)
    if at == BLOCK_LENGTH - 1:
        level.update_block(own.levels[k], _width(own.group, k), own.spacing)


@jit
def _width(group, k):
    """Return the samples in an average of a level."""
    return 1.0 if k == 0 else group * 4.0 ** (k - 1)


@jit
def _lay_out(own, period):
    """Lay the levels out for a sample period [s]: at any, they are near powers of 4 s, from two to four samples on."""
    best = 10.0
    for many in (4, 3, 2):
        exponent = np.log(many * period) / np.log(4.0)
        off = abs(exponent - np.floor(exponent + 0.5))
        if off < best - 1e-9:
            best = off
            own.group = many
    own.spacing = period
    own.taken = own.filled = own.grouped = 0
    for k in range(ACF_LEVELS):
        level.forget(own.levels[k])


def seconds_of(own: Any, k: int) -> float:
    """Return the time of an average of a level [s]."""
    samples = 1.0 if k == 0 else float(own["group"]) * 4.0 ** (k - 1)
    return samples * float(own["spacing"])
