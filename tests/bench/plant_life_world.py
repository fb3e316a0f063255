"""One loop of the benchmark `plant_life` with its days, its record and its table, and the facts that are true of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from tests.bench.mismatch_plant import Law
from tests.bench.mismatch_shapes import Rng
from tests.bench.mismatch_sim import Valve
from tests.bench.plant_life_days import Happened, happen
from tests.bench.plant_life_fleet import BACKLASH, RATE, SPLIT, STICK, Base, draw
from tests.bench.plant_life_recording import HOWS, record
from tests.bench.plant_life_sim import STEP_S, Inputs, Lived, live
from tests.bench.plant_life_truth import Facts

CLEAN_SD = 5.0
"""Size of a step from which a verdict can rest on it."""
BEFORE, AFTER = 1.0, 1.5
"""Settling times before and after it in which nothing else happens."""
CLEAN_SAMPLES = 10
"""Recorded samples in a settling time from which a response can be seen."""
SETTINGS_SHARE, LIMITS_SHARE, PROCESS_SHARE = 0.5, 0.6, 0.3
"""Shares of the loop tables that tell settings, limits, the kind of process."""
UNDER_WAY = 0.5
"""OP less the stem from which a slow valve is under way [% of the span]."""


@dataclass(frozen=True)
class Life:
    """A loop, what was recorded of it, and what is true."""

    base: Base
    happened: Happened
    lived: Lived
    samples: Samples
    table: Loop
    facts: Facts


def lead(kind: str, number: int, seed: int, days: float = 1.0) -> Life:
    """Draw a loop of a kind and let it live for some days; the same arguments give the same life."""
    base = draw(kind, number, seed)
    rng = np.random.default_rng([seed, number, 1, *map(ord, kind)])
    happened = happen(base, rng, days)
    lived = live(base.body, happened.what)
    how = str(rng.choice(list(HOWS), p=list(HOWS.values())))
    samples, seen = record(base, happened.what, lived, rng, how)
    facts = _facts(happened, lived, samples, seen)
    facts.how = how
    facts.ms, facts.ci = base.truth(base.body.law)
    return Life(base, happened, lived, samples, _table(rng, base), facts)


def _table(rng: Rng, base: Base) -> Loop:
    """Return what the loop table says, nothing of it wrong."""
    law, body = base.body.law, base.body
    known: dict[str, object] = {}
    if rng.random() < SETTINGS_SHARE:
        known = {"kp": law.kp, "ti": law.ti, "td": law.td, "tf": law.tf if law.td else None, "form": law.form}
    elif law.form != "standard" and rng.random() < 0.5:
        known = {"form": law.form}
    if rng.random() < LIMITS_SHARE or body.pulses:
        known |= {"op_low": 0.0, "op_high": 100.0}
    if rng.random() < PROCESS_SHARE:
        known["process"] = body.plant.process
    return Loop(name=f"{base.kind}-{base.number}", **known)  # type: ignore[arg-type]


def _facts(happened: Happened, lived: Lived, samples: Samples, seen: NDArray[np.bool_]) -> Facts:
    base, what = happened.base, happened.what
    control = what.auto & seen
    body = base.body
    at_limit = (lived.op <= body.op_low) | (lived.op >= body.op_high)
    swinging = sum(int(seen[first:last].sum()) for first, last in happened.spells)
    facts = Facts(
        noise=base.noise,
        clean=sum(_is_clean(happened, k, seen) for k in range(len(happened.events))),
        cycles=swinging * STEP_S / happened.wave_s if happened.wave_s else 0.0,
        wave_sd=happened.wave_sd,
        wander_sd=happened.wander_sd,
        cycle_samples=happened.wave_s / base.every if happened.wave_s else math.inf,
        samples_in_natural=base.natural / base.every,
        saturation=_mean(at_limit[control]) if not body.pulses else 0.0,
        manual=1.0 - _mean(what.auto[seen]),
        told_manual=1.0 - _mean(samples.auto),
        frozen=_mean(what.frozen[seen]),
        shut=_mean(what.shut[seen]),
        offset_sd=abs(_mean((lived.sp - lived.true)[control])) / base.noise,
    )
    if base.kind in {STICK, BACKLASH}:
        ideal = live(replace(body, valve=Valve()), what)
        low, high = (
            np.percentile((lived.true - ideal.true)[control], [5, 95]) if control.any() else (0.0, 0.0)
        )
        facts.band_sd = float(high - low) / base.noise
    if base.kind == RATE:
        facts.rate = _mean((np.abs(lived.op - lived.stem) > UNDER_WAY)[control])
    if base.kind == SPLIT:
        facts.crossed = min(_mean(lived.op[control] > 1.0), _mean(lived.op[control] < -1.0)) > 0.1
    return facts


def _mean(values: NDArray[np.generic]) -> float:
    return float(np.mean(values)) if len(values) else 0.0


def _is_clean(happened: Happened, k: int, seen: NDArray[np.bool_]) -> bool:
    """Whether an event is a step that shows by itself how the loop is tuned."""
    at, what, size = happened.events[k]
    base = happened.base
    first, last = at - BEFORE * base.settle, at + AFTER * base.settle
    if what not in {"setpoint", "step"} or abs(size) < CLEAN_SD or first < 0 or last > happened.n * STEP_S:
        return False
    if any(first < other < last for j, (other, *_) in enumerate(happened.events) if j != k):
        return False
    part = slice(int(first / STEP_S), int(last / STEP_S))
    good = bool(happened.what.auto[part].all()) and float(seen[part].mean()) > 0.95
    return good and base.settle / base.every > CLEAN_SAMPLES


def swings(base: Base, law: Law) -> bool:
    """Whether the loop with its valve swings on after a set-point step of twenty standard deviations."""
    n = int(min(40 * base.settle, 20_000.0)) + 2000
    step = Inputs.quiet(n)
    step.sp[10:] = 20.0 * base.noise
    error = step.sp - live(replace(base.body, law=law, pv_quantum=0.0), step).true
    third = n // 3
    late, middle = np.ptp(error[-third:]), np.ptp(error[third : 2 * third])
    return bool(late > 0.5 * middle and late > 5.0 * base.noise)
