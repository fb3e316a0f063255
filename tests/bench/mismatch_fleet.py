"""The loops of the benchmark `mismatch`: each kind breaks one of the product's assumptions.

A loop depends on its kind, its number and the seed alone. Even numbers show set-point steps, odd ones load steps,
unless the kind says otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from monitor.contract.loops import Loop
from tests.bench.mismatch_event import LOAD, SETPOINT, pure
from tests.bench.mismatch_plant import INTEGRATING, SELF, Law, Plant
from tests.bench.mismatch_shapes import SHAPES, Rng, log
from tests.bench.mismatch_sim import Rig, Valve
from tests.bench.mismatch_truth import grows, true_peak

SHAPE, LOADS, VALVE, RECORDING, TABLE, RIGHT = "shape", "loads", "valve", "recording", "table", "right"
SUBSTEPS = 4
"""Fine steps in a recorded sample, where the controller executes once a sample."""


@dataclass(frozen=True)
class Kind:
    """What one row of the table is about; all that is not named is as the product assumes it."""

    name: str
    group: str
    shape: str = "either"
    said: str = ""
    """Process declared, instead of the truth for half of the loops."""
    event: str = ""
    loading: str = "step"
    valve: str = "linear"
    block: str = ""
    """What the controller's block does that the table does not tell."""
    recording: str = ""
    table: str = ""
    """How the table is wrong."""
    word: str = ""
    """Words, one of which a reason that names the cause must hold."""
    noise: float = 0.01
    """Standard deviation as a share of PV's largest deviation."""

    @property
    def right(self) -> bool:
        """Whether an accusation of the table would be false."""
        spoilt = self.table or self.recording in {"fraction", "inverted"}
        return not spoilt and self.block in {"", "feed-forward", "late", "i-pd", "pi-d", "p"}


