"""How good and how safe suggestions are on true plants: a mini fleet, one set-point step each.

``python tests/bench/bench_retune.py [loops per case]``. Prints for each noise how many loops were judged what,
and what the suggestions do to the *true* loop (sampled, with the hold of its output).
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "monitor"))

import numpy as np
from twin import watch

from monitor.records import LoopRow
from monitor.reference import SETPOINT, closed_loop_time, reduced, reference_iae, reference_structure
from sim_plants.controllers import Controller
from sim_plants.fleet import random_fleet
from sim_plants.loops import Simulation
from sim_plants.margins import settling_time
from sim_plants.plants import discretise
from sim_plants.specs import NEVER, LoopSpec, Steps
from tuners.models import IntegratingModel

NOISES = (0.0, 0.01, 0.03)
MOST_MS = 2.5
LEAST_CI = 0.6


@dataclass(frozen=True)
class Outcome:
    """What the engine said of a loop, and what is true of it."""

    spec: LoopSpec
    row: LoopRow
    fit_reason: str
    ms_before: float
    ms_after: float | None
    """Of the true loop under the suggestion; inf where unstable, None without a suggestion."""
    ms_stages: float | None
    """The worst of the stages on the way."""
    ci_after: float | None


def fleet(n: int, noise: float, seed: int = 1) -> list[LoopSpec]:
    """Return integrating loops with random settings (stable, Ms below 5) and one set-point step each."""
    drawn = random_fleet(2 * n + 20, seed, noise=(noise, noise), mix={"random": 1.0})
    loops = []
    for spec in drawn:
        if not spec.plant.integrating or len(loops) == n:
            continue
        first = max(150 * spec.period, 4 * spec.plant.t0)
        first = math.ceil(first / spec.period) * spec.period
        step = abs(spec.setpoint.sizes[0]) if spec.setpoint.sizes else 0.05 * (spec.pv_high - spec.pv_low)
        loops.append(
            replace(
                spec,
                setpoint=Steps((first,), (step,)),
                load=NEVER,
                objective="both",
                noise=noise * step,
            )
        )
    return loops


def controller_of(spec: LoopSpec, kp: float, ti: float | None, td: float, tf: float) -> Controller:
    """Return the loop's controller with other settings, in its own form."""
    return replace(spec.controller, kp=kp, ti=math.inf if ti is None else ti, td=td, tf=tf)


def true_ms(spec: LoopSpec, controller: Controller) -> float:
    """Peak sensitivity of the true loop as it runs, plant and controller in discrete time; inf where unstable."""
    dt, plant = spec.true_period, discretise(spec.plant, spec.true_period)
    omega = np.geomspace(1e-5, 1.0, 4000) * math.pi / dt
    z = np.exp(1j * omega * dt)
    n = spec.plant.order
    states = np.linalg.inv(z[:, None, None] * np.eye(n) - plant.phi)
    pushed = plant.older[None, :] * (z ** -(plant.delay + 1))[:, None]
    pushed = pushed + plant.newer[None, :] * (z**-plant.delay)[:, None]
    process = np.einsum("mij,mj->mi", states, pushed)[:, -1]
    back = 1 - 1 / z
    slope = back / (controller.filter_time * back + dt)
    lead = 1 + controller.lead * slope
    reset = dt / controller.ti / back
    law = lead * (1 + reset) if controller.form == "series" else lead + reset
    distance = 1 + process * controller.kp * law
    angle = np.unwrap(np.angle(distance))
    integrators = int(spec.plant.integrating) + int(math.isfinite(controller.ti))
    stable = abs(angle[-1] - angle[0] - integrators * math.pi / 2) < math.pi
    return float(1 / np.abs(distance).min()) if stable else math.inf


def true_ci(spec: LoopSpec, controller: Controller) -> float:
    """CI_sp of the true loop under these settings, simulated without noise and limits."""
    from twin import table_of  # noqa: PLC0415

    loop = table_of([spec])[0]
    theta, lag = spec.plant.half_rule()
    model = IntegratingModel(spec.plant.gain, theta, lag)
    structure = reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), spec.true_period)
    quiet = replace(
        spec,
        noise=0.0,
        controller=replace(controller, op_low=-math.inf, op_high=math.inf),
        setpoint=Steps((0.0,), (1.0,)),
    )
    seconds = 4 * settling_time(spec.plant, controller, spec.true_period)
    block = Simulation([quiet]).advance(seconds)
    iae = float(np.abs(block.sp - block.pv).sum()) * spec.true_period
    return reference_iae(SETPOINT, 1.0, model, structure, tc, loop.b, loop.c) / iae


