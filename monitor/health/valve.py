"""Whether a valve sticks or has play, from blocks of samples, with or without a regular cycle.

Each block is explained by a linear model and, for each band, by the same model behind a valve's element
(`valve_fit`). What speaks for a band is summed over blocks and records of a loop: bands lie on one fixed grid. Derived.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import median

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
LARGEST_OP = 15.0
"""Largest band tried [OP]: heaters that are switched full on and off else look like bands of 30 to 90 %, an output that
does nothing below its least value like one of 15 and more."""
EDGE_SHARE = 0.005
"""Of OP's values at either end that are no part of its range."""
LEAST_QUIET = 3e-3
"""Of PV's range, below which it is quiet whatever is left."""
LEAST_BLOCK_LR = -30.0
"""What a block can say against a band at most: a disturbance in one must not outweigh the others."""
SUMS = ("lr", "weight", "lean", "miss", "lin", "gain", "ratio", "blocks")
"""LR; LEAN; and of blocks that speak for the band: LR, MISS, LIN; logarithms of gain and ratio, times LR; how many."""
REST_SUMS = ("weight", *RESTS, "reach")
"""Largest LR at any level where that is above 0, and times this: what is seen in rests (logarithms, but of the share),
and the logarithm of the band over OP's range."""
BESIDE_BANDS = (3, 4)
"""Steps to bands that are another one surely."""
AGREEING_SHARE = 0.6
"""Of LR that no block contradicts, for a band that blocks agree on."""
LEAST_STRENGTH = 0.1
"""Below it nothing speaks for a valve."""
ANY = math.inf
ALTERNATIVES: tuple[dict[str, tuple[float, float]], ...] = (
    # few rests, in which OP passes the band slowly: PV is quiet, then follows; OP explains less by itself
    {
        "lr": (20.0, ANY), "lean": (8.0, ANY), "linear": (-ANY, 1.0), "gain": (-0.5, ANY), "ratio": (0.0, ANY),
        "idle": (-ANY, 2.1), "share": (0.4, ANY), "quiet": (-ANY, -1.2), "reach": (-0.6, ANY), "samples": (-ANY, 4.0),
        "speaking": (1.0, ANY),
    },
    # some rests, PV straight in each, a band that is sharp and seen at more than one level
    {
        "lr": (45.0, ANY), "lean": (12.0, ANY), "missing": (-ANY, 0.5), "linear": (-ANY, 3.0), "gain": (-0.1, ANY),
        "ratio": (-0.2, ANY), "idle": (-ANY, 2.77), "quiet": (-ANY, -1.05), "straight": (-ANY, -3.5),
        "reach": (-ANY, -0.36), "sharp": (0.85, ANY), "agreeing": (0.72, ANY), "other_level": (0.4, ANY),
    },
    # OP explains next to nothing by itself, the element all
    {
        "lr": (34.5, ANY), "missing": (-ANY, 0.34), "linear": (-ANY, 0.3), "gain": (0.64, ANY), "idle": (1.75, 2.77),
        "share": (0.23, ANY), "quiet": (-ANY, -0.8), "travel": (1.0, ANY), "reach": (-ANY, -0.4), "sharp": (0.65, ANY),
        "agreeing": (0.6, ANY), "per_block": (15.0, ANY),
    },
    # so much speaks for it, and so little is left to OP, that it may follow at any speed
    {
        "lr": (80.0, ANY), "lean": (20.0, ANY), "missing": (-ANY, 0.25), "linear": (-ANY, 0.25), "gain": (0.1, ANY),
        "idle": (1.4, 2.77), "quiet": (-ANY, -1.05), "reach": (-ANY, -0.36), "sharp": (0.55, ANY),
        "agreeing": (0.6, ANY), "per_block": (15.0, ANY),
    },
)  # fmt: skip
"""What names a valve, each by itself: least and most of `figures_of`. Found on simulated loops (valves_fleet.py)
by a search for what names most valves at the fewest sound loops, then rounded. The first is for what a refinery's
valves show, which the simulated ones hardly do; its limits were set with those records in sight."""
SPEAKING_LR = 3.0
"""From which on a block counts among those that speak for a band."""


@dataclass(frozen=True, slots=True, eq=False)
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
    range_share: float = 0.0
    """The band over OP's range in the blocks."""


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
    lr, lean, miss, lin, gain, ratio = np.moveaxis(np.where(seen[..., None], table, 0.0), -1, 0)
    lr, lean = np.maximum(lr, LEAST_BLOCK_LR), np.maximum(lean, LEAST_BLOCK_LR)
    weight = np.maximum(lr, 0.0)
    speaks = weight > 0.0
    logs = [weight * np.log(np.clip(x, 0.1, 10.0)) for x in (gain, ratio)]
    fits = [lr, weight, lean, *(np.where(speaks, x, 0.0) for x in (miss, lin)), *logs, lr > SPEAKING_LR]
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
    spread = 1.4826 * median(np.abs(moves - median(moves)))
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