def _kinds() -> list[Kind]:
    shapes = [
        Kind(name, SHAPE, shape=shape, said=said)
        for name, shape, said in (
            ("high-order", "high_order", ""),
            ("dead-time-only", "dead_time_only", ""),
            ("inverse-response", "inverse", ""),
            ("lead", "lead", ""),
            ("leak-called-integrating", "leak", INTEGRATING),
            ("leak-undeclared", "leak", "auto"),
            ("two-lags-called-integrating", "two_lags", INTEGRATING),
            ("lag-called-integrating", "slow_lag", INTEGRATING),
            ("integrating-called-self-regulating", "integrating", SELF),
            ("resonance-narrow", "resonance_narrow", ""),
            ("resonance-broad", "resonance_broad", ""),
            ("resonance-hidden", "resonance_hidden", ""),
            ("recycle", "recycle", ""),
            ("gain-and-integrator", "gain_and_integrator", ""),
            ("underdamped", "underdamped", ""),
        )
    ]
    loads = [
        Kind(name, LOADS, loading=name, event=event)
        for name, event in (
            ("load-lag", LOAD),
            ("load-ramp", LOAD),
            ("load-pulse", LOAD),
            ("drift-with-setpoint", SETPOINT),
            ("two-steps", ""),
            ("sinusoidal-load", ""),
            ("coupled-loops", SETPOINT),
            ("wandering-load", ""),
            ("load-with-setpoint", SETPOINT),
            ("load-in-response", SETPOINT),
            ("load-at-output", LOAD),
        )
    ]
    valves = [
        Kind(name, VALVE, valve=valve)
        for name, valve in (
            ("equal-percentage", "percentage"),
            ("quick-opening", "quick"),
            ("gain-by-direction", "direction"),
            ("backlash", "backlash"),
            ("stiction", "stiction"),
            ("rate-limited", "rate"),
            ("clipped-output", "clipped"),
        )
    ]
    valves += [
        Kind("horizontal-drum", VALVE, shape="integrating", valve="drum"),
        Kind("area-by-level", VALVE, shape="integrating", valve="root"),
    ]
    recordings = [
        Kind("pv-filter", RECORDING, block="filter", word="filter"),
        Kind("op-late", RECORDING, recording="op-late"),
        Kind("pv-late", RECORDING, recording="pv-late"),
        Kind("pv-recorded-filtered", RECORDING, recording="pv-filtered"),
        Kind("setpoint-filter", RECORDING, block="sp-filter", event=SETPOINT),
        Kind("lost-rows", RECORDING, recording="lost"),
        Kind("one-sample-late", RECORDING, block="late"),
        Kind("slow-scan", RECORDING, block="slow-scan", word="scan execut"),
        Kind("coarse-recording", RECORDING, recording="coarse"),
        Kind("averaged", RECORDING, recording="averaged"),
        Kind("op-quantised", RECORDING, recording="op-quantised"),
        Kind("op-rounded-by-historian", RECORDING, recording="op-rounded"),
        Kind("pv-quantised", RECORDING, recording="pv-quantised"),
        Kind("swinging-door", RECORDING, recording="swinging-door"),
        Kind("exception-deadband", RECORDING, recording="exception"),
        Kind("exception-rows", RECORDING, recording="exception-rows"),
        Kind("unsynchronised", RECORDING, recording="unsynchronised"),
        Kind("odd-scan", RECORDING, block="odd-scan"),
        Kind("jittered-times", RECORDING, recording="jitter"),
        Kind("feed-forward", RECORDING, block="feed-forward"),
        Kind("noise-3pct", RECORDING, noise=0.03),
        Kind("setpoint-ramp", RECORDING, loading="setpoint-ramp", event=SETPOINT),
    ]
    tables = [
        Kind("ti-in-minutes", TABLE, table="minutes", word="minute"),
        Kind("repeats-per-minute", TABLE, table="repeats", word="repeat"),
        Kind("kp-too-small", TABLE, table="kp-small", word="kp gain"),
        Kind("kp-too-large", TABLE, table="kp-large", word="kp gain"),
        Kind("kp-in-percent", TABLE, table="percent", word="%/% span range"),
        Kind("sign-wrong", TABLE, table="sign", word="sign"),
        Kind("series-said-standard", TABLE, shape="integrating", table="series", word="series form"),
        Kind("ti-two-and-a-half", TABLE, table="ti-2.5", word="ti reset 2.5"),
        Kind("proportional-band", TABLE, table="band", word="band"),
        Kind("td-missing", TABLE, shape="integrating", table="no-td", word="td derivative"),
        Kind("ti-and-td-in-minutes", TABLE, shape="integrating", table="both-minutes", word="minute"),
        Kind("op-as-fraction", TABLE, table="", recording="fraction", word="fraction percent 100"),
        Kind("op-inverted", TABLE, table="", recording="inverted", word="sign invert"),
        Kind("error-squared", TABLE, block="squared", word="squared linear"),
        Kind("gap-action", TABLE, block="gap", word="gap linear"),
        Kind(
            "i-pd-said-pid",
            TABLE,
            event=SETPOINT,
            block="i-pd",
            table="weights",
            word="measurement weight i-pd set-point",
        ),
        Kind("no-table", TABLE, table="none"),
        Kind("no-table-noise-3pct", TABLE, table="none", noise=0.03),
    ]
    rights = [
        Kind("base", RIGHT),
        Kind("base-integrating", RIGHT, shape="integrating"),
        Kind("base-self-regulating", RIGHT, shape="self_regulating"),
        Kind("base-noise-free", RIGHT, noise=0.0),
        Kind("i-pd", RIGHT, block="i-pd"),
        Kind("pi-d", RIGHT, shape="integrating", block="pi-d"),
        Kind("p-only", RIGHT, shape="integrating", event=SETPOINT, block="p"),
    ]
    return [*rights, *shapes, *loads, *valves, *recordings, *tables]


KINDS = {kind.name: kind for kind in _kinds()}


@dataclass
class Drawn:
    """One loop as drawn: the truth, and what the table says."""

    kind: Kind
    number: int
    event: str
    rig: Rig
    law: Law
    """Settings at first."""
    table: Loop
    structure: str
    """By which the loop is judged: what a suggestion may use."""
    every: int
    """Fine steps in a recorded sample."""
    size: float = 1.0
    """Of set-point steps [PV]."""
    push: float = 1.0
    """Of load steps [OP]."""
    noise: float = 0.0
    """Standard deviation [PV]."""
    extra: dict[str, float] = field(default_factory=dict)
    """What the kind draws for its loading and its recording."""
    pv0: float = 0.0
    op0: float = 50.0
    seed: int = 0

    @property
    def period(self) -> float:
        return self.every * self.rig.step

    @property
    def scan(self) -> float:
        return self.rig.scan * self.rig.step

    def unused(self) -> Rig:
        """Return the rig at rest where it began."""
        rig = self.rig.copy()
        rig.__post_init__()
        return rig


