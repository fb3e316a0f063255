"""A loop's history: all that its events have shown, and what follows for its tuning."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec

from monitor.advise.candidates import rule_mismatch
from monitor.advise.evidence import Evidence
from monitor.advise.suggestion import Advice, Withheld, advise, renewed
from monitor.assess.disturbance import many_in_words
from monitor.assess.event import Finding, model_fields
from monitor.assess.predicted import NO_INDICES
from monitor.assess.reference import model_of, settings_of
from monitor.assess.tuning import current_sensitivity, indices_to_come, judge
from monitor.by_size import median
from monitor.contract.loops import Loop
from monitor.contract.records import (
    GOOD,
    INCONCLUSIVE,
    LOAD,
    RETUNE,
    SETPOINT,
    UNDECIDED,
    Assessment,
    LoopRow,
    Plan,
)
from monitor.detect.event import EventWindow
from monitor.identify.fit import Fit, combine, same_process
from monitor.identify.misfit import ModelError, together
from tuners.models import Model

from .in_force import InForce, change_in_words
from .joint import joint_of, narrow_together
from .parts import Tuning, suggested
from .plan import at_aim, part_of, plan_of
from .speed import falls_short, indices, kindest

MOST_FINDINGS = 20
"""Findings kept for each loop: the newest ones make its verdict, and memory does not grow with history."""

MISFIT_EVENTS, ALIKE_SWING_SHARE = 8, 0.5
"""Newest events whose model errors are compared, and share of PV's largest swing in them that an event must have."""
SHRUNK_SHARE = 0.8
"""Share of the model's error when a small step was last taken in spite of it, below which another one may be."""

_WAIT = "wait for, or make, a clean set-point step"
_HALF_WAY = "a part of the retune is in force"
_GO_ON = "make a set-point step or wait for a load; the next part follows when it has confirmed the model"
_ON_THE_WAY = "a part of the retune is in force; its aim is not reached"
_NOT_YET = "the retune is in force, and the events since allow more"


@dataclass(frozen=True, slots=True)
class Standing:
    """A suggestion that stands, with the model that it rests on."""

    advice: Advice
    fit: Fit


