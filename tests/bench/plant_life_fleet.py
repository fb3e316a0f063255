"""The loops of the benchmark `plant_life`: one underlying truth each, on any plant, sampled every 1, 5 or 10 s.

A loop depends on its kind, its number, the seed and the length of its life alone. What happens beside its own truth is
drawn in `plant_life_days`, how it is recorded in `plant_life_recording`, what is right in `plant_life_truth`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from monitor.contract.loops import Loop
from tests.bench.mismatch_event import SETPOINT
from tests.bench.mismatch_fleet import KINDS as MISMATCH
from tests.bench.mismatch_fleet import Drawn
from tests.bench.mismatch_plant import INTEGRATING, Law, Plant, peak
from tests.bench.mismatch_shapes import Rng, integrating, log, self_regulating
from tests.bench.mismatch_sim import Rig, Valve
from tests.bench.mismatch_truth import indices, true_peak
from tests.bench.plant_life_sim import STEP_S, Body, Inputs, live

HEALTHY, SLOW, AGGRESSIVE, INTEGRAL = "healthy", "slow", "aggressive", "integral"
STICK, BACKLASH, RATE = "stick", "backlash", "rate-limited"
SINE, SQUARE, TRIANGLE, HUNTING = "sine", "square", "triangle", "hunting"
SATURATED, RELAY, SPLIT, NO_RESPONSE = "saturated", "relay", "split-range", "no-response"
P_ONLY, MANUAL, SLAVE, PROGRAMME, FROZEN = "p-only", "manual", "slave", "programme", "frozen"
WAVES = (SINE, SQUARE, TRIANGLE)
VALVES = (STICK, BACKLASH, RATE)
MIX = (
    *(HEALTHY, SLOW, STICK, HEALTHY, AGGRESSIVE, SINE, BACKLASH, HEALTHY, INTEGRAL, SQUARE, STICK, SATURATED),
    *(
        HEALTHY,
        SLOW,
        TRIANGLE,
        BACKLASH,
        HUNTING,
        HEALTHY,
        RELAY,
        SPLIT,
        NO_RESPONSE,
        HEALTHY,
        P_ONLY,
        MANUAL,
    ),
    *(SLAVE, HEALTHY, PROGRAMME, FROZEN, RATE, HEALTHY),
)
"""Kinds in the order in which they come, again and again: a quarter is healthy, more than one in ten sticks."""
NAMES = tuple(dict.fromkeys(MIX))
SELF_ONLY = (SATURATED, NO_RESPONSE, MANUAL)
"""Kinds in which nobody holds PV for hours: an integrator would run away."""
PERIODS = (1, 5, 10)
"""Steps in a recorded sample."""
COARSE_SHARE = 0.05
"""Share of the loops that may be sampled as coarsely as it comes."""
SAMPLED = 0.7
"""Most recorded periods of the others in their natural time."""
HEALTHY_MS, HEALTHY_CI, SLOW_CI = 1.9, 0.7, 0.4
"""True Ms at most and indices at least of a healthy loop; indices at most of a slow one."""
MOST_MS = 15.0
"""True Ms above which a loop would swing by itself for hours."""
LONGEST_S = 7200.0
"""A loop that takes longer to settle is drawn again [s]."""
LEAST_OP_NOISE, MOST_OP_NOISE = 0.02, 0.5
"""Standard deviation of what noise does to OP [% of its span]."""


@dataclass(frozen=True)
class Base:
    """A loop before anything happens to it."""

    kind: str
    number: int
    body: Body
    every: int
    """Steps in a recorded sample."""
    noise: float
    """Standard deviation [PV]."""
    op0: float
    pv0: float
    settle: float
    """Time after which the response to a step is over [s]."""
    push: float
    """Load at the process input that moves PV by one at most [OP/PV]."""

    @property
    def natural(self) -> float:
        """Time in which the loop could answer [s]."""
        return self.body.plant.theta + self.body.plant.lag

    @property
    def gain(self) -> float:
        """Size of the PV that OP moves by one: at rest, or within the loop's own time [PV/OP]."""
        plant = self.body.plant
        return abs(plant.slope) * (self.natural if plant.process == INTEGRATING else 1.0)

    def truth(self, law: Law) -> tuple[float, dict[str, float]]:
        """Worst Ms and the indices of the loop under a law of its own form."""
        drawn = self.drawn()
        ms = true_peak(drawn, law)
        return ms, indices(drawn, law) if math.isfinite(ms) and math.isfinite(law.ti) else {}

    def drawn(self) -> Drawn:
        """Return the loop as the judge of `mismatch` takes it."""
        return as_drawn(self.body.plant, self.body.law, self.every, self.body.valve)


