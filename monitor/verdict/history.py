"""A loop's history: all that its events have shown, and what follows for its tuning."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from monitor.advise.candidates import rule_mismatch
from monitor.advise.evidence import NO_DOUBT
from monitor.advise.suggestion import Advice, Withheld, advise, renewed
from monitor.assess.event import Finding, model_fields
from monitor.assess.reference import model_of
from monitor.assess.tuning import current_sensitivity, judge
from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, LOAD, RETUNE, SETPOINT, UNDECIDED, LoopRow
from monitor.identify.fit import Fit, combine, contradictory

from .parts import Tuning, suggested

MOST_FINDINGS = 20
"""Findings kept for each loop: the newest ones make its verdict, and memory does not grow with history."""

_WAIT = "wait for, or make, a clean set-point step"


@dataclass(frozen=True, slots=True)
class _Standing:
    """A suggestion that stands, with the model that it rests on."""

    advice: Advice
    fit: Fit


@dataclass(slots=True)
class LoopHistory:
    """What is known of one loop beyond its running state."""

    findings: list[Finding] = field(default_factory=list)
    events: int = 0
    tuning: Tuning = field(default_factory=Tuning)
    """What the events say."""
    verdict: str | None = None
    """The loop's, its health included, as of its last event."""
    published: LoopRow | None = None
    """The suggestion that was published last, while it stands."""
    standing: _Standing | None = None
    retuned: int = 0
    """When the settings of today came into force [ns]; 0 where they were there from the start."""
    before: Tuning | None = None
    """The tuning as it was when the settings changed."""

    def add(self, finding: Finding, loop: Loop) -> Finding:
        """Add one event, and judge the loop anew; return the event, numbered."""
        self.events += 1
        numbered = msgspec.structs.replace(finding.record, event=self.events)
        finding = replace(finding, record=numbered)
        self.findings = [*self.findings, finding][-MOST_FINDINGS:]
        self.tuning, self.standing = _judge(loop, self)
        return finding

    def retune(self, loop: Loop, since: int) -> None:
        """Go over to new settings, in force from ``since`` [ns] on: the comparison of before and after begins."""
        if not self.events:
            return
        self.before, self.standing, self.published, self.retuned = self.tuning, None, None, since
        self.tuning, self.standing = _judge(loop, self)
        self.verdict = self.tuning.verdict

    @property
    def usable(self) -> list[Finding]:
        """Findings whose fit may carry a suggestion."""
        return [f for f in self.findings if f.usable]


def _judge(loop: Loop, history: LoopHistory) -> tuple[Tuning, _Standing | None]:
    """Judge a loop: the process by all its events, speed by those under the settings of today.

    Beside the tuning: the suggestion that stands from now on. One that the events can neither confirm nor deny stays.
    """
    today = [f for f in history.findings if f.record.start >= history.retuned]
    seen = [f for f in today if f.usable] or today
    ci = tuple(_median([f.record.ci for f in seen if f.record.kind == kind]) for kind in (SETPOINT, LOAD))
    tuning = Tuning(events=history.events, ci_setpoint=ci[0], ci_load=ci[1])
    usable = history.usable
    if not usable:
        last = history.findings[-1].record
        wait = f"none on this evidence; {_WAIT}"
        tuning = replace(tuning, verdict=INCONCLUSIVE, reason=last.reason, process=last.process, action=wait)
        return tuning, history.standing
    fits = [f.fit for f in usable if f.fit is not None]
    joint = _together(fits)
    if joint is None:
        why = "the events contradict each other in kind of process or sign of gain"
        return _contradiction(replace(tuning, process=UNDECIDED), why), history.standing
    tuning = replace(tuning, process=joint.process, model=model_fields(joint))
    if contradictory(fits, joint):
        why = "the events contradict each other: their gains differ beyond chance"
        return _contradiction(tuning, why), history.standing
    tuning = _of_model(loop, history, tuning, joint)
    if tuning.verdict != RETUNE:
        return replace(tuning, action="none" if tuning.verdict == GOOD else _WAIT), None
    tuning, standing = _advise(loop, history, tuning, joint)
    if tuning.verdict == RETUNE and (why := rule_mismatch(loop, joint.process)):
        tuning = replace(tuning, action=f"{tuning.action}; the rule {loop.rule} is not used: {why}")
    return tuning, standing