@dataclass(slots=True)
class LoopHistory:
    """What is known of one loop beyond its running state."""

    in_force: InForce
    """Its settings of today."""
    findings: list[Finding] = field(default_factory=list)
    events: int = 0
    """Set-point and load steps."""
    disturbances: int = 0
    largest: Assessment | None = None
    """Of the disturbances."""
    tuning: Tuning = field(default_factory=Tuning)
    """What the events say."""
    verdict: str | None = None
    """The loop's, its health included, as of its last event."""
    published: LoopRow | None = None
    """The suggestion that was published last, while it stands."""
    standing: Standing | None = None
    retuned: int = 0
    """When the settings of today came into force [ns]; 0 where they were there from the start."""
    before: Tuning | None = None
    """The tuning as it was when the settings changed."""
    plan: Plan | None = None
    """Where the suggestion leads, or the retune of which a part is in force."""

    @property
    def under_way(self) -> bool:
        """Whether a retune is in force, in part or as a whole, that no event has shown to be enough."""
        return self.plan is not None and self.plan.since is not None

    @property
    def part_in_force(self) -> bool:
        """Whether a part of a retune is in force, with more to come."""
        return self.plan is not None and self.under_way and not at_aim(self.plan, settings_of(self.loop))

    @property
    def loop(self) -> Loop:
        """The loop's row, with the settings in force."""
        return self.in_force.loop

    def look(self, window: EventWindow, start: int, end: int, period: float) -> None:
        """Look at the controller in some samples, from ``start`` to ``end`` [ns], of this period [s]."""
        known = self.in_force.source, self.in_force.contradiction
        if self.in_force.look(window, start, end, period):
            self.retune(start)
        elif self.events and known != (self.in_force.source, self.in_force.contradiction):
            self.tuning, self.standing = _judge(self)

    def add(self, finding: Finding) -> Finding:
        """Add one event, and judge the loop anew; return the event, numbered."""
        self.events += 1
        numbered = msgspec.structs.replace(finding.record, event=self.events + self.disturbances)
        finding = replace(finding, record=numbered)
        self.findings = [*self.findings, finding][-MOST_FINDINGS:]
        self.tuning, self.standing = _judge(self)
        return finding

    def add_disturbance(self, record: Assessment) -> Assessment:
        """Add an upset that is no clean step; return it, numbered. It changes no verdict and no suggestion."""
        self.disturbances += 1
        record = msgspec.structs.replace(record, event=self.events + self.disturbances)
        if self.largest is None or abs(record.amplitude) > abs(self.largest.amplitude):
            self.largest = record
        self.tuning = replace(self.tuning, **self.upsets())
        return record

    def upsets(self) -> dict[str, Any]:
        """Return the parts of a tuning that tell of the disturbances."""
        if self.largest is None:
            return {}
        return {"disturbances": self.disturbances, "upsets": many_in_words(self.disturbances, self.largest)}

    @property
    def model(self) -> Model | None:
        """The process as the events show it; None where they show none."""
        joint = joint_of(self.usable)[0] if self.usable else None
        return None if joint is None else model_of(joint)

    def retune(self, since: int, table: Loop | None = None) -> None:
        """Go over to new settings, in force from ``since`` [ns] on: the comparison of before and after begins.

        Parameters
        ----------
        table
            The loop's row, where somebody has said so; else the settings are those seen in the data.
        """
        if table is not None:
            self.in_force = InForce(table, since=since, extra_delay=self.in_force.extra_delay)
        if self.plan is not None:
            part = part_of(self.plan, settings_of(self.loop))
            self.plan = msgspec.structs.replace(self.plan, since=since) if part else None
        self.before, self.standing, self.published, self.retuned = self.tuning, None, None, since
        if self.events:
            self.tuning, self.standing = _judge(self)
            self.verdict = self.tuning.verdict

    @property
    def usable(self) -> list[Finding]:
        """Findings whose fit may carry a suggestion: by itself, or beside others."""
        wide = [f for f in self.findings if f.wide]
        beside = any(f.usable for f in self.findings) or narrow_together(wide)
        return [f for f in self.findings if f.usable or (f.wide and beside)]

    def evidence(self, joint: Fit) -> Evidence:
        """Return what the events leave open beside the model that they agree on."""
        misfit = self._misfit()
        softened = None if self.plan is None or not self.under_way else self.plan.softened
        size = 0.0 if misfit is None else misfit.size
        # one that does not know its gain says nothing of the kind, as in `joint_of`
        sure = [f for f in self.usable if f.usable] or self.usable
        others = [f.fit for f in sure if f.fit is not None and f.fit.process != joint.process]
        loads = all(f.record.kind == LOAD for f in self.usable)
        return Evidence(
            rivals=(*(r for r in self._telling(sure).rivals if r.process != joint.process), *others[-1:]),
            misfit=misfit,
            loads_only=loads and not self._confirmed(joint),
            soft_step=softened is None or size < SHRUNK_SHARE * softened,
        )

    def _telling(self, sure: list[Finding]) -> Finding:
        """Return the event that tells most of the kind of process: of the last ones the one that stands out most.

        What a large step excludes, a small one that excludes nothing does not bring back.
        """
        looked_at = [f for f in sure[-MISFIT_EVENTS:] if f.misfit is not None]
        return max(
            looked_at, key=lambda f: f.swing / f.noise if f.noise > 0.0 else math.inf, default=sure[-1]
        )

    def _misfit(self) -> ModelError | None:
        """Return the error of the model that the events under the settings of today show.

        One of the model shows in every event that excites the loop as much; what shows in some of them only came from
        elsewhere.
        """
        today = [f for f in self.usable if f.record.start >= self.retuned] or self.usable[-1:]
        shown = [(f.swing, f.misfit) for f in today[-MISFIT_EVENTS:] if f.misfit is not None]
        strongest = max((swing for swing, _ in shown), default=0.0)
        alike = [misfit for swing, misfit in shown if swing >= ALIKE_SWING_SHARE * strongest]
        return together(alike) if alike else None

    def _confirmed(self, joint: Fit) -> bool:
        """Whether events under the settings of today and under those before show the same process.

        The shape of a load and an error of the model are not told apart by load steps alone, but what they do to a
        model depends on the controller: it is another model under other settings (derived).
        """
        fits: tuple[list[Fit], list[Fit]] = [], []
        for finding in self.usable:
            if finding.fit is not None and finding.fit.process == joint.process:
                fits[finding.record.start >= self.retuned].append(finding.fit)
        return all(fits) and same_process(combine(fits[0]), combine(fits[1]))