def as_drawn(plant: Plant, law: Law, every: int, valve: Valve) -> Drawn:
    kept = valve if valve.kind == "direction" else Valve()  # what depends on the size of a move has no Ms
    structure = "pid" if law.td else "pi"
    table = Loop(name="x", controller=structure)
    rig = Rig(plant, law, STEP_S, 1, kept)
    return Drawn(MISMATCH["base"], 0, SETPOINT, rig, law, table, structure, every)


def draw(kind: str, number: int, seed: int) -> Base:
    """Draw the loop of a kind, at rest."""
    rng = np.random.default_rng([seed, number, *map(ord, kind)])
    while True:
        plant, every = _plant(rng, kind)
        law = _law(rng, plant)
        healthy = as_drawn(plant, law, every, Valve())
        if not true_peak(healthy, law) <= HEALTHY_MS or min(indices(healthy, law).values()) < HEALTHY_CI:
            continue
        changed = _settings(rng, kind, plant, law, every)
        if changed is None:
            continue
        noise = log(rng, LEAST_OP_NOISE, MOST_OP_NOISE) / abs(law.kp)
        body = _body(rng, kind, plant, changed, noise)
        if true_peak(as_drawn(plant, changed, every, body.valve), changed) > MOST_MS:
            continue
        settle, push = _response(body)
        if settle > LONGEST_S:
            continue
        op0 = 50.0 if kind == SPLIT else -body.op_low
        pv0 = float(rng.choice([1.0, 10.0, 100.0])) * float(rng.uniform(0.5, 3.0))
        return Base(kind, number, body, every, noise, op0, pv0, settle, push)


def _plant(rng: Rng, kind: str) -> tuple[Plant, int]:
    """Return a flow, a temperature, a pressure or a level, and how often it is sampled."""
    what = str(rng.choice(["flow", "temperature", "pressure", "level"]))
    if kind == INTEGRAL:
        what = str(rng.choice(["pressure", "level"]))
    elif kind in SELF_ONLY:
        what = str(rng.choice(["flow", "temperature"]))
    elif kind == RELAY:
        what = "temperature"
    ranges = {
        "flow": (1.0, 6.0),
        "temperature": (8.0, 60.0),
        "pressure": (1.0, 10.0),
        "level": (3.0, 60.0),
    }
    dead = float(round(log(rng, *ranges[what])))
    sign = float(rng.choice([-1, 1]))
    if what in {"flow", "temperature"}:
        plant = self_regulating(rng, dead, sign * log(rng, 0.3, 3.0) / 100)
    else:
        plant = integrating(rng, dead, sign * log(rng, 0.1, 1.0) / dead)
    every = int(rng.choice(PERIODS))
    free = rng.random() < COARSE_SHARE
    while not free and every > max(SAMPLED * (plant.theta + plant.lag), PERIODS[0]):
        every = int(rng.choice(PERIODS))
    return plant, every


def _law(rng: Rng, plant: Plant) -> Law:
    """SIMC settings with tc = theta (Skogestad 2003), somewhat slower; a derivative for one integrator in seven."""
    theta, lag = plant.theta + STEP_S / 2, plant.lag
    slower = rng.uniform(0.7, 1.0)
    if plant.process == INTEGRATING:
        td = lag if lag > 2 * STEP_S and rng.random() < 1 / 7 else 0.0
        theta += 0.0 if td else lag / 2
        kp, ti = slower / (plant.slope * 2 * theta), 8 * theta / slower
        return _rounded(kp, ti, td, "series" if td else "standard")
    kp, ti = slower * lag / (plant.slope * 2 * theta), min(lag, 8 * theta)
    return _rounded(kp, ti, 0.0, str(rng.choice(["standard", "parallel", "series"])))