def draw(kind: Kind, number: int, seed: int) -> Drawn:
    """Draw one loop of a kind; what is unstable is drawn again."""
    rng = np.random.default_rng([seed, number, *map(ord, kind.name)])
    event = kind.event or (SETPOINT, LOAD)[number % 2]
    while True:
        drawn = _loop(rng, kind, number, event)
        if math.isfinite(true_peak(drawn, drawn.law)):
            furnish(rng, drawn)
            if math.isfinite(true_peak(drawn, drawn.law)) and not grows(drawn, drawn.law):
                break
    drawn.seed = int(rng.integers(2**62))
    return drawn


def _loop(rng: Rng, kind: Kind, number: int, event: str) -> Drawn:
    dead = log(rng, 1.0, 100.0)
    period = round(dead / log(rng, 3.0, 20.0), 3)
    gain = log(rng, 1e-4, 1.0) * float(rng.choice([-1, 1]))
    every, scan = SUBSTEPS, SUBSTEPS
    if kind.block == "slow-scan":
        every, scan = 2, 2 * int(rng.integers(3, 11))
    if kind.block == "odd-scan":  # no multiple of the recorded period
        scan = int(rng.choice([5, 6, 7, 9, 10, 11, 13, 14]))
    if kind.recording in {"coarse", "averaged"}:
        every, scan = int(rng.integers(3, 11)), 1
    step = period / every
    dead = round(dead / step) * step
    plant = SHAPES[kind.shape](rng, dead, gain)
    weight = {"i-pd": (0.0, 0.0), "pi-d": (1.0, 0.0)}.get(kind.block, (1.0, 1.0))
    blocked = {
        "b": weight[0],
        "c": weight[1],
        "filter": dead * log(rng, 0.3, 5.0) if kind.block == "filter" else 0.0,
        "late": int(kind.block == "late"),
    }
    wait = blocked["filter"] + scan * step * (blocked["late"] + 0.5) - 0.5 * min(scan, every) * step
    law = replace(settings(rng, plant, wait, kind), **blocked)
    rig = Rig(plant, law, step, scan)
    said = kind.said or (plant.process if rng.random() < 0.5 else "auto")
    name = f"{kind.name}-{number}"
    table = Loop(
        name=name, process=said, form=law.form, kp=law.kp, ti=law.ti, td=law.td, b=law.b, c=law.c,
        controller="" if kind.block == "p" else "pid" if law.td > 0 or rng.random() < 0.3 else "pi",
    )  # fmt: skip
    drawn = Drawn(kind, number, event, rig, law, table, table.structure, every)
    drawn.pv0, drawn.op0 = float(rng.uniform(-100, 100)), float(rng.uniform(30, 70))
    drawn.extra["wait"] = wait
    return drawn


def settings(rng: Rng, plant: Plant, wait: float, kind: Kind) -> Law:
    """SIMC with tc = theta, detuned in gain and reset; td none, half or right for plants with a retained lag."""
    theta, lag = plant.theta + wait, plant.lag
    integrates = (plant.ruled or plant.process) == INTEGRATING
    share = float(rng.choice([0.0, 0.5, 1.0]))
    if kind.table in {"series", "no-td", "both-minutes"}:
        share, lag = float(rng.choice([0.5, 1.0])), max(lag, 0.5 * theta)
    td = share * lag if integrates else 0.0
    if integrates:
        theta += 0.0 if td else lag / 2
        kp, ti = 1 / (plant.slope * 2 * theta), 8 * theta
    else:
        kp, ti = lag / (plant.slope * 2 * theta), min(lag, 8 * theta)
    kp, ti = kp * log(rng, 0.13, 2.2), ti * log(rng, 0.4, 5.0)
    if kind.table == "series":
        ti = td * log(rng, 3.0, 10.0)  # else the forms are all but the same
    forms = ["series", "standard"] if kind.group == TABLE else ["series", "standard", "parallel"]
    form = str(rng.choice(forms)) if kind.table != "series" else "series"
    if td and form != "series":
        factor = 1 + td / ti
        kp, ti, td = kp * factor, ti * factor, td / factor
    if kind.block == "p":
        ti = math.inf
    three = [float(f"{x:.3g}") for x in (kp, ti, td)]
    return Law(*three, three[2] / 10, form)