def _judge(history: LoopHistory) -> tuple[Tuning, Standing | None]:
    """Judge a loop: the process by all its events, speed by those under the settings of today.

    Beside the tuning: the suggestion that stands from now on. One that the events can neither confirm nor deny stays.
    """
    loop, usable = history.loop, history.usable
    today = [f for f in history.findings if f.record.start >= history.retuned]
    seen = [f for f in today if f.usable] or today
    ci = tuple(_median([f.record.ci for f in seen if f.record.kind == kind]) for kind in (SETPOINT, LOAD))
    contradiction = history.in_force.contradiction
    tuning = Tuning(events=history.events, ci_setpoint=ci[0], ci_load=ci[1], contradiction=contradiction)
    tuning = replace(tuning, **history.upsets(), ramps=_ramps(today))
    if not usable:
        last = history.findings[-1].record
        wait = f"none on this evidence; {_WAIT}"
        tuning = replace(tuning, verdict=INCONCLUSIVE, reason=last.reason, process=last.process, action=wait)
        return tuning, history.standing
    joint, why = joint_of(usable)
    newer = [f for f in usable if f.record.start >= history.retuned]
    if why and history.retuned and any(f.record.kind == SETPOINT for f in newer):
        # a set-point step since the last change corrects what was known before; loads may be of another shape each
        joint, why = joint_of(newer)
    if joint is not None:
        tuning = replace(tuning, process=joint.process, model=model_fields(joint))
    if joint is None or why:
        return _contradiction(tuning if joint else replace(tuning, process=UNDECIDED), why), history.standing
    joint = replace(joint, extra_delay=history.in_force.extra_delay)
    measured = indices(loop, joint, seen)
    tuning = _of_model(history, replace(tuning, ci_setpoint=measured[0], ci_load=measured[1]), joint)
    if contradiction:
        return tuning, None
    if history.part_in_force and not newer:
        since = f", and no event usable since: {today[-1].record.reason}" if today else "; no event yet"
        return replace(tuning, verdict=INCONCLUSIVE, reason=_HALF_WAY + since, action=_GO_ON), None
    short = _more_to_come(history, joint) if newer else ""
    if tuning.verdict != RETUNE and not short:
        history.plan = history.plan if history.under_way and tuning.verdict != GOOD else None
        return replace(tuning, action="none" if tuning.verdict == GOOD else _WAIT), None
    tuning, standing = _advise(history, tuning, joint, short)
    if tuning.verdict == RETUNE and (why := rule_mismatch(loop, joint.process)):
        tuning = replace(tuning, action=f"{tuning.action}; the rule {loop.rule} is not used: {why}")
    return tuning, standing


def _ramps(findings: list[Finding]) -> tuple[int, int]:
    """Return how many moves of the set point were ramps, and how many there were."""
    moves = [f for f in findings if f.record.kind == SETPOINT]
    return sum(not f.stepped for f in moves), len(moves)


def _contradiction(tuning: Tuning, reason: str) -> Tuning:
    """Say that a loop's events do not agree."""
    action = "look at the events side by side: did the plant, the range or the valve change between them?"
    return replace(tuning, verdict=INCONCLUSIVE, reason=reason, action=action)


