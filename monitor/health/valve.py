"""Whether a valve sticks or has play, from blocks of samples, with or without a regular cycle.

Each block is explained by a linear model and, for each band, by the same model behind a valve's element
(`valve_fit`). What speaks for a band is summed over blocks and records of a loop: bands lie on one fixed grid. Derived.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .valve_fit import AVERAGED_SAMPLES, LEAST_AVERAGES, NOT_FITTED, SHAPES, fit_block, path_of
from .valve_rests import RESTS, means_of, rests_of

GRID_FACTOR = 1.2
"""From one band to the next: a band between two of them is a tenth off at most."""
MOST_BANDS = 32
"""Bands that are kept: a factor of 300 between the smallest and the largest."""
LEAST_SPREAD_SD = 8.0
"""Range of OP over the spread of its moves, below which it does not move enough to tell a band from noise."""
SMALLEST_RANGE_SHARE, SMALLEST_SD, LARGEST_RANGE_SHARE = 1.0 / 40.0, 2.0, 0.98
"""Smallest band tried, of OP's range, and in spreads of its moves; largest, of OP's range."""
LARGEST_OP = 25.0
"""Largest band tried [OP]: heaters that are switched full on and off else look like bands of 30 to 90 %."""
EDGE_SHARE = 0.005
"""Of OP's values at either end that are no part of its range."""
LEAST_QUIET = 3e-3
"""Of PV's range, below which it is quiet whatever is left."""
LEAST_BLOCK_LR = -30.0
"""What a block can say against a band at most: a disturbance in one must not outweigh the others."""
SUMS = ("lr", "weight", "both", "miss", "lin", "gain", "ratio", "blocks")
"""LR; and of blocks that speak for the band: LR, BOTH, MISS, LIN; logarithms of gain and ratio, times LR; how many."""
REST_SUMS = ("weight", *RESTS, "reach")
"""Largest LR at any level where that is above 0, and times this: what is seen in rests (logarithms, but of the share),
and the logarithm of the band over OP's range."""
SPEAKING_LR = 3.0
"""From which on a block counts among those that speak for a band."""


@dataclass(frozen=True, slots=True)
class ValveEvidence:
    """What blocks of one loop say about each shape and band, at each level of averaging: sums, to be added."""

    first: int
    """Exponent of the first band on the grid."""
    blocks: int
    """Blocks with movement of OP."""
    fits: NDArray[np.float32]
    """(levels, shapes, bands, SUMS)."""
    rests: NDArray[np.float32]
    """(shapes, bands, REST_SUMS)."""


@dataclass(frozen=True, slots=True)
class Valve:
    """A valve that sticks or has play."""

    band: float
    """By how much OP travels after a reversal before the valve moves [OP]."""
    shape: str
    """"play" or "stick"."""
    strength: float
    """0 to 1: above 0.5 it is named."""
    samples_averaged: int
    """Samples in the averages at which it is seen best."""


def valve_evidence(
    sp: NDArray[np.float64], pv: NDArray[np.float64], op: NDArray[np.float64]
) -> ValveEvidence | None:
    """Return what one block says of a valve; None where OP does not move enough, or where samples are too few.

    Parameters
    ----------
    sp, pv : array (N,)
        Equally spaced, in automatic, without gaps [PV].
    op : array (N,)
        The same [OP].
    """
    if len(op) < LEAST_AVERAGES + 1 or not np.isfinite(op.sum() + pv.sum() + sp.sum()):
        return None
    first, count, reach = _grid(op)
    if count <= 0 or np.ptp(pv) == 0.0:
        return None
    bands = GRID_FACTOR ** np.arange(first, first + count, dtype=np.float64)
    sp, pv, op = (np.ascontiguousarray(x, dtype=np.float64) for x in (sp, pv, op))
    table, starts = fit_block(sp, pv, op, bands)
    seen = table[..., 0] > NOT_FITTED
    lr, both, miss, lin, gain, ratio = np.moveaxis(np.where(seen[..., None], table, 0.0), -1, 0)
    lr = np.maximum(lr, LEAST_BLOCK_LR)
    weight = np.maximum(lr, 0.0)
    speaks = weight > 0.0
    logs = [weight * np.log(np.clip(x, 0.1, 10.0)) for x in (gain, ratio)]
    fits = [lr, weight, *(np.where(speaks, x, 0.0) for x in (both, miss, lin)), *logs, lr > SPEAKING_LR]
    most = weight.max(axis=0)
    rests = np.zeros((*most.shape, len(RESTS)))
    means, v = means_of(pv), np.empty(len(op))
    for shape, b in zip(*np.nonzero(most > SPEAKING_LR), strict=True):
        path_of(op, bands[b], shape, starts[shape, b] - 1, v)
        rests[shape, b] = rests_of(op, v, bands[b], shape, means)
    idle, share, quiet, travel, straight = np.moveaxis(rests, -1, 0)
    figures = [
        np.log1p(idle),
        share,
        np.log(np.maximum(quiet, LEAST_QUIET)),
        np.log1p(travel),
        np.log(np.maximum(straight, LEAST_QUIET)),
        np.broadcast_to(np.log(bands / reach), idle.shape),
    ]
    return ValveEvidence(
        first,
        1,
        np.stack(fits, axis=-1).astype(np.float32),
        np.stack([most, *(most * x for x in figures)], axis=-1).astype(np.float32),
    )


def _grid(op: NDArray[np.float64]) -> tuple[int, int, float]:
    """Return the first band's exponent, the number of bands (0 where OP does not move enough), and OP's range [OP]."""
    moves = np.diff(op)
    spread = 1.4826 * float(np.median(np.abs(moves - np.median(moves))))
    if not np.ptp(op) > LEAST_SPREAD_SD * spread:
        return 0, 0, 0.0
    ordered = np.sort(op)
    edge = int(EDGE_SHARE * len(op))
    reach = float(ordered[len(op) - 1 - edge] - ordered[edge])
    if not reach > max(LEAST_SPREAD_SD * spread, 1e-9 * float(np.abs(ordered[[0, -1]]).max())):
        return 0, 0, 0.0
    low = max(SMALLEST_RANGE_SHARE * reach, SMALLEST_SD * spread)
    high = min(LARGEST_RANGE_SHARE * reach, LARGEST_OP)
    first, last = (math.log(x) / math.log(GRID_FACTOR) for x in (low, high))
    return math.ceil(first), math.floor(last) - math.ceil(first) + 1, reach


def merged(one: ValveEvidence, other: ValveEvidence) -> ValveEvidence:
    """Return the evidence of both; where bands are too many, those with the most evidence."""
    first = min(one.first, other.first)
    end = max(x.first + x.fits.shape[2] for x in (one, other))
    fits = np.zeros((*one.fits.shape[:2], end - first, len(SUMS)), dtype=np.float32)
    rests = np.zeros((one.rests.shape[0], end - first, len(REST_SUMS)), dtype=np.float32)
    for each in (one, other):
        part = slice(each.first - first, each.first - first + each.fits.shape[2])
        fits[:, :, part] += each.fits
        rests[:, part] += each.rests
    if end - first > MOST_BANDS:
        mass = np.convolve(rests[:, :, 0].sum(axis=0), np.ones(MOST_BANDS), mode="valid")
        at = int(np.argmax(mass))
        first, fits, rests = first + at, fits[:, :, at : at + MOST_BANDS], rests[:, at : at + MOST_BANDS]
    return ValveEvidence(first, one.blocks + other.blocks, fits, rests)
