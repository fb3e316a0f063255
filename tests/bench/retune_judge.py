"""One loop of the benchmark `retune` through the engine, and its suggestion through the true plant."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, field, replace
from typing import Any

from monitor.assess.reference import closed_loop_time, reduced, reference_structure
from monitor.contract.loops import LoopTable
from monitor.contract.records import INCONCLUSIVE, LOAD, RETUNE, SETPOINT, Assessment, LoopRow
from monitor.engine import Engine
from sim_plants.controllers import Controller
from sim_plants.specs import LoopSpec
from tests.bench.retune_fleet import CASES, PI, SELF, Case, draw, record, table_row
from tests.bench.retune_truth import index, model_of, sensitivity, stable

START_NS = 1_767_225_600_000_000_000
"""First sample of every simulation [ns]."""
SLOW, NERVOUS = 0.5, 3.0
"""A loop needs retuning below this true CI, or, where its settings are known, above this true Ms."""


@dataclass
class Outcome:
    """What the engine said of a loop, and what is true of it. Times in seconds, NaN or None where there is nothing."""

    case: str
    number: int
    plant: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)
    period: float = math.nan
    samples: int = 0
    ms_before: float = math.nan
    ci_before: dict[str, float] = field(default_factory=dict)
    """By kind of event."""
    crash: str = ""
    """What the engine raised; data never should."""
    events: int = 0
    """Of the right kind."""
    others: int = 0
    """Events that nobody made."""
    record: dict[str, Any] = field(default_factory=dict)
    """The assessment."""
    row: dict[str, Any] = field(default_factory=dict)
    """The loop's row."""
    tc: float = math.nan
    """Closed-loop time of the suggestion, and where it would be without any constraint, on the true model."""
    tc_wanted: float = math.nan
    binding: str = ""
    new: dict[str, Any] = field(default_factory=dict)
    ms_after: float | None = None
    ms_stages: float | None = None
    ci_after: dict[str, float] = field(default_factory=dict)
    cost: float = math.nan
    """Processor time of one event's assessment and advice, without the samples' way to it [s]."""

    @property
    def kind(self) -> str:
        return CASES[self.case].kind

    @property
    def needs(self) -> bool:
        nervous = CASES[self.case].settings_given and self.ms_before > NERVOUS
        return nervous or self.ci_before[self.kind] < SLOW

    @property
    def verified(self) -> bool:
        return bool(self.record) and self.record["verdict"] != INCONCLUSIVE

    @property
    def full(self) -> bool:
        """Whether more was done than a direct fit: an indirect one, or a search for safe settings."""
        searched = self.row["verdict"] == RETUNE or "as tight as" in self.row["reason"]
        return searched or self.record.get("method") != "direct"

    @property
    def cured(self) -> bool:
        return self.ms_after is not None and self.ci_after.get(self.kind, 0.0) >= 0.6


def judge_many(case_name: str, numbers: range, seed: int) -> list[Outcome]:
    """Judge some loops of a case, in this process; the first of a process is judged twice, to compile."""
    case = CASES[case_name]
    if not _warm:
        _warm.append(True)
        for name in ("noise1-sp", "unknown-sp", "self-sp", "noise1-ld", "self-ld"):
            judge(CASES[name], 0, seed)
    return [judge(case, number, seed) for number in numbers]


_warm: list[bool] = []