def furnish(rng: Rng, drawn: Drawn) -> None:
    """Draw sizes, and all that scales with them: valve, limits, quanta, loading, noise, the error in the table."""
    kind, rig = drawn.kind, drawn.rig
    for name in ("a", "b", "c", "d"):  # numbers between 0 and 1 for whatever the kind needs
        drawn.extra[name] = float(rng.random())
    sign = float(rng.choice([-1, 1]))
    aim = log(rng, 4.0, 20.0)
    drawn.push = sign * aim
    _, pv, op = pure(drawn, 1.0)
    if drawn.event == SETPOINT or kind.loading == "load-at-output":
        drawn.size = sign * aim / float(np.abs(op).max())
        _, pv, op = pure(drawn, 1.0)
    moved, deviation = float(np.abs(op).max()), float(np.abs(pv).max())
    rig.valve = _valve(rng, drawn, moved, deviation)
    drawn.extra |= {"up": float(op.max() > 0.05 * moved), "down": float(op.min() < -0.05 * moved)}
    if kind.valve == "clipped":
        limit = max(moved * rng.uniform(0.3, 0.8), 1.1 * abs(float(op[-1])))
        if op[np.argmax(np.abs(op))] > 0:
            rig.op_high, rig.op_low = limit, limit - 100.0
        else:
            rig.op_low, rig.op_high = -limit, 100.0 - limit
        drawn.op0 = -rig.op_low
        drawn.table = changed(drawn.table, op_low=0.0, op_high=100.0)
    if kind.recording == "op-quantised":
        rig.op_quantum = moved * log(rng, 0.005, 0.05)
    if kind.recording == "pv-quantised":
        rig.pv_quantum = deviation * log(rng, 0.005, 0.03)
    if kind.block in {"squared", "gap"}:
        width = deviation * (rng.uniform(0.5, 1.0) if kind.block == "squared" else rng.uniform(0.1, 0.4))
        rig.law = drawn.law = replace(drawn.law, kind=kind.block, width=width, inside=rng.uniform(0.0, 0.3))
    drawn.extra["deviation"] = deviation
    drawn.noise = kind.noise * float(np.abs(pure(drawn, 1.0)[1]).max())
    drawn.table = wrong(rng, drawn, deviation)


def _valve(rng: Rng, drawn: Drawn, moved: float, deviation: float) -> Valve:
    kind = drawn.kind.valve
    ratio = log(rng, 1.5, 4.0) ** rng.choice([-0.5, 0.5])
    band = moved * log(rng, 0.02, 0.15)
    numbers = {
        "percentage": (math.log(rng.uniform(20, 50)) / 100,),
        "quick": (-math.log(rng.uniform(20, 50)) / 100,),
        "direction": (ratio, 1 / ratio),
        "backlash": (moved * log(rng, 0.01, 0.1),),
        "stiction": (band, band * rng.uniform(0.0, 0.7)),
        "rate": (moved / (drawn.rig.plant.theta * log(rng, 0.5, 4.0)),),
        "drum": (deviation / rng.uniform(0.05, 0.25) * rng.choice([-1, 1]), rng.uniform(0.3, 0.6)),
    }
    numbers["root"] = numbers["drum"]
    curved = "percentage" if kind == "quick" else kind
    return Valve(curved, *numbers[kind]) if kind in numbers else Valve()


def wrong(rng: Rng, drawn: Drawn, deviation: float) -> Loop:
    """Return the table as the kind makes it wrong."""
    kp, ti, off = drawn.law.kp, drawn.law.ti, log(rng, 3.0, 10.0)
    span = max(100 * log(rng, 2.0, 20.0) ** rng.choice([-1, 1]), 2 * deviation)
    span = 250.0 if 67 < span < 150 else span  # else nobody could tell
    ranges = {
        "pv_low": drawn.pv0 - span / 2,
        "pv_high": drawn.pv0 + span / 2,
        "op_low": 0.0,
        "op_high": 100.0,
    }
    changes: dict[str, dict[str, Any]] = {
        "minutes": {"ti": ti / 60},
        "repeats": {"ti": 60 / ti},
        "kp-small": {"kp": kp / off},
        "kp-large": {"kp": kp * off},
        "percent": {"kp": kp * span / 100} | ranges,
        "sign": {"kp": -kp},
        "no-td": {"td": 0.0},
        "both-minutes": {"ti": ti / 60, "td": drawn.law.td / 60},
        "series": {"form": "standard"},
        "ti-2.5": {"ti": ti / 2.5},
        "band": {"kp": math.copysign(100 / abs(kp), kp)},
        "weights": {"b": 1.0, "c": 1.0},
        "none": {"kp": None, "ti": math.inf, "td": 0.0, "controller": ""},
    }
    return changed(drawn.table, **changes.get(drawn.kind.table, {}))


def changed(loop: Loop, **change: Any) -> Loop:
    """Return the loop with other facts."""
    return Loop(**({name: getattr(loop, name) for name in Loop.__struct_fields__} | change))