def judge(spec: LoopSpec) -> Outcome:
    """Run one loop through the engine and its suggestion through the true plant."""
    import json  # noqa: PLC0415

    seconds = spec.setpoint.times[0] + 3 * settling_time(spec.plant, spec.controller, spec.true_period)
    engine, seen = watch([spec], seconds)
    row = engine.row(0)
    reason = seen.assessments[-1].reason if seen.assessments else "no event"
    before = true_ms(spec, spec.controller)
    if row.new_kp is None:
        return Outcome(spec, row, reason, before, None, None, None)
    new = controller_of(spec, row.new_kp, row.new_ti, row.new_td or 0.0, row.new_tf or 0.0)
    after = true_ms(spec, new)
    stages = []
    for stage in json.loads(row.stages or "[]"):
        kp = stage["kp"]
        ti = kp / stage["ki"] if stage.get("ki") else stage.get("ti")
        td = stage["kd"] / kp if "kd" in stage else stage["td"]
        stages.append(true_ms(spec, controller_of(spec, kp, ti, td, stage["tf"])))
    return Outcome(spec, row, reason, before, after, max(stages), true_ci(spec, new) if after < 10 else 0.0)


def main() -> None:
    """Print the table."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    for noise in NOISES:
        outcomes = [judge(spec) for spec in fleet(n, noise)]
        given = [o for o in outcomes if o.ms_after is not None]
        ms = np.array([o.ms_after for o in given])
        print(f"\nnoise {noise:.0%} of the step, {len(outcomes)} loops")
        print("  verdicts            ", dict(Counter(o.row.verdict for o in outcomes)))
        print("  suggestions         ", len(given))
        print("  .. unstable         ", int(np.isinf(ms).sum()))
        print(f"  .. Ms above {MOST_MS}     ", int((ms > MOST_MS).sum()))
        print("  .. worst Ms, median ", np.round(np.sort(ms)[-5:], 2), np.round(np.median(ms), 2))
        print(
            "  .. stage above 3    ", sum(1 for o in given if o.ms_stages is not None and o.ms_stages > 3.0)
        )
        print(f"  .. CI reaches {LEAST_CI}   ", sum(1 for o in given if (o.ci_after or 0) >= LEAST_CI))
        bad = [o for o in outcomes if o.row.verdict == "good" and o.ms_before > 3.2]
        print("  good though Ms > 3.2", len(bad))
        why = Counter(_short(o) for o in outcomes if o.ms_after is None and o.row.verdict != "good")
        for reason, count in why.most_common():
            print(f"  withheld {count:4d}  {reason}")
        if "-v" in sys.argv:
            for o in sorted(given, key=lambda o: -float(o.ms_after or 0))[:8]:
                r, p = o.row, o.spec.plant
                print(
                    f"    {r.loop} Ms {o.ms_after:.2f} said {r.new_ms:.2f}/{r.new_ms_worst:.2f} period {o.spec.period}"
                    f" true {p.gain:.4g} {p.half_rule()} {p.dead_time} {p.lags} found {r.gain:.4g}"
                    f" dead {r.dead_time:.3g} [{r.dead_time_lo:.3g}, {r.dead_time_hi:.3g}] lag {r.lag:.3g}"
                    f" {o.spec.controller.structure}/{o.spec.controller.form} kp {o.spec.controller.kp} -> {r.new_kp}"
                    f" ti {r.new_ti} td {r.new_td} (SIMC theta)"
                )


def _short(o: Outcome) -> str:
    reason = o.row.reason
    for mark in ("no suggestion: ", ""):
        if mark in reason:
            reason = reason[reason.index(mark) + len(mark) :]
            break
    words = "".join("#" if c.isdigit() else c for c in reason)
    return words[:90]


if __name__ == "__main__":
    main()