def judge(case: Case, number: int, seed: int) -> Outcome:
    """Judge one loop."""
    spec = draw(case, number, seed, stable)
    loop = table_row(spec, case)
    out = Outcome(case.name, number)
    theta, lag = spec.plant.half_rule()
    out.plant = {
        "process": spec.plant.process, "gain": spec.plant.gain, "dead_time": spec.plant.dead_time,
        "lags": spec.plant.lags, "theta": theta, "lag": lag, "t0": spec.plant.t0,
    }  # fmt: skip
    out.controller = _plain(spec.controller)
    out.period = spec.true_period
    out.ms_before = sensitivity(spec, spec.controller)
    out.ci_before = {kind: index(spec, loop, spec.controller, kind) for kind in (SETPOINT, LOAD)}
    model, structure = reduced(model_of(spec), reference_structure(loop)), reference_structure(loop)
    out.tc_wanted = closed_loop_time(loop, model, spec.true_period)

    samples = record(spec, case.bad_data)
    out.samples = len(samples)
    engine = Engine(LoopTable([loop]))
    records = engine.detect(samples)
    began = time.thread_time()
    try:
        records += engine.assess()
        records += engine.flush()
    except Exception as error:  # noqa: BLE001 (one loop must not end the benchmark; it counts as a failure)
        out.crash = f"{type(error).__name__}: {error}"
    spent = time.thread_time() - began
    made = [r for r in records if isinstance(r, Assessment)]
    right = [r for r in made if r.kind == case.kind]
    out.events, out.others = len(right), len(made) - len(right)
    if made:
        out.cost = spent / len(made)
    if right:
        out.record = _fields(right[0])
        onset = (spec.setpoint.times or spec.load.times)[0]
        out.record["onset_late"] = ((right[0].start - START_NS) * 1e-9 - onset) / spec.true_period
    row = engine.row(0)
    out.row = _fields(row)
    if row.new_kp is not None:
        out.tc, out.binding = _binding(engine, loop, row, structure)
        _after(out, spec, loop, row)
    return out


def _after(out: Outcome, spec: LoopSpec, loop: Any, row: LoopRow) -> None:
    """Try the suggestion on the true plant."""
    assert row.new_kp is not None
    new = _with(spec, row.new_kp, row.new_ti, row.new_td or 0.0, row.new_tf or 0.0)
    out.new = _plain(new)
    out.ms_after = sensitivity(spec, new)
    if math.isfinite(out.ms_after):
        out.ci_after = {kind: index(spec, loop, new, kind) for kind in (SETPOINT, LOAD)}
    peaks = []
    for stage in json.loads(row.stages or "[]"):
        kp = stage["kp"]
        ti = (kp / stage["ki"] if stage["ki"] else None) if "ki" in stage else stage["ti"]
        td = stage["kd"] / kp if "kd" in stage else stage["td"]
        peaks.append(sensitivity(spec, _with(spec, kp, ti, td, stage["tf"])))
    out.ms_stages = max(peaks, default=None)


def _with(spec: LoopSpec, kp: float, ti: float | None, td: float, tf: float) -> Controller:
    return replace(spec.controller, kp=kp, ti=math.inf if ti is None else ti, td=td, tf=tf)


def _binding(engine: Engine, loop: Any, row: LoopRow, structure: str) -> tuple[float, str]:
    """Return the suggestion's closed-loop time, and what kept it from being shorter (inferred)."""
    kept = engine._histories[0].standing
    advice = None if kept is None else kept.advice
    if advice is None or row.new_ms_worst is None or row.new_kp is None:
        return math.nan, "?"
    dead_time = row.dead_time or 0.0
    if structure == "pi" and row.process == "integrating":
        dead_time += (row.lag or 0.0) / 2
    wanted = max(dead_time, 3 * (engine.detector.state[0]["clock"]["period"] or 0.0))
    if advice.closed_loop_time < 1.05 * wanted:
        return advice.closed_loop_time, "none"
    ratio = abs(row.new_kp / loop.kp) if loop.kp else 1.0
    if row.new_ms_worst > 0.9 * loop.ms_max:
        return advice.closed_loop_time, "Ms of the worst model"
    if ratio > 8.0:
        return advice.closed_loop_time, "ten times the gain"
    return advice.closed_loop_time, "other"


def _plain(controller: Controller) -> dict[str, Any]:
    return {
        "form": controller.form, "kp": controller.kp, "ti": controller.ti, "td": controller.td,
        "tf": controller.filter_time,
    }  # fmt: skip


def _fields(struct: Any) -> dict[str, Any]:
    return {name: getattr(struct, name) for name in struct.__struct_fields__}


def turns_pi_into_pid(outcome: Outcome) -> bool:
    """Whether a loop declared as PI was given a derivative."""
    return CASES[outcome.case].fleet in {PI, SELF} and bool(outcome.new.get("td"))
