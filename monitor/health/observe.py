"""What a loop's samples say of its health, beside its events: one call a sample; `loop_health` reads the figures.

`observe` takes in one good sample, compiled, in O(1) memory a loop (about 5 kB): it hands each module its part of the
loop's record and the numbers that it needs. What needs more than a few additions is done in blocks of 64 samples. Sums
are halved every two weeks, so a monitor speaks of the recent ones. A figure that the data cannot carry is None.
"""

from __future__ import annotations

import numpy as np

from monitor.compiled import jit, jit_inlined

from . import autocorrelation, coverage, harris, measurement, offset, saturation, tag_mapping, travel
from .block import BLOCK_LENGTH, HORIZON_S

HEALTH = np.dtype(
    [
        ("samples", "f8"),  # in the block that fills
        ("since_decay", "f8"),  # [s] blocks since the sums were halved
        ("coverage", coverage.DTYPE),
        ("offset", offset.DTYPE),
        ("saturation", saturation.DTYPE),
        ("travel", travel.DTYPE),
        ("measurement", measurement.DTYPE),
        ("tag_mapping", tag_mapping.DTYPE),
        ("harris", harris.DTYPE),
        ("autocorrelation", autocorrelation.DTYPE),
    ]
)
"""A loop's record: each module's part."""


@jit_inlined
def observe(health, last, period, limits, dt, gap, sp, pv, op, auto, quiet, stepping):
    """Account for one good sample.

    Parameters
    ----------
    health
        The loop's record, of dtype `HEALTH`.
    last
        The sample before: sp, pv, op, auto.
    period
        Sample period [s], 0 before it is known.
    limits
        Of OP: op_low, op_high, infinite where there is none.
    dt
        Time since the last sample [s].
    gap
        Whether nothing may be carried across that time.
    sp, pv, op, auto
        The sample.
    quiet
        Whether no event, and nothing like one, goes on.
    stepping
        Whether the loop answers to a step of its set point.
    """
    coverage.update(health.coverage, dt, period, gap, last.auto, auto)
    measurement.update_interval(health.measurement, dt)
    if gap:
        measurement.reset(health.measurement)
        _reset(health)
        return
    op_range = health.saturation.highest - health.saturation.lowest
    measurement.update(health.measurement, last, dt, sp, pv, op, health.travel.noise, op_range)
    if not last.auto or not auto:
        _reset(health)
        return
    before, e = last.sp - last.pv, sp - pv
    offset.update(health.offset, before, dt)
    saturation.update(health.saturation, last.op, op, dt, limits, e != before)
    travel.update(health.travel, last.op, op, dt, period, health.saturation.samples)
    tag_mapping.update(health.tag_mapping, last, sp, pv, op)
    if sp != last.sp and not tag_mapping.sp_moves_often(health.tag_mapping):
        autocorrelation.taint(health.autocorrelation)
    if period <= 0.0:
        return
    health.samples += 1.0
    for _ in range(autocorrelation.places(health.autocorrelation, dt, period)):
        full, clean = autocorrelation.update(health.autocorrelation, e)
        if full:
            _update_blocks(health, clean and not stepping, quiet)


@jit
def _update_blocks(health, clean, quiet):
    """Do what is done once in 64 samples; ``clean``: nothing in them comes from a step of the set point."""
    travel.update_block(health.travel, health.samples)
    measurement.update_block(health.measurement, health.samples, quiet)
    health.samples = 0.0
    if clean:
        block = health.autocorrelation.levels[0].block
        harris.update_block(health.harris, block)
        offset.update_block(health.offset, block)
    health.since_decay += BLOCK_LENGTH * health.autocorrelation.spacing
    if health.since_decay > HORIZON_S:
        health.since_decay = 0.0
        _decay(health)


@jit
def _reset(health):
    """Begin anew what must not reach across a gap or a change of mode: OP may be anywhere after it."""
    health.samples = 0.0
    measurement.reset_block(health.measurement)
    saturation.reset(health.saturation)
    travel.reset(health.travel)
    tag_mapping.reset(health.tag_mapping)
    autocorrelation.reset(health.autocorrelation)


@jit
def _decay(health):
    """Halve all sums: what is two weeks old counts half, what is a month old a quarter."""
    coverage.decay(health.coverage)
    offset.decay(health.offset)
    saturation.decay(health.saturation)
    travel.decay(health.travel)
    measurement.decay(health.measurement)
    tag_mapping.decay(health.tag_mapping)
    harris.decay(health.harris)
