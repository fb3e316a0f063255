"""What happens to a loop of the benchmark `plant_life` in its days: what its kind says, and the life of any plant.

Steps of the set point, upsets of seven shapes, spells in manual, a warm-up at the start, a load that wanders. Events
come one after the other, most of them when the last is over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter

from tests.bench.mismatch_plant import INTEGRATING, Floats
from tests.bench.mismatch_shapes import Rng, log
from tests.bench.plant_life_fleet import (
    FROZEN,
    HUNTING,
    MANUAL,
    NO_RESPONSE,
    P_ONLY,
    PROGRAMME,
    SATURATED,
    SLAVE,
    SPLIT,
    WAVES,
    Base,
)  # fmt: skip
from tests.bench.plant_life_sim import STEP_S, Inputs, live
from tests.bench.upsets_fleet import UPSETS, _upset

DAY_S = 86_400
EVENTS_PER_DAY = 8.0
"""Set-point steps, upsets and spells in manual of a loop that is neither led nor left alone."""
SHARES = {"setpoint": 0.4, "upset": 0.5, "manual": 0.1}
HASTE_SHARE = 0.15
"""Share of the events that come before the last one is over."""
LEAST_SD, MOST_SD = 4.0, 40.0
"""Size of an event in standard deviations of PV's noise."""
MOST_LOAD = 12.0
"""Largest step of load [% of OP's span]."""
MOST_SETPOINT_OP = 20.0
"""Largest way of OP that a step of the set point asks for in the end [% of its span]."""
WARM_UP_SHARE = 0.3
LEAST_CYCLES = 6
"""Of a spell of hunting."""
SMOOTH, SQUARE = 60.0, 15.0
"""Longest period of a sine, and of waves with corners (slower ones are single steps to the loop) [natural times]."""


@dataclass
class Happened:
    """What was done to a loop, beside its own truth; times from the first sample [s]."""

    base: Base
    what: Inputs
    events: list[tuple[float, str, float]] = field(default_factory=list)
    """When, what, and how large [standard deviations of noise]; in order of time."""
    wave_s: float = 0.0
    """Period of the load's swing [s]."""
    wave_sd: float = 0.0
    """Amplitude of PV of that, in standard deviations of noise."""
    spells: list[tuple[int, int]] = field(default_factory=list)
    """First and last step of each time that it swings."""
    wander_sd: float = 0.0
    """Standard deviation of PV by the load that wanders, in those of noise."""

    @property
    def n(self) -> int:
        return len(self.what.sp)


def happen(base: Base, rng: Rng, days: float) -> Happened:
    """Draw the days of a loop."""
    out = Happened(base, Inputs.quiet(int(days * DAY_S)))
    out.what.noise = base.noise * rng.standard_normal(out.n)
    out.what.load, out.wander_sd = _wander(base, rng, out.n)
    start = _warm_up(out, rng) if base.kind not in {SPLIT, P_ONLY, FROZEN, SATURATED} else 0.0
    _events(out, rng, start)
    OWN.get(base.kind, lambda *_: None)(out, rng)
    out.events.sort()
    return out


def _wander(base: Base, rng: Rng, n: int) -> tuple[Floats, float]:
    """Return a load that comes back within some natural times, and moves PV by a fifth to twice its noise."""
    keep = math.exp(-STEP_S / (base.natural * log(rng, 3.0, 30.0)))
    white = rng.standard_normal(n) * math.sqrt(1 - keep**2)
    load = lfilter([1.0], [1.0, -keep], white)
    quiet = Inputs.quiet(min(n, DAY_S))
    quiet.load = load[: len(quiet.sp)]
    linear = replace(base.body, op_low=-math.inf, op_high=math.inf, pulses=0)
    effect = float(np.std(live(linear, quiet).true))
    size = min(base.noise * log(rng, 0.2, 2.0) / effect, MOST_LOAD / 3)
    return np.asarray(load * size), size * effect / base.noise