def _together(fits: list[Fit]) -> Fit | None:
    """All usable events in one model; None where they do not agree in kind of process and sign of gain."""
    alike = len({(f.process, math.copysign(1, f.gain)) for f in fits}) == 1
    return combine(fits) if alike else None


def _contradiction(tuning: Tuning, reason: str) -> Tuning:
    """Say that a loop's events do not agree."""
    action = "look at the events side by side: did the plant, the range or the valve change between them?"
    return replace(tuning, verdict=INCONCLUSIVE, reason=reason, action=action)


def _of_model(loop: Loop, history: LoopHistory, tuning: Tuning, joint: Fit) -> Tuning:
    """Add Ms of today's settings on the joint model, verdict and reason."""
    usable = history.usable
    alone = len(usable) == 1 and not history.retuned  # the event's own figure is the loop's
    model, period = model_of(joint), usable[-1].period
    ms = usable[0].record.ms if alone else current_sensitivity(loop, model, period)
    verdict, reason = judge(loop, model, (tuning.ci_setpoint, tuning.ci_load), ms, 0.0)
    if alone and verdict == usable[0].record.verdict:
        reason = usable[0].record.reason  # it knows the overshoot and how the event ended
    tuning = replace(tuning, ms=ms, verdict=verdict)
    if history.retuned:
        reason = "; ".join(filter(None, [_since_retune(history.before, tuning), reason]))
    return replace(tuning, reason=reason)


def _advise(loop: Loop, history: LoopHistory, tuning: Tuning, joint: Fit) -> tuple[Tuning, _Standing | None]:
    """Add a suggestion; the old one is kept while the model stays inside its intervals, and it safe."""
    noise, period = float(np.median([f.noise for f in history.usable])), history.usable[-1].period
    old = history.standing
    if old is not None and _inside(joint, old.fit):
        still = renewed(old.advice, loop, joint, noise, period, NO_DOUBT)
        if still is not None:
            return _with(tuning, loop, still), old
    advice = advise(loop, joint, noise, period, tuning.ms, NO_DOUBT)
    if not isinstance(advice, Withheld):
        return _with(tuning, loop, advice), _Standing(advice, joint)
    if advice.fine_as_it_is:
        return replace(tuning, verdict=GOOD, reason=advice.reason, action="none"), None
    reason = f"{tuning.reason}; no suggestion: {advice.reason}"
    action = "retune by hand with care, or make a larger set-point step for a sharper model"
    return replace(tuning, reason=reason, action=action), None


def _with(tuning: Tuning, loop: Loop, advice: Advice) -> Tuning:
    new = suggested(loop, advice)
    return replace(tuning, suggested=new, action=new.action)


def _inside(fit: Fit, old: Fit) -> bool:
    """Whether a model lies inside the intervals of an older one."""
    if fit.process != old.process:
        return False
    return all(
        low <= float(getattr(fit, name)) <= high
        for name, (low, high) in ((n, old.interval(n)) for n in ("gain", "dead_time", "lag"))
    )


def _since_retune(before: Tuning | None, now: Tuning) -> str:
    """Compare before and after a change of settings, once there is an event to compare."""
    if before is None:
        return ""
    pairs = [
        ("CI_sp", before.ci_setpoint, now.ci_setpoint),
        ("CI_ld", before.ci_load, now.ci_load),
        ("Ms", before.ms, now.ms),
    ]
    told = [f"{name} {a:.2f} -> {b:.2f}" for name, a, b in pairs if a is not None and b is not None]
    return "since the settings changed: " + ", ".join(told) if told else "no event yet under the new settings"


def _median(values: list[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.median(known)) if known else None
