"""The engine: samples in, records out. Owns all state; knows no clock, no file, no socket.

Live service and audit drive the same engine, and the same samples give the same records however they are
batched: detection works sample by sample, and a loop's assessment rests on that loop's events alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from tuners.blocks import BLOCKS

from .advise import Advice, Withheld, advise
from .assess import Finding, assess_event, model_fields
from .detect import Detector
from .health import figures
from .identify import Array, Fit, combine, contradictory, model_response
from .judge import current_sensitivity, judge
from .loops import FORMS, Loop, LoopTable
from .records import (
    GOOD,
    INCONCLUSIVE,
    RETUNE,
    Assessment,
    Event,
    LoopRow,
    Record,
    Suggestion,
    Window,
    event_id,
)
from .reference import LOAD, SETPOINT, model_of
from .rows import inconclusive, with_settings, withhold, worst_first
from .samples import Samples
from .state import BY_SETTINGS, CLOSED, COUNTS, LOAD_STEP, STATES
from .verdict import conclude

KEPT = 20
"""Findings kept for each loop: the newest ones make its verdict, and memory does not grow with history."""


@dataclass(frozen=True, slots=True)
class _Kept:
    """A suggestion that stands, with the model that it rests on."""

    advice: Advice
    fit: Fit


@dataclass(slots=True)
class _Case:
    """What is known of one loop beyond its running state."""

    findings: list[Finding] = field(default_factory=list)
    events: int = 0
    row: LoopRow | None = None
    advice: _Kept | None = None
    retuned: int = 0
    """When the settings of today came into force [ns]; 0 where they were there from the start."""
    before: LoopRow | None = None
    """The row as it stood when the settings changed."""


class Engine:
    """Watches the loops of a table.

    Parameters
    ----------
    loops
        Read, and extended by `add`; not copied.
    """

    def __init__(self, loops: LoopTable) -> None:
        self.loops = loops
        self.detector = Detector(list(loops))
        self._cases: dict[int, _Case] = {}
        self._pending: list[tuple[Any, Array]] = []
        self.disturbances = 0
        """Suspected load steps that no step explains."""

    def add(self, loop: Loop) -> int:
        """Watch one more loop; return its row.

        Raises
        ------
        ValueError
            Its name or key is taken.
        """
        row = self.loops.add(loop)
        self.follow()
        return row

    def follow(self) -> None:
        """Watch what was added to the loop table: a thousand loops at once cost as much as one."""
        known = len(self.detector.state)
        if known < len(self.loops):
            self.detector.add(self.loops.loops[known:])

    def retuned(self, row: int, loop: Loop) -> list[Record]:
        """Take over a loop's new settings: they close the suggestion, and start the comparison of before and after.

        An open event is closed first, and judged by the settings under which it ran. The process that past
        events showed stays known; their indices no longer speak for the loop.
        """
        records = self._take(self.detector.flush([row], BY_SETTINGS))
        own = [(e, w) for e, w in self._pending if e["loop"] == row]
        self._pending = [(e, w) for e, w in self._pending if e["loop"] != row]
        records += [record for event, window in own for record in self._assess(event, window)]
        self.loops.replace(row, loop)
        case = self._cases.get(row)
        if case is None or case.row is None:
            return records
        case.before, case.advice = case.row, None
        case.retuned = int(self.detector.state["time"][row]) + 1
        case.row = self._judge(self.loops[row], case)
        return records

    # -- samples in, records out ------------------------------------------------------------------

    def step(self, samples: Samples) -> list[Record]:
        """Take in samples (each loop's times increasing) and assess every event that they close."""
        return self.detect(samples) + self.assess()

    def detect(self, samples: Samples) -> list[Record]:
        """Take in samples; return openings and closings. Assessments wait for `assess`."""
        return self._take(self.detector.run(samples))

    def assess(self, most: int | None = None) -> list[Record]:
        """Assess waiting events, oldest first, at most ``most`` of them."""
        n = len(self._pending) if most is None else min(most, len(self._pending))
        now, self._pending = self._pending[:n], self._pending[n:]
        return [record for event, window in now for record in self._assess(event, window)]

    @property
    def backlog(self) -> int:
        """Events that wait for `assess`."""
        return len(self._pending)

    def close(self) -> list[Record]:
        """Close what is open, because the data end here; assessments wait for `assess`."""
        return self._take(self.detector.flush())

    def flush(self) -> list[Record]:
        """Close what is open, because the data end here, and assess it."""
        return self.close() + self.assess()

    def _take(self, found: list[tuple[Any, Array]]) -> list[Record]:
        """Report openings and closings; a suspected load step is reported when it has proved to be one."""
        records: list[Record] = []
        for event, window in found:
            closed = event["what"] == CLOSED
            if event["kind"] != LOAD_STEP:
                onset = int(event["onset"])
                loop = self.loops[int(event["loop"])].name
                state = STATES[event["state"]] if closed else "open"
                end = int(event["end"]) if closed else None
                step = float(event["amplitude"])
                identity = event_id(loop, onset)
                records.append(
                    Event(
                        id=identity,
                        loop=loop,
                        kind=SETPOINT,
                        state=state,
                        start=onset,
                        end=end,
                        amplitude=step,
                    )
                )
            if closed:
                self._pending.append((event, window))
        return records

    def _assess(self, event: Any, window: Array) -> list[Record]:
        row = int(event["loop"])
        loop = self.loops[row]
        finding = assess_event(loop, canonical_form(loop), event, window)
        if not finding.is_event:
            self.disturbances += 1
            return []
        case = self._cases.setdefault(row, _Case())
        case.events += 1
        found = msgspec.structs.replace(finding.record, event=case.events)
        case.findings = [*case.findings, replace(finding, record=found)][-KEPT:]
        records: list[Record] = [] if found.kind == SETPOINT else [_closing(found)]
        records += [found, _window(event, window, finding)]
        before = case.row
        case.row = self._judge(loop, case)
        if case.row.new_kp is not None and (before is None or _changed(before, case.row)):
            evidence = tuple(f.record.id for f in case.findings if f.usable)
            records.append(Suggestion(row=self.row(row), evidence=evidence))
        return records

    # -- the loop as it stands --------------------------------------------------------------------

    def _judge(self, loop: Loop, case: _Case) -> LoopRow:
        """Judge a loop: the process by all its events, speed by those under the settings of today."""
        row = LoopRow(loop=loop.name, events=case.events)
        today = [f for f in case.findings if f.record.start >= case.retuned]
        seen = [f for f in today if f.usable] or today
        row.ci_setpoint, row.ci_load = (
            _median([f.record.ci for f in seen if f.record.kind == kind]) for kind in (SETPOINT, LOAD)
        )
        usable = [f for f in case.findings if f.usable and f.fit is not None]
        if not usable:
            last = case.findings[-1].record
            row.verdict, row.reason, row.process = INCONCLUSIVE, last.reason, last.process
            row.action = "none on this evidence; wait for, or make, a clean set-point step"
            return row
        fits = [f.fit for f in usable if f.fit is not None]
        if len({f.process for f in fits}) > 1 or len({math.copysign(1, f.gain) for f in fits}) > 1:
            row.process = "undecided"
            return inconclusive(row, "the events contradict each other in kind of process or sign of gain")
        joint = combine(fits)
        row.process = joint.process
        for name, value in model_fields(joint).items():
            setattr(row, name, value)
        if contradictory(fits, joint):
            return inconclusive(row, "the events contradict each other: their gains differ beyond chance")
        form, model, period = canonical_form(loop), model_of(joint), usable[-1].period
        alone = len(usable) == 1 and not case.retuned  # the event's own figure is the loop's
        row.ms = usable[0].record.ms if alone else current_sensitivity(loop, form, model, period)
        row.verdict, row.reason = judge(loop, form, model, (row.ci_setpoint, row.ci_load), row.ms, 0.0)
        if alone and row.verdict == usable[0].record.verdict:
            row.reason = usable[0].record.reason  # it knows the overshoot and how the event ended
        if case.retuned:
            row.reason = "; ".join(filter(None, [_since_retune(case, row), row.reason]))
        if row.verdict != RETUNE:
            row.action = "none" if row.verdict == GOOD else "wait for, or make, a clean set-point step"
            case.advice = None
            return row
        return self._advise(loop, case, row, joint, period)

    def _advise(self, loop: Loop, case: _Case, row: LoopRow, joint: Fit, period: float) -> LoopRow:
        """Write a suggestion into the row; the old one is kept while the model stays inside its intervals."""
        form = canonical_form(loop)
        noise = float(np.median([f.noise for f in case.findings if f.usable]))
        kept = case.advice
        if kept is None or not _inside(joint, kept.fit):
            advice = advise(loop, form, joint, noise, period, row.ms)
            if isinstance(advice, Withheld):
                case.advice = None
                return withhold(row, advice)
            kept = case.advice = _Kept(advice, joint)
        return with_settings(row, loop, form, kept.advice)

    def row(self, row: int) -> LoopRow:
        """Return a loop's current row: its verdict, and its health so far."""
        loop = self.loops[row]
        case = self._cases.get(row)
        out = (
            LoopRow(loop=loop.name) if case is None or case.row is None else msgspec.structs.replace(case.row)
        )
        if loop.kp is not None:
            out.kp, out.ti, out.td, out.tf = loop.kp, loop.ti, loop.td, loop.filter_time
        return conclude(out, figures(self.detector.health[row], self.detector.state[row]))

    def rows(self) -> list[LoopRow]:
        """Return one row for each loop, worst first: by verdict, then by index, then by name."""
        rows = [self.row(k) for k in range(len(self.loops))]
        return sorted(rows, key=worst_first)

    def verdict(self, row: int) -> str | None:
        """Return a loop's verdict so far, None where nothing was assessed."""
        case = self._cases.get(row)
        return None if case is None or case.row is None else case.row.verdict

    def is_open(self, row: int) -> bool:
        """Whether an event of this loop is open."""
        return bool(self.detector.state["slot"][row] >= 0)

    def counts(self) -> dict[str, int]:
        """Return what became of all samples, by cause."""
        return {name: int(self.detector.state[name].sum()) for name in COUNTS}


def canonical_form(loop: Loop) -> str:
    """Return the form that the loop's block computes."""
    return loop.form if loop.form in FORMS else BLOCKS[loop.form].form


def _closing(record: Assessment) -> Event:
    """Return the event of a load step that has proved to be one."""
    return Event(
        id=record.id,
        loop=record.loop,
        kind=record.kind,
        state=record.state,
        start=record.start,
        end=record.end,
        amplitude=record.amplitude,
    )


def _changed(old: LoopRow, new: LoopRow) -> bool:
    """Whether a suggestion says something new."""
    names = ("verdict", "rule", "new_kp", "new_ti", "new_td", "new_tf")
    return any(getattr(old, name) != getattr(new, name) for name in names)


def _inside(fit: Fit, old: Fit) -> bool:
    """Whether a model lies inside the intervals of an older one."""
    if fit.process != old.process:
        return False
    return all(
        low <= float(getattr(fit, name)) <= high
        for name, (low, high) in ((n, old.interval(n)) for n in ("gain", "dead_time", "lag"))
    )


def _since_retune(case: _Case, row: LoopRow) -> str:
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


def _window(event: Any, window: Array, finding: Finding) -> Window:
    onset = int(event["onset"])
    model = np.full(len(window), np.nan)
    if finding.fit is not None:
        model = model_response(window, int(event["before"]), finding.fit)
    return Window(
        id=finding.record.id,
        loop=finding.record.loop,
        onset=onset,
        time=onset + np.round(window[:, 0] * 1e9).astype(np.int64),
        sp=window[:, 1],
        pv=window[:, 2],
        op=window[:, 3],
        model=model,
    )
