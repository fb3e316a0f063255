"""One loop of the benchmark `mismatch` through the engine, and what it is told through the true loop."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from monitor.contract.loops import LoopTable
from monitor.contract.records import Assessment, LoopRow
from monitor.engine import Engine
from tests.bench.mismatch_event import event, record
from tests.bench.mismatch_fleet import KINDS, Drawn, Kind, changed, draw
from tests.bench.mismatch_plant import Law
from tests.bench.mismatch_sim import Rig
from tests.bench.mismatch_truth import factors, grows, indices, true_peak

SLOW, CURED_CI = 0.5, 0.6
NERVOUS, CURED_MS = 3.0, 2.75


@dataclass
class Told:
    """What was to be typed in after an event, and what that would do."""

    stage: int
    new: dict[str, float]
    ms_after: float
    grows: bool
    """The simulated true loop swings ever more."""
    ms_first: float
    """Of the first stage of the way; the same settings, where a way is what is safe now."""
    ci_after: dict[str, float] = field(default_factory=dict)

    @property
    def unstable(self) -> bool:
        return self.grows or math.isinf(self.ms_after)


@dataclass
class Outcome:
    """What the engine said of a loop, and what is true of it. Times in seconds."""

    case: str
    number: int
    event: str
    plant: dict[str, Any] = field(default_factory=dict)
    today: dict[str, Any] = field(default_factory=dict)
    standard: dict[str, float] = field(default_factory=dict)
    """Settings of today in the standard form."""
    table: dict[str, Any] = field(default_factory=dict)
    period: float = math.nan
    scan: float = math.nan
    samples: int = 0
    ms_before: float = math.nan
    ci_before: dict[str, float] = field(default_factory=dict)
    crash: str = ""
    events: int = 0
    """Events of the right kind at the first stage."""
    told: list[Told] = field(default_factory=list)
    records: list[dict[str, Any]] = field(default_factory=list)
    gains: list[bool] = field(default_factory=list)
    """Whether the true gain lies inside, for each event with an interval where there is a truth."""
    row: dict[str, Any] = field(default_factory=dict)
    """The row after the first event."""
    last_row: dict[str, Any] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    """Of all stages."""
    reasons: str = ""
    cured_first: bool = False
    cured: bool = False
    cost: float = math.nan

    @property
    def needs(self) -> bool:
        return self.ms_before > NERVOUS or self.ci_before.get(self.event, 1.0) < SLOW

    @property
    def accused(self) -> bool:
        return "settings_mismatch" in self.flags

    @property
    def named(self) -> bool:
        """Whether the cause was said: by its word, and where it is a filter or a scan, or by its number."""
        kind = KINDS[self.case]
        text = self.reasons.lower()
        said = any(word in text for word in kind.word.split())
        if kind.block == "filter":
            return said or _near(self.last_row.get("pv_filter_seen"), self.today["filter"], 0.25)
        if kind.block == "slow-scan":
            return said or _near(self.last_row.get("scan_seen"), self.scan, 0.1)
        return said and self.accused


def _near(value: Any, truth: float, share: float) -> bool:
    return value is not None and abs(value / truth - 1) <= share


def judge_many(name: str, numbers: range, seed: int, campaign: int = 1) -> list[Outcome]:
    """Judge some loops of a kind, in this process; the first of a process is judged twice, to compile."""
    if not _warm:
        _warm.append(True)
        for k in range(4):
            judge(KINDS["base"], k, seed)
    return [judge(KINDS[name], number, seed, campaign) for number in numbers]


_warm: list[bool] = []


def judge(kind: Kind, number: int, seed: int, campaign: int = 1) -> Outcome:
    """Judge one loop over one or more events."""
    drawn = draw(kind, number, seed)
    plant, rig = drawn.rig.plant, drawn.unused()
    out = Outcome(kind.name, number, drawn.event)
    out.plant = {
        n: getattr(plant, n) for n in ("process", "dead_time", "theta", "lag", "slope", "gains", "half_rule")
    }
    out.plant["poles"] = np.linalg.eigvals(plant.space.a).tolist()
    out.plant["valve"] = drawn.rig.valve
    out.today = _fields(drawn.law, drawn.law.__dataclass_fields__)
    out.standard = drawn.law.standard
    out.table = _fields(drawn.table, drawn.table.__struct_fields__)
    out.period, out.scan = drawn.period, drawn.scan
    out.ms_before = true_peak(drawn, drawn.law)
    out.ci_before = indices(drawn, drawn.law)
    engine = Engine(LoopTable([drawn.table]))
    spent, judged = 0.0, 0
    for stage in range(campaign):
        first = int(rig.memory[0])
        samples = record(drawn, event(drawn, rig, stage), first, stage)
        records = engine.detect(samples)
        began = time.thread_time()
        try:
            records += engine.flush()
            row = engine.row(0)
        except Exception as error:  # noqa: BLE001 (one loop must not end the benchmark; it counts as a failure)
            out.crash = f"{type(error).__name__}: {error}"
            break
        spent += time.thread_time() - began
        made = [r for r in records if isinstance(r, Assessment)]
        judged += len(made)
        _note(out, drawn, made, row, stage)
        out.samples += len(samples)
        if row.new_kp is not None:
            _try(out, drawn, rig, engine, stage, row)
        if out.told and out.told[-1].unstable:
            break  # nobody goes on from there
    out.cost = spent / judged if judged else math.nan
    out.cured = _cured(out, -1, rig)
    out.cured_first = _cured(out, 0, rig)
    return out


def _note(out: Outcome, drawn: Drawn, made: list[Assessment], row: LoopRow, stage: int) -> None:
    """Keep what was said after an event."""
    if stage == 0:
        out.events = sum(r.kind == drawn.event for r in made)
        out.row = _fields(row, row.__struct_fields__)
    out.last_row = _fields(row, row.__struct_fields__)
    out.flags = tuple(sorted({*out.flags, *row.flags}))
    out.reasons += f" [{stage}] {row.verdict}: {row.reason} {row.action}"
    out.records += [_fields(r, r.__struct_fields__) for r in made]
    for r in made:
        truth = drawn.rig.plant.gains.get(str(r.process))
        if drawn.kind.recording in {"fraction", "inverted"}:
            continue  # OP is another quantity
        if r.gain is None or r.gain_lo is None or r.gain_hi is None or truth is None:
            continue
        slopes = factors(drawn)
        lows, highs = [t * f for t in truth for f in slopes], [r.gain_lo, r.gain_hi]
        out.gains.append(bool(min(lows) <= max(highs) and min(highs) <= max(lows)))


def _try(out: Outcome, drawn: Drawn, rig: Rig, engine: Engine, stage: int, row: LoopRow) -> None:
    """Type the settings of now into the true loop, and tell the engine."""
    assert row.new_kp is not None
    ti = math.inf if row.new_ti is None else row.new_ti
    td, tf = row.new_td or 0.0, row.new_tf or 0.0
    law = replace(rig.law, kp=row.new_kp, ti=ti, td=td, tf=tf)
    new = {"kp": row.new_kp, "ti": ti, "td": td, "tf": tf}
    told = Told(stage, new, true_peak(drawn, law), grows(drawn, law), math.nan)
    told.ms_first = _first_stage(drawn, law, row.stages, told.ms_after)
    if not told.unstable:
        told.ci_after = indices(drawn, law)
    out.told.append(told)
    if told.unstable:
        return
    rig.type_in(law)
    drawn.law = law
    table = engine.loops[0]
    # as an operator's change arrives: the typed settings, in canonical units
    engine.retuned(0, changed(table, kp=row.new_kp, ti=ti, td=td, tf=tf if td else None))


def _cured(out: Outcome, which: int, rig: Rig) -> bool:
    if not out.told or not rig.plant.half_rule:
        return False
    told = out.told[which]
    known = [ci for ci in told.ci_after.values() if not math.isnan(ci)]  # a load leaves an offset to P alone
    good = bool(known) and min(known) >= CURED_CI
    return good and told.ms_after <= CURED_MS


def _fields(struct: Any, names: Any) -> dict[str, Any]:
    return {name: getattr(struct, name) for name in names}


def _first_stage(drawn: Drawn, law: Law, stages: str | None, same: float) -> float:
    """Return the Ms of the first stage, which `same` is where the stage is the law itself."""
    way = json.loads(stages or "[]")
    if not way:
        return same
    kp, tf = way[0]["kp"], way[0].get("tf") or 0.0
    ti = (kp / way[0]["ki"] if way[0]["ki"] else None) if "ki" in way[0] else way[0]["ti"]
    td = way[0]["kd"] / kp if "kd" in way[0] else way[0]["td"]
    first = replace(law, kp=kp, ti=math.inf if ti is None else ti, td=td or 0.0, tf=tf)
    return same if first == law else true_peak(drawn, first)