def _of_model(history: LoopHistory, tuning: Tuning, joint: Fit) -> Tuning:
    """Add Ms of today's settings on the joint model, verdict and reason."""
    loop, usable = history.loop, history.usable
    alone = len(usable) == 1 and not history.retuned  # the event's own figure is the loop's
    model, period = model_of(joint), usable[-1].period
    ms = usable[0].record.ms if alone else current_sensitivity(loop, model, period)
    if history.in_force.contradiction:
        ms = None
    ci = tuning.ci_setpoint, tuning.ci_load
    today = [f for f in usable if f.record.start >= history.retuned]
    foreseen = any(f.at_limit or f.predicted != NO_INDICES for f in today)
    speaks = foreseen or any(value is not None for value in ci)
    predicted = indices_to_come(loop, model, ci, ms, period) if speaks and not alone else NO_INDICES
    predicted = usable[0].predicted if alone else predicted
    predicted = kindest(loop, predicted, ci, usable[-1].rivals, period)
    damped = [f.damped for f in today if f.damped is not None]
    verdict, reason = judge(loop, model, ci, ms, 0.0, predicted, all(damped) if damped else None)
    if verdict == INCONCLUSIVE and today and today[-1].record.verdict == INCONCLUSIVE:
        reason = today[-1].record.reason  # it knows what kept its index back
    if alone and verdict == usable[0].record.verdict:
        reason = usable[0].record.reason  # it knows the overshoot and how the event ended
    tuning = replace(tuning, ms=ms, verdict=verdict)
    if history.retuned:
        told = [_change(history), _since_retune(history.before, tuning), reason]
        reason = "; ".join(filter(None, told))
    return replace(tuning, reason=reason)


def _more_to_come(history: LoopHistory, joint: Fit) -> str:
    """Say why a retune under way goes on, whatever the index of its events; empty where it does not."""
    if history.part_in_force:
        return _ON_THE_WAY
    short = falls_short(history.loop, joint, history.usable[-1].period) if history.under_way else ""
    return f"{_NOT_YET}: {short}" if short else ""


def _advise(history: LoopHistory, tuning: Tuning, joint: Fit, short: str) -> tuple[Tuning, Standing | None]:
    """Add a suggestion; the old one is kept while the model stays inside its intervals, and it safe.

    ``short`` says why a loop whose events ask for none is given one.
    """
    loop, evidence = history.loop, history.evidence(joint)
    if tuning.verdict != RETUNE:  # a step in spite of the model's error is for a loop in need
        evidence = replace(evidence, soft_step=False)
    noise, period = median([f.noise for f in history.usable]), history.usable[-1].period
    old = history.standing
    if old is not None and _inside(joint, old.fit):
        still = renewed(old.advice, loop, joint, noise, period, evidence)
        if still is not None:
            history.plan = plan_of(loop, still, history.plan, evidence)
            return _with(history, tuning, still, short), old
    advice = advise(loop, joint, noise, period, tuning.ms, evidence)
    if not isinstance(advice, Withheld):
        history.plan = plan_of(loop, advice, history.plan, evidence)
        return _with(history, tuning, advice, short), Standing(advice, joint)
    if advice.fine_as_it_is:
        history.plan = None
        return replace(tuning, verdict=GOOD, reason=advice.reason, action="none"), None
    if tuning.verdict != RETUNE:  # on the way to an aim that the events do not allow any more
        return replace(tuning, action="none" if tuning.verdict == GOOD else _WAIT), None
    reason = f"{tuning.reason}; no suggestion: {advice.reason}"
    action = "retune by hand with care, or make a larger set-point step for a sharper model"
    return replace(tuning, reason=reason, action=action), None


def _with(history: LoopHistory, tuning: Tuning, advice: Advice, short: str) -> Tuning:
    """Add a suggestion; on the way to an aim it is one even where the loop is good enough already."""
    new = suggested(history.loop, advice)
    reason = tuning.reason if tuning.verdict == RETUNE else "; ".join(filter(None, [tuning.reason, short]))
    return replace(tuning, verdict=RETUNE, reason=reason, suggested=new, action=new.action)


def _change(history: LoopHistory) -> str:
    """Say what the data show of a change of settings that nobody has told of."""
    change = history.in_force.change
    return "" if change is None or change.before != history.retuned else change_in_words(change)


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
    return median(known) if known else None
