"""A loop's case: all that its events have shown, and the row that follows from them and from its health."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from monitor.advise.candidates import unfit
from monitor.advise.suggestion import Advice, Withheld, advise, renewed
from monitor.assess.event import Finding, model_fields
from monitor.assess.reference import LOAD, SETPOINT, model_of
from monitor.assess.tuning import current_sensitivity, judge
from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE, LoopRow
from monitor.identify.fit import Fit, combine, contradictory

from .row import inconclusive, with_settings, withhold

KEPT = 20
"""Findings kept for each loop: the newest ones make its verdict, and memory does not grow with history."""


@dataclass(frozen=True, slots=True)
class _Kept:
    """A suggestion that stands, with the model that it rests on."""

    advice: Advice
    fit: Fit


@dataclass(slots=True)
class Case:
    """What is known of one loop beyond its running state."""

    findings: list[Finding] = field(default_factory=list)
    events: int = 0
    row: LoopRow | None = None
    """What the events say of the tuning."""
    verdict: str | None = None
    """The loop's, its health included, as of its last event."""
    said: LoopRow | None = None
    """The suggestion that was published last, while it stands."""
    advice: _Kept | None = None
    retuned: int = 0
    """When the settings of today came into force [ns]; 0 where they were there from the start."""
    before: LoopRow | None = None
    """The row as it stood when the settings changed."""

    def take(self, finding: Finding, loop: Loop) -> Finding:
        """Add one event, numbered, and judge the loop anew."""
        self.events += 1
        numbered = msgspec.structs.replace(finding.record, event=self.events)
        finding = replace(finding, record=numbered)
        self.findings = [*self.findings, finding][-KEPT:]
        self.row = _judge(loop, self)
        return finding

    def retune(self, loop: Loop, since: int) -> None:
        """Go over to new settings, in force from ``since`` [ns] on: the comparison of before and after begins."""
        if self.row is None:
            return
        self.before, self.advice, self.said, self.retuned = self.row, None, None, since
        self.row = _judge(loop, self)
        self.verdict = self.row.verdict

    @property
    def usable(self) -> list[Finding]:
        """Findings whose fit may carry a suggestion."""
        return [f for f in self.findings if f.usable]


def _judge(loop: Loop, case: Case) -> LoopRow:
    """Judge a loop: the process by all its events, speed by those under the settings of today."""
    row = LoopRow(loop=loop.name, events=case.events)
    today = [f for f in case.findings if f.record.start >= case.retuned]
    seen = [f for f in today if f.usable] or today
    row.ci_setpoint, row.ci_load = (
        _median([f.record.ci for f in seen if f.record.kind == kind]) for kind in (SETPOINT, LOAD)
    )
    usable = case.usable
    if not usable:
        last = case.findings[-1].record
        row.verdict, row.reason, row.process = INCONCLUSIVE, last.reason, last.process
        row.action = "none on this evidence; wait for, or make, a clean set-point step"
        return row
    fits = [f.fit for f in usable if f.fit is not None]
    joint = _together(fits)
    if joint is None:
        row.process = "undecided"
        return inconclusive(row, "the events contradict each other in kind of process or sign of gain")
    row.process = joint.process
    for name, value in model_fields(joint).items():
        setattr(row, name, value)
    if contradictory(fits, joint):
        return inconclusive(row, "the events contradict each other: their gains differ beyond chance")
    model, period = model_of(joint), usable[-1].period
    alone = len(usable) == 1 and not case.retuned  # the event's own figure is the loop's
    row.ms = usable[0].record.ms if alone else current_sensitivity(loop, model, period)
    row.verdict, row.reason = judge(loop, model, (row.ci_setpoint, row.ci_load), row.ms, 0.0)
    if alone and row.verdict == usable[0].record.verdict:
        row.reason = usable[0].record.reason  # it knows the overshoot and how the event ended
    if case.retuned:
        row.reason = "; ".join(filter(None, [_since_retune(case, row), row.reason]))
    if row.verdict != RETUNE:
        row.action = "none" if row.verdict == GOOD else "wait for, or make, a clean set-point step"
        case.advice = None
        return row
    row = _advise(loop, case, row, joint, period)
    if row.verdict == RETUNE and (why := unfit(loop, joint.process)):
        row.action += f"; the rule {loop.rule} is not used: {why}"
    return row


def _together(fits: list[Fit]) -> Fit | None:
    """All usable events in one model; None where they do not agree in kind of process and sign of gain."""
    alike = len({(f.process, math.copysign(1, f.gain)) for f in fits}) == 1
    return combine(fits) if alike else None


def _advise(loop: Loop, case: Case, row: LoopRow, joint: Fit, period: float) -> LoopRow:
    """Write a suggestion into the row; the old one is kept while the model stays inside its intervals, and it safe."""
    noise = float(np.median([f.noise for f in case.usable]))
    kept = case.advice
    if kept is not None and _inside(joint, kept.fit):
        still = renewed(kept.advice, loop, joint, noise, period)
        if still is not None:
            return with_settings(row, loop, still)
    advice = advise(loop, joint, noise, period, row.ms)
    if isinstance(advice, Withheld):
        case.advice = None
        return withhold(row, advice)
    case.advice = _Kept(advice, joint)
    return with_settings(row, loop, advice)


def _inside(fit: Fit, old: Fit) -> bool:
    """Whether a model lies inside the intervals of an older one."""
    if fit.process != old.process:
        return False
    return all(
        low <= float(getattr(fit, name)) <= high
        for name, (low, high) in ((n, old.interval(n)) for n in ("gain", "dead_time", "lag"))
    )


def _since_retune(case: Case, row: LoopRow) -> str:
    """Compare before and after a change of settings, once there is an event to compare."""
    if case.before is None:
        return ""
    pairs = [
        (name, getattr(case.before, field_), getattr(row, field_))
        for name, field_ in (("CI_sp", "ci_setpoint"), ("CI_ld", "ci_load"), ("Ms", "ms"))
    ]
    told = [f"{name} {a:.2f} -> {b:.2f}" for name, a, b in pairs if a is not None and b is not None]
    return "since the settings changed: " + ", ".join(told) if told else "no event yet under the new settings"


def _median(values: list[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.median(known)) if known else None
