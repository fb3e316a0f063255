"""The compiled step: one sample of one loop, and all loops in the order of time.

A loop's numbers stand beside each other in one record, since a sample touches nearly all of them; what
differs in length (states, matrices, delay line) stands in one flat pool of numbers, found by offset.
Each function takes the record `r` of one loop and the pool `z`, and works on deviations inside the plant.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Channels of scheduled steps.
SETPOINT, LOAD, AUTO, OUTPUT = 0, 1, 2, 3
CHANNELS = 4

# Anti-windup codes; the names are in `controllers.AntiWindup`.
CONDITIONAL, TRACKING, NO_ANTI_WINDUP = 0, 1, 2

FOREVER = np.iinfo(np.int64).max

LOOP = np.dtype(
    [
        # what does not change
        ("period_ns", "i8"),  # [ns]
        ("period", "f8"),  # [s]
        ("order", "i8"),  # n: number of states
        ("x", "i8"),  # offset of the states, (n,); the last one is PV
        ("phi", "i8"),  # offset of the matrix, (n, n)
        ("older", "i8"),  # offset of the effect of the older input, (n,)
        ("newer", "i8"),  # offset of the effect of the newer input, (n,)
        ("ring", "i8"),  # offset of the delay line
        ("ring_size", "i8"),  # whole samples of dead time + 1
        ("pv0", "f8"),  # [PV] operating point
        ("op0", "f8"),  # [OP]
        ("kp", "f8"),  # [OP/PV]
        ("ki", "f8"),  # [OP/(PV s)]
        ("kd", "f8"),  # [OP s/PV] factor of the filtered derivative
        ("lead", "f8"),  # [s] factor of that derivative in the integral: the series form
        ("tf", "f8"),  # [s]
        ("b", "f8"),
        ("c", "f8"),
        ("op_low", "f8"),  # [OP]
        ("op_high", "f8"),  # [OP]
        ("windup", "i8"),  # anti-windup code
        ("track", "f8"),  # share of the excess taken back per sample
        ("noise", "f8"),  # [PV] standard deviation
        ("colour", "f8"),  # share of the noise that stays until the next sample
        ("quantum", "f8"),  # [PV]
        ("wander", "f8"),  # [OP] standard deviation of the load's walk per sample
        ("wander_back", "f8"),  # share of the walk that stays until the next sample
        ("ramp", "f8"),  # [PV] largest move of the set point per sample, 0 without limit
        ("master", "f8"),  # [PV] standard deviation of what a master adds to the set point
        ("master_stays", "f8"),  # share of it that stays until the master's next scan
        ("master_scan", "i8"),  # samples from one of its scans to the next
        ("stiction", "f8"),  # [OP]
        ("step_first", "i8", (CHANNELS,)),  # where the steps of a channel begin
        ("step_end", "i8", (CHANNELS,)),  # and end
        ("step_repeat", "i8", (CHANNELS,)),  # samples between repetitions, 0 for none
        # what a sample changes
        ("due_ns", "i8"),  # time of the next sample since the start [ns]
        ("sample", "i8"),  # its number
        ("ring_at", "i8"),  # oldest entry of the delay line
        ("target", "f8"),  # [PV] where the set point goes
        ("moving", "f8"),  # [PV] where it is, without the master
        ("mastered", "f8"),  # [PV] what the master adds
        ("sp", "f8"),  # [PV]
        ("op", "f8"),  # [OP]
        ("auto", "f8"),  # 1 automatic, 0 manual
        ("integral", "f8"),  # [OP]
        ("slope", "f8"),  # [PV/s] filtered derivative
        ("slope_in", "f8"),  # [PV] its last input
        ("load", "f8"),  # [OP] load that has reached the plant
        ("walk", "f8"),  # [OP]
        ("coloured", "f8"),  # [PV] noise of the last sample
        ("valve", "f8"),  # [OP]
        ("random", "u8"),
        ("step_next", "i8", (CHANNELS,)),  # next step, its index
        ("step_base", "i8", (CHANNELS,)),  # samples that past repetitions add
    ],
    align=True,
)

STEP = np.dtype(
    [
        ("at", "i8"),  # sample at which it acts
        ("size", "f8"),
        ("kick", "i8"),  # load: offset of what a unit does within the sample that it begins in, (n,)
    ],
    align=True,
)

# SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): increment and multipliers, all 64-bit words.
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53  # spacing of float64 below 1

Pool = NDArray[np.float64]
Records = NDArray[np.void]
Record = Any  # numpy.void in Python, a record with fields as attributes in compiled code


F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """Compile a function when it is first called, and keep it on disk."""
    compiled: F = njit(cache=True)(function)  # numba has no types
    return compiled


class Columns(NamedTuple):
    """Samples, each `(N,)`, sorted by time, then loop."""

    loop: NDArray[np.int32]
    time_ns: NDArray[np.int64]
    sp: NDArray[np.float64]
    pv: NDArray[np.float64]
    op: NDArray[np.float64]
    auto: NDArray[np.bool_]


@jit
def uniform(r: Record) -> float:
    """Next number of the loop's own stream, uniform in (0, 1]."""
    r.random += _GAMMA
    word = r.random
    word = (word ^ (word >> np.uint64(30))) * _MIX_1
    word = (word ^ (word >> np.uint64(27))) * _MIX_2
    word ^= word >> np.uint64(31)
    return ((word >> np.uint64(11)) + 1.0) * _UNIT  # type: ignore[no-any-return]