def _warm_up(out: Happened, rng: Rng) -> float:
    """Begin far from the set point; return when that is over [s]."""
    base = out.base
    if rng.random() > WARM_UP_SHARE:
        return 0.0
    room = 0.8 * min(base.op0, 100.0 - base.op0)
    size = base.noise * log(rng, 50.0, 300.0)
    if base.body.plant.process != INTEGRATING:
        size = min(size, room * base.gain)
    size *= float(rng.choice([-1, 1]))
    first = int(rng.integers(5, 120))
    out.what.sp[first:] += size
    out.events.append((first * STEP_S, "warm-up", size / base.noise))
    return first * STEP_S + 3 * base.settle


def _events(out: Happened, rng: Rng, start: float) -> None:
    """Let things happen at the pace of a plant, or of a slow loop."""
    base = out.base
    if base.kind in {SLAVE, PROGRAMME, MANUAL}:
        return
    pause = DAY_S / EVENTS_PER_DAY
    at = start + min(pause, 4 * base.settle) * rng.uniform(0.3, 1.0)
    shift = 0.0
    while at < out.n * STEP_S - 2 * base.settle:
        what = str(rng.choice(list(SHARES), p=list(SHARES.values())))
        if what == "setpoint":
            shift = _setpoint(out, rng, int(at), shift)
        elif what == "upset":
            _load(out, rng, int(at))
        else:
            at += _spell(out, rng, int(at), _manual_s(base))
        hasty = rng.random() < HASTE_SHARE
        wait = base.settle * (rng.uniform(0.1, 1.0) if hasty else rng.uniform(2.0, 4.0))
        at += wait + (0.0 if hasty else rng.exponential(max(pause - 3 * base.settle, 0.1 * pause)))


def _setpoint(out: Happened, rng: Rng, at: int, shift: float) -> float:
    """Step the set point; return by how much it then stands off."""
    base = out.base
    size = base.noise * log(rng, LEAST_SD, MOST_SD)
    if base.body.plant.process != INTEGRATING:
        size = min(size, MOST_SETPOINT_OP * base.gain / 2)
    sign = -math.copysign(1.0, shift) if shift else float(rng.choice([-1, 1]))
    out.what.sp[at:] += sign * size
    out.events.append((at * STEP_S, "setpoint", sign * size / base.noise))
    return shift + sign * size


def _load(out: Happened, rng: Rng, at: int) -> None:
    """Let an upset of one of the seven shapes come; what stays goes away later."""
    base = out.base
    shape = str(rng.choice(UPSETS))
    n = out.n - at
    load, moved, _ = _upset(rng, shape, np.arange(n) * STEP_S, base.natural)
    size = min(base.noise * log(rng, LEAST_SD, MOST_SD), MOST_LOAD / base.push)
    standing = float(out.what.load[at - 1]) if at else 0.0
    sign = -math.copysign(1.0, standing) if abs(standing) > MOST_LOAD / 2 else float(rng.choice([-1, 1]))
    out.what.load[at:] += sign * size * base.push * load
    if base.body.plant.process != INTEGRATING:
        size_beyond = min(size, MOST_SETPOINT_OP * base.gain / 2)
        out.what.beyond[at:] += sign * size_beyond * moved * (np.arange(n) * STEP_S < 3 * base.settle)
    else:
        out.what.beyond[at:] += sign * size * moved
    out.events.append((at * STEP_S, shape, sign * size / base.noise))


def _manual_s(base: Base) -> float:
    """Longest spell in manual in which PV does not run away [s]."""
    if base.body.plant.process != INTEGRATING:
        return 3600.0
    return min(60.0 / abs(base.body.plant.slope * base.body.law.kp), 1800.0)


