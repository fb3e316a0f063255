"""What is true of a loop of the benchmark `mismatch` under any settings: stability, peak sensitivity, indices."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from monitor.assess.reference import closed_loop_time, reduced, reference_iae, reference_structure
from monitor.contract.loops import Loop
from tests.bench.mismatch_event import LOAD, SETPOINT, asked, loading, shift
from tests.bench.mismatch_plant import INTEGRATING, Law, peak
from tests.bench.mismatch_sim import Rig, Valve
from tuners.models import IntegratingModel, Model, SelfRegulatingModel

if TYPE_CHECKING:
    from tests.bench.mismatch_fleet import Drawn

LONGEST_IAE = 60_000
"""Fine steps over which an IAE is taken."""


def factors(drawn: Drawn) -> tuple[float, ...]:
    """Factors on the plant's gain where the loop rests before, between and after its events."""
    valve = drawn.rig.valve
    if valve.kind == "direction":
        # at rest between the two sides both count half; a side that no event visits is nobody's to know
        visited = {"up": valve.first, "down": valve.second}
        return (valve.first + valve.second) / 2, *(
            g for side, g in visited.items() if drawn.extra.get(side, 1.0)
        )
    op = -drawn.push if drawn.event == LOAD else 0.0
    if drawn.event == SETPOINT and not drawn.rig.plant.integrators:
        op = drawn.size * drawn.rig.plant.slope**-1
    level = drawn.size if drawn.event == SETPOINT else 0.0
    return valve.slope(0.0, 0.0), valve.slope(op, level)


def true_peak(drawn: Drawn, law: Law) -> float:
    """Worst Ms of the true loop over where it rests."""
    linear = linearised(drawn, law)
    return max(peak(drawn.rig.plant, linear, drawn.scan, f) for f in factors(drawn))


def linearised(drawn: Drawn, law: Law) -> Law:
    """Return the linear law that answers a swing of the event's size as this one does."""
    if law.kind != "squared":
        return replace(law, kind="linear")
    describing = 8 / (3 * math.pi)  # of e|e|, at amplitude 1
    return replace(law, kp=describing * drawn.extra["deviation"] / law.width * law.kp, kind="linear")


def grows(drawn: Drawn, law: Law) -> bool:
    """Simulate the first event under a law, without noise: whether the error is larger late than early.

    What is slow goes on growing for long: it is given more and more time.
    """
    return all(_grows(drawn, law, fine) for fine in (12_000, 60_000, 300_000))


def _grows(drawn: Drawn, law: Law, fine: int) -> bool:
    rig = drawn.unused()
    rig.type_in(law)
    sp, load, _ = loading(drawn, 0, fine, 10 * drawn.every)
    if drawn.kind.loading in {"wandering-load", "sinusoidal-load"}:
        load = load * 0.0
    pv, _ = rig.run(asked(drawn, sp), load, shift(drawn, 0, fine, 10 * drawn.every))
    error = np.abs(sp - pv)
    third = fine // 3
    middle, late = error[third : 2 * third].max(), error[2 * third :].max()
    return bool(late > 1.05 * middle and late > 0.1 * error.max()) or not np.isfinite(error).all()


def model_of(drawn: Drawn) -> Model:
    """Return the half-rule model of all that lies between OP as computed and PV as compared."""
    plant, law = drawn.rig.plant, drawn.law
    late = law.filter + law.late * drawn.scan + 0.5 * max(drawn.scan - drawn.period, 0.0)
    if (plant.ruled or plant.process) == INTEGRATING:
        return IntegratingModel(plant.slope, plant.theta + late, plant.lag)
    return SelfRegulatingModel(plant.slope, plant.theta + late, plant.lag, 0.0)


def indices(drawn: Drawn, law: Law) -> dict[str, float]:
    """CI for set point and load of the linear true loop: the contract's reference over the IAE without noise."""
    return {kind: _index(drawn, law, kind) for kind in (SETPOINT, LOAD)}


def _index(drawn: Drawn, law: Law, kind: str) -> float:
    loop = Loop(name="x", controller=drawn.structure, b=law.b, c=law.c)
    model, structure = model_of(drawn), reference_structure(loop)
    tc = closed_loop_time(loop, reduced(model, structure), drawn.period)
    rig = Rig(drawn.rig.plant, linearised(drawn, law), drawn.rig.step, drawn.rig.scan, Valve())
    iae, one, chunk = 0.0, float(kind == SETPOINT), 6000
    for _ in range(LONGEST_IAE // chunk):
        sp, load = np.full(chunk, one), np.full(chunk, 1.0 - one)
        error = np.abs(sp - rig.run(sp, load)[0])
        iae += float(error.sum()) * drawn.rig.step
        if error[-chunk // 4 :].sum() * drawn.rig.step < 1e-4 * iae or not math.isfinite(iae):
            break
    return reference_iae(kind, 1.0, model, structure, tc, loop.b, loop.c) / iae