def halved(evidence: ValveEvidence) -> ValveEvidence:
    """Return evidence that counts half, for what is old."""
    return ValveEvidence(
        evidence.first,
        max(evidence.blocks // 2, 1),
        np.float32(0.5) * evidence.fits,
        np.float32(0.5) * evidence.rests,
    )


def figures_of(evidence: ValveEvidence) -> dict[str, NDArray[np.float64]]:
    """Return what evidence says of each level, shape and band: by name, arrays (levels, shapes, bands).

    lr, lean: sums over blocks, of equally many parameters, and of three in the element. per_block: mean of lr.
    speaking: share of blocks that speak for the band. agreeing: share of lr that no block contradicts. missing: what
    OP still explains beside the element, as a share. linear: what OP explains at all, over lr. gain, ratio:
    logarithms, of the element's static gain over what PV's range asks for, and over the linear model's. sharp: how
    much of lr is gone three and four bands away. other_level: lr at the second best level, as a share. idle, share,
    quiet, travel, straight, reach: see `REST_SUMS`.
    """
    sums = dict(zip(SUMS, np.moveaxis(evidence.fits.astype(np.float64), -1, 0), strict=True))
    rests = dict(zip(REST_SUMS, np.moveaxis(evidence.rests.astype(np.float64), -1, 0), strict=True))
    lr, weight = sums["lr"], np.maximum(sums["weight"], 1e-9)
    rested = np.maximum(rests.pop("weight"), 1e-9)
    least = np.maximum(lr, 1.0)
    second = np.sort(np.maximum(lr, 0.0), axis=0)[-2]
    return {
        "samples": np.broadcast_to(np.array(AVERAGED_SAMPLES, dtype=np.float64)[:, None, None], lr.shape),
        "lr": lr,
        "lean": sums["lean"],
        "per_block": lr / evidence.blocks,
        "speaking": sums["blocks"] / evidence.blocks,
        "agreeing": lr / np.maximum(weight, 1.0),
        "missing": sums["miss"] / np.maximum(weight + sums["miss"], 1.0),
        "linear": sums["lin"] / least,
        "gain": sums["gain"] / weight,
        "ratio": sums["ratio"] / weight,
        "sharp": 1.0 - _beside(lr) / least,
        "other_level": np.broadcast_to(second, lr.shape) / least,
        **{name: np.broadcast_to(x / rested, lr.shape) for name, x in rests.items()},
    }


def _beside(lr: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean LR of the bands three and four steps away; LR itself where there are none."""
    total, count = np.zeros_like(lr), np.zeros(lr.shape[2])
    for away in BESIDE_BANDS:
        if away < lr.shape[2]:
            total[..., away:] += lr[..., :-away]
            total[..., :-away] += lr[..., away:]
            count[away:] += 1.0
            count[:-away] += 1.0
    return np.asarray(np.where(count > 0.0, total / np.maximum(count, 1.0), 0.0))


def valve_found(evidence: ValveEvidence) -> Valve | None:
    """Return the valve that the evidence shows best; None where nothing speaks for one."""
    return valve_and_support(evidence)[0]


def valve_and_support(evidence: ValveEvidence) -> tuple[Valve | None, float]:
    """Return the valve that the evidence shows best, and what OP says for a valve at all.

    That is the largest mean LR of a block for any band that no block contradicts.
    """
    figures = figures_of(evidence)
    support = np.where(figures["agreeing"] > AGREEING_SHARE, figures["per_block"], 0.0)
    return _named(evidence, figures), float(np.max(support))


def _named(evidence: ValveEvidence, figures: dict[str, NDArray[np.float64]]) -> Valve | None:
    """Return the valve that an alternative names, or comes nearest to; None where nothing speaks for one."""
    strength = np.zeros(figures["lr"].shape)
    for alternative in ALTERNATIVES:
        limits = {name: limit for name, limit in alternative.items() if name != "lr"}
        met = np.all(
            [(figures[name] >= low) & (figures[name] <= high) for name, (low, high) in limits.items()], axis=0
        )
        over = np.maximum(figures["lr"], 0.0) / alternative["lr"][0]
        strength = np.maximum(strength, np.where(met, over / (1.0 + over), 0.0))
    if strength.max() < LEAST_STRENGTH:
        return None
    named = strength > 0.5 if strength.max() > 0.5 else strength > 0.0
    at = np.unravel_index(int(np.argmax(np.where(named, figures["lr"], -np.inf))), strength.shape)
    level, shape, band = (int(x) for x in at)
    return Valve(
        GRID_FACTOR ** (evidence.first + band),
        SHAPES[shape],
        float(strength[at]),
        AVERAGED_SAMPLES[level],
        math.exp(float(figures["reach"][at])),
    )