def _rounded(kp: float, ti: float, td: float, form: str = "standard") -> Law:
    three = [float(f"{x:.3g}") for x in (kp, ti, td)]
    return Law(*three, three[2] / 10, form)


def _settings(rng: Rng, kind: str, plant: Plant, law: Law, every: int) -> Law | None:
    """Return the settings that the kind has in place of healthy ones; None where they do not come out as meant."""
    drawn = as_drawn(plant, law, every, Valve())
    if kind == SLOW:
        part = log(rng, 0.05, 0.3)
        longer = 1 / part if plant.process == INTEGRATING else log(rng, 1.0, 4.0)
        slow = _rounded(law.kp * part, law.ti * longer, law.td, law.form)
        return slow if max(indices(drawn, slow).values()) <= SLOW_CI else None
    if kind == AGGRESSIVE:
        wanted = log(rng, 4.0, 9.0)
        for factor in np.geomspace(1.1, 8.0, 40):
            tight = _rounded(law.kp * factor, law.ti, law.td, law.form)
            ms = peak(plant, tight, STEP_S)
            if ms >= wanted:
                return tight if ms <= 1.5 * wanted else None
        return None
    if kind == INTEGRAL:
        kp = law.kp * log(rng, 0.2, 0.6)
        rolling = _rounded(kp, log(rng, 0.1, 0.6) / (plant.slope * kp), 0.0)
        return rolling if 3.0 <= peak(plant, rolling, STEP_S) <= 12.0 else None
    if kind in {SPLIT, P_ONLY}:
        less = _rounded(law.kp * log(rng, 0.3, 1.0), law.ti, law.td, law.form)
        return replace(less, ti=math.inf) if kind == P_ONLY else less
    return law


def _body(rng: Rng, kind: str, plant: Plant, law: Law, noise: float) -> Body:
    """Return plant, law and what lies between them."""
    op0 = 50.0 if kind == SPLIT else float(rng.uniform(35, 65))
    body = Body(plant, law, -op0, 100.0 - op0, tracks=bool(rng.random() < 0.4))
    if kind == STICK:
        band = log(rng, 0.4, 5.0)
        return replace(body, valve=Valve("stiction", band, band * rng.uniform(0.0, 0.6)))
    if kind == BACKLASH:
        return replace(body, valve=Valve("backlash", log(rng, 0.2, 3.0)))
    if kind == RATE:
        kick = abs(law.kp) * noise * 20
        seconds = (plant.theta + plant.lag) * log(rng, 0.5, 4.0)
        return replace(body, valve=Valve("rate", kick / seconds))
    if kind == SPLIT:
        ratio = log(rng, 3.0, 6.0)  # the settings are those of the side with the lower gain
        return replace(
            body, valve=Valve("direction", *((1.0, ratio) if rng.random() < 0.5 else (ratio, 1.0)))
        )
    if kind == RELAY:
        cycle = round(max((plant.theta + plant.lag) * log(rng, 0.1, 0.5), 60.0) / 10) * 10
        return replace(body, pulses=cycle)
    return replace(body, pv_quantum=noise * log(rng, 0.1, 1.0) if rng.random() < 0.2 else 0.0)


def _response(body: Body) -> tuple[float, float]:
    """Return how long a load step of one takes to be over [s], and the load that moves PV by one [OP/PV]."""
    quiet = Inputs.quiet(int(2 * LONGEST_S))
    quiet.load[:] = 1.0
    linear = replace(body, valve=Valve(), pulses=0, op_low=-math.inf, op_high=math.inf, pv_quantum=0.0)
    pv = live(linear, quiet).true
    left = np.abs(pv - (pv[-1] if math.isinf(body.law.ti) else 0.0))
    largest = float(np.abs(pv).max())
    return float(np.flatnonzero(left > 0.03 * largest)[-1]) * STEP_S, 1.0 / largest