def _spell(out: Happened, rng: Rng, at: int, longest: float) -> float:
    """Put the loop into manual for a while, OP moved by hand; return for how long [s]."""
    base = out.base
    lasts = int(longest * log(rng, 0.2, 1.0))
    out.what.auto[at : at + lasts] = False
    size = base.noise * log(rng, LEAST_SD, MOST_SD)
    reach = (
        lasts * STEP_S * abs(base.body.plant.slope) if base.body.plant.process == INTEGRATING else base.gain
    )
    move = float(rng.choice([-1, 1])) * min(size / reach, MOST_LOAD)
    first = at + lasts // 4
    if first < out.n:
        out.what.moved[first] = move
        out.what.moved[min(first + lasts // 2, out.n - 1)] = -move
    out.events.append((at * STEP_S, "manual", 0.0))
    out.events.append(((at + lasts) * STEP_S, "automatic", 0.0))
    return lasts * STEP_S


# ---------------------------------------------------------------------------------------------------
# what each kind adds


def swing(shape: str, turns: Floats) -> Floats:
    """Return a sine, a square wave or a triangle of unit amplitude."""
    if shape == "square":
        return np.where(turns % 1.0 < 0.5, 1.0, -1.0)
    if shape == "triangle":
        return np.asarray(2.0 * np.abs(2.0 * (turns % 1.0) - 1.0) - 1.0)
    return np.asarray(np.sin(2 * math.pi * turns))


def _wave(out: Happened, rng: Rng) -> None:
    """Swing all the time, or only in spells, with a period of some natural times; the amplitude seen in PV is drawn."""
    base, n = out.base, out.n
    most = SMOOTH if base.kind == "sine" else SQUARE
    longest = max(min(most * base.natural, n / 40), 8 * base.natural)
    period = log(rng, max(3 * base.natural, 8 * base.every), max(longest, 9 * base.every))
    shape = base.kind if base.kind in WAVES else str(rng.choice(["sine", "square"]))
    turns = np.arange(n) * STEP_S / period + rng.random()
    load = swing(shape, turns)
    quiet = Inputs.quiet(int(20 * period))
    quiet.load = load[: len(quiet.sp)] if n >= len(quiet.sp) else np.resize(load, len(quiet.sp))
    linear = replace(base.body, op_low=-math.inf, op_high=math.inf)
    late = live(linear, quiet).true[int(10 * period) :]
    amplitude = float(np.ptp(late)) / 2
    size = min(base.noise * log(rng, 2.0, 15.0) / amplitude, 15.0)
    load = load * size
    out.wave_s, out.wave_sd = period, size * amplitude / base.noise
    out.spells = [(0, n)]
    if base.kind == HUNTING:
        out.spells = _spells(rng, n, period)
        window = np.zeros(n)
        for first, last in out.spells:
            window[first:last] = 1.0
        load = load * window
    out.what.load += load


def _spells(rng: Rng, n: int, period: float) -> list[tuple[int, int]]:
    """Draw spells of six cycles and more over 15 to 50 % of the time, apart from each other."""
    share, count = rng.uniform(0.15, 0.5), int(rng.integers(1, 5))
    each = max(int(share * n / count), int(LEAST_CYCLES * period) + 1)
    count = max(min(count, int(0.6 * n / each)), 1)
    part = n // count
    firsts = [k * part + int(rng.integers(0, max(part - each, 1))) for k in range(count)]
    return [(first, min(first + each, n)) for first in firsts]


def _saturated(out: Happened, rng: Rng) -> None:
    """Ask for more than the valve can give, for a third of the time or more."""
    base, n = out.base, out.n
    up = rng.random() < 0.5
    room = 100.0 - base.op0 if up else base.op0
    lasts = int(n * rng.uniform(0.45, 0.95))
    first = int(rng.integers(0, n - lasts))
    out.what.load[first : first + lasts] -= (1 if up else -1) * room * rng.uniform(1.1, 1.6)


def _split(out: Happened, rng: Rng) -> None:
    """Let the load go over to the other side and back, every few hours."""
    at, side, last = 0, float(rng.choice([-1, 1])), 0.0
    while at < out.n:
        lasts = int(max(rng.uniform(1.0, 4.0) * 3600, 6 * out.base.settle))
        rise = np.minimum(np.arange(len(out.what.load[at : at + lasts])) / (2 * out.base.settle + 1), 1.0)
        new = side * rng.uniform(4.0, 15.0)
        out.what.load[at : at + lasts] += last + (new - last) * rise
        at, side, last = at + lasts, -side, new


def _shut(out: Happened, rng: Rng) -> None:
    """Let the valve stay where it is, and the load move on."""
    base = out.base
    first = int(out.n * rng.uniform(0.0, 0.4) * (rng.random() < 0.7))
    out.what.shut[first:] = True
    away = base.noise * log(rng, 10.0, 60.0) / base.gain
    out.what.load[first:] += float(rng.choice([-1, 1])) * min(away, 2 * MOST_LOAD)


def _offset(out: Happened, rng: Rng) -> None:
    """Let a load stand that proportional action alone does not take away."""
    base = out.base
    size = min(base.noise * log(rng, 5.0, 25.0) * base.push, 2 * MOST_LOAD)
    out.what.load[int(rng.integers(1, 600)) :] += float(rng.choice([-1, 1])) * size


def _by_hand(out: Happened, rng: Rng) -> None:
    """Keep the loop in manual for most of the time."""
    base, at = out.base, 0
    held = rng.uniform(0.65, 0.97)
    while at < out.n:
        lasts = int(rng.uniform(1.0, 5.0) * 3600)
        by_hand = int(lasts * held)
        out.what.auto[at : at + by_hand] = False
        for k in rng.integers(at, at + by_hand, 3):
            if k < out.n:
                out.what.moved[k] += rng.choice([-1, 1]) * min(
                    base.noise * log(rng, 5.0, 30.0) / base.gain, MOST_LOAD
                )
        at += lasts


def _led(out: Happened, rng: Rng) -> None:
    """Let a master move the set point, each of its scans."""
    base, n = out.base, out.n
    scan = int(rng.integers(base.every, max(3 * base.every, 20)))
    keep = math.exp(-scan / (base.natural * log(rng, 3.0, 20.0)))
    many = n // scan + 1
    moves = lfilter([1.0], [1.0, -keep], rng.standard_normal(many) * math.sqrt(1 - keep**2))
    sd = base.noise * log(rng, 3.0, 20.0)
    if base.body.plant.process != INTEGRATING:
        sd = min(sd, MOST_SETPOINT_OP * base.gain / 4)
    out.what.sp += sd * np.repeat(moves, scan)[:n]


def _programme(out: Happened, rng: Rng) -> None:
    """Go up and down by ramps with times of rest between, as batches do."""
    base, n = out.base, out.n
    size = base.noise * log(rng, 20.0, 100.0)
    if base.body.plant.process != INTEGRATING:
        size = min(size, MOST_SETPOINT_OP * base.gain)
    ramp = max(base.natural * log(rng, 3.0, 20.0), 60.0)
    rest = [max(base.settle * rng.uniform(0.5, 3.0), 600.0) for _ in range(2)]
    times = np.cumsum([0.0, rest[0], ramp, rest[1], ramp])
    phase = (np.arange(n) * STEP_S) % times[-1]
    out.what.sp += float(rng.choice([-1, 1])) * size * np.interp(phase, times, [0.0, 0.0, 1.0, 1.0, 0.0])


def _frozen(out: Happened, rng: Rng) -> None:
    """Let the transmitter show one value from some time on."""
    out.what.frozen[int(out.n * rng.uniform(0.05, 0.4)) :] = True


OWN: dict[str, Callable[[Happened, Rng], None]] = {
    **dict.fromkeys((*WAVES, HUNTING), _wave),
    SATURATED: _saturated,
    SPLIT: _split,
    NO_RESPONSE: _shut,
    P_ONLY: _offset,
    MANUAL: _by_hand,
    SLAVE: _led,
    PROGRAMME: _programme,
    FROZEN: _frozen,
}