@jit
def due(r: Record, plan: Records, channel: int) -> int:
    """Index of a step of the channel that acts at the present sample, and move on; -1 if there is none."""
    step = r.step_next[channel]
    if step == r.step_end[channel] or plan[step].at + r.step_base[channel] > r.sample:
        return -1
    following = step + 1
    if following == r.step_end[channel] and r.step_repeat[channel] > 0:
        following = r.step_first[channel]
        r.step_base[channel] += r.step_repeat[channel]
    r.step_next[channel] = following
    return step  # type: ignore[no-any-return]


@jit
def steps(r: Record, plan: Records, channel: int) -> float:
    """Sum of the steps of the channel that act at the present sample."""
    total = 0.0
    step = due(r, plan, channel)
    while step >= 0:
        total += plan[step].size
        step = due(r, plan, channel)
    return total


@jit
def set_point(r: Record, moved: float) -> None:
    """Move SP towards its target, and by what a master does; the master draws a pair of numbers a scan."""
    r.target += moved
    away = r.target - r.moving
    r.moving = r.moving + min(max(away, -r.ramp), r.ramp) if r.ramp > 0.0 else r.target
    if r.master > 0.0 and r.sample % r.master_scan == 0:
        normal = np.sqrt(-2.0 * np.log(uniform(r))) * np.cos(2.0 * np.pi * uniform(r))
        fresh = np.sqrt(1.0 - r.master_stays * r.master_stays)
        r.mastered = r.master_stays * r.mastered + fresh * r.master * normal
    r.sp = r.moving + r.mastered


@jit
def measure(r: Record, z: Pool) -> float:
    """PV with noise and quantisation; the load's random walk draws from the same pair of numbers."""
    pv = r.pv0 + z[r.x + r.order - 1]
    if r.noise > 0.0 or r.wander > 0.0:
        # Box and Muller (1958): both normals of a pair are used.
        radius = np.sqrt(-2.0 * np.log(uniform(r)))
        angle = 2.0 * np.pi * uniform(r)
        fresh = np.sqrt(1.0 - r.colour * r.colour)
        r.coloured = r.colour * r.coloured + fresh * r.noise * radius * np.cos(angle)
        pv += r.coloured
        r.walk = r.wander_back * r.walk + r.wander * radius * np.sin(angle)
    if r.quantum > 0.0:
        pv = r.quantum * np.floor(pv / r.quantum + 0.5)
    return pv  # type: ignore[no-any-return]


@jit
def control(r: Record, pv: float, moved: float) -> None:
    """One scan of the controller: backward differences, limits, anti-windup, bumpless transfer.

    `moved` is by how much the operator moves the output; it counts in manual only.
    """
    slope_in = r.c * r.sp - pv
    r.slope = (r.tf * r.slope + slope_in - r.slope_in) / (r.tf + r.period)
    r.slope_in = slope_in
    rest = r.kp * (r.b * r.sp - pv) + r.kd * r.slope
    if r.auto < 0.5:
        r.op = min(max(r.op + moved, r.op_low), r.op_high)
        r.integral = r.op - rest  # ready to take over without a bump
        return
    gain = r.ki * r.period * (r.sp - pv + r.lead * r.slope)
    wish = rest + r.integral + gain
    deeper = (wish > r.op_high and gain > 0.0) or (wish < r.op_low and gain < 0.0)
    if deeper and r.windup == CONDITIONAL:
        gain = 0.0
        wish = rest + r.integral
    r.op = min(max(wish, r.op_low), r.op_high)
    r.integral += gain
    if r.windup == TRACKING and r.ki != 0.0:
        r.integral += r.track * (r.op - wish)


@jit
def move(r: Record, z: Pool) -> None:
    """Carry the plant over one sample period under its held, delayed input and its load."""
    if abs(r.op - r.valve) > r.stiction:
        r.valve = r.op
    older = z[r.ring + r.ring_at] + r.load
    z[r.ring + r.ring_at] = r.valve - r.op0 + r.walk
    r.ring_at = r.ring_at + 1 if r.ring_at + 1 < r.ring_size else 0
    newer = z[r.ring + r.ring_at] + r.load
    for row in range(r.order - 1, -1, -1):  # lower triangular: from the last row up it works in place
        total = z[r.older + row] * older + z[r.newer + row] * newer
        phi = r.phi + row * r.order
        for column in range(row + 1):
            total += z[phi + column] * z[r.x + column]
        z[r.x + row] = total


@jit
def add_loads(r: Record, plan: Records, z: Pool) -> None:
    """Add the loads that reach the plant within the period just passed, at whatever instant."""
    step = due(r, plan, LOAD)
    while step >= 0:
        for row in range(r.order):
            z[r.x + row] += plan[step].size * z[plan[step].kick + row]
        r.load += plan[step].size
        step = due(r, plan, LOAD)


@jit
def advance(loops: Records, plan: Records, z: Pool, start_ns: int, until_ns: int, out: Columns) -> int:
    """Sample every loop before `until_ns` [ns since the start] into `out`; returns the number of samples."""
    n = 0
    now = FOREVER
    for i in range(loops.size):
        now = min(now, loops[i].due_ns)
    while now < until_ns:
        following = FOREVER
        for i in range(loops.size):
            r = loops[i]
            if r.due_ns == now:
                set_point(r, steps(r, plan, SETPOINT))
                r.auto += steps(r, plan, AUTO)
                pv = measure(r, z)
                control(r, pv, steps(r, plan, OUTPUT))
                out.loop[n] = i
                out.time_ns[n] = start_ns + now
                out.sp[n] = r.sp
                out.pv[n] = pv
                out.op[n] = r.op
                out.auto[n] = r.auto > 0.5
                n += 1
                move(r, z)
                add_loads(r, plan, z)
                r.sample += 1
                r.due_ns += r.period_ns
            following = min(following, r.due_ns)
        now = following
    return n
