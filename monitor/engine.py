"""The engine: samples in, records out. Owns all state; knows no clock, no file, no socket.

Live service and audit drive the same engine, and the same samples give the same records however they are
batched: detection works sample by sample, and a loop's assessment rests on that loop's events alone.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from tuners.blocks import BLOCKS
from tuners.settings import Settings

from .advise import Advice, Withheld, advise
from .assess import Finding, assess_event, current_sensitivity, judge, model_fields
from .detect import Detector
from .identify import Array, combine, contradictory, model_response
from .kernel import CLOSED, COUNTS, LOAD_STEP, STATES
from .loops import FORMS, Loop, LoopTable
from .records import (
    GOOD,
    INCONCLUSIVE,
    RETUNE,
    WORST_FIRST,
    Assessment,
    Event,
    LoopRow,
    Record,
    Suggestion,
    Window,
    event_id,
)
from .reference import LOAD, SETPOINT, model_of
from .samples import Samples

KEPT = 20
"""Findings kept for each loop: the newest ones make its verdict, and memory does not grow with history."""


@dataclass(slots=True)
class _Case:
    """What is known of one loop beyond its running state."""

    findings: list[Finding] = field(default_factory=list)
    events: int = 0
    row: LoopRow | None = None
    advice: Advice | None = None


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
        self.detector.add([loop])
        return row

    def retuned(self, row: int, loop: Loop) -> None:
        """Take over a loop's new settings: its past events no longer speak for it."""
        self.loops.replace(row, loop)
        self._cases.pop(row, None)

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

    def flush(self) -> list[Record]:
        """Close what is open, because the data end here, and assess it."""
        return self._take(self.detector.flush()) + self.assess()

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
        case.row, case.advice = self._judge(loop, case)
        if case.advice is not None and (before is None or _changed(before, case.row)):
            evidence = tuple(f.record.id for f in case.findings if f.usable)
            records.append(Suggestion(row=self.row(row), evidence=evidence))
        return records

    # -- the loop as it stands --------------------------------------------------------------------

    def _judge(self, loop: Loop, case: _Case) -> tuple[LoopRow, Advice | None]:
        """Judge a loop by all its events together."""
        row = LoopRow(loop=loop.name, events=case.events)
        usable = [f for f in case.findings if f.usable and f.fit is not None]
        seen = usable or case.findings
        row.ci_setpoint = _median([f.record.ci for f in seen if f.record.kind == SETPOINT])
        row.ci_load = _median([f.record.ci for f in seen if f.record.kind == LOAD])
        ci = row.ci_setpoint, row.ci_load
        last = case.findings[-1].record
        if not usable:
            row.verdict, row.reason, row.process = INCONCLUSIVE, last.reason, last.process
            row.action = "none on this evidence; wait for, or make, a clean set-point step"
            return row, None
        kinds = {f.fit.process for f in usable if f.fit is not None}
        fits = [f.fit for f in usable if f.fit is not None]
        if len(kinds) > 1 or len({math.copysign(1, f.gain) for f in fits}) > 1:
            row.process = "undecided"
            return _inconclusive(
                row, "the events contradict each other in kind of process or sign of gain"
            ), None
        joint = combine(fits)
        row.process = joint.process
        for name, value in model_fields(joint).items():
            setattr(row, name, value)
        if contradictory(fits, joint):
            return _inconclusive(
                row, "the events contradict each other: their gains differ beyond chance"
            ), None
        form, model = canonical_form(loop), model_of(joint)
        ms = row.ms = current_sensitivity(loop, form, model, usable[-1].period)
        row.verdict, row.reason = judge(loop, form, model, ci, ms, 0.0)
        if len(usable) == 1 and row.verdict == usable[0].record.verdict:
            row.reason = usable[0].record.reason  # it knows the overshoot and how the event ended
        if row.verdict != RETUNE:
            row.action = "none" if row.verdict == GOOD else "wait for, or make, a clean set-point step"
            return row, None
        noise = float(np.median([f.noise for f in usable]))
        advice = advise(loop, form, joint, noise, usable[-1].period, ms)
        if isinstance(advice, Withheld):
            return _withhold(row, advice), None
        return _with_settings(row, loop, form, advice), advice

    def row(self, row: int) -> LoopRow:
        """Return a loop's current row: its verdict, and its health so far."""
        loop = self.loops[row]
        case = self._cases.get(row)
        out = (
            LoopRow(loop=loop.name) if case is None or case.row is None else msgspec.structs.replace(case.row)
        )
        if loop.kp is not None:
            out.kp, out.ti, out.td, out.tf = loop.kp, loop.ti, loop.td, loop.filter_time
        state = self.detector.state[row]
        _health(out, state)
        if case is None:
            out.reason, out.action = (
                _nothing_seen(state),
                "none; a set-point step shows how the loop is tuned",
            )
        return out

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


def worst_first(row: LoopRow) -> tuple[int, float, str]:
    """Sort key of loop rows: verdict, then the less of CI and what is left to the Ms limit, then the name."""
    worth = [
        1.0 if row.ci_setpoint is None else row.ci_setpoint,
        1.0 if row.ci_load is None else row.ci_load,
        1.0 if row.ms is None else 2.0 / max(row.ms, 1.0),
    ]
    return WORST_FIRST.index(row.verdict), min(worth), row.loop


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


def _median(values: list[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.median(known)) if known else None


def _inconclusive(row: LoopRow, reason: str) -> LoopRow:
    row.verdict, row.reason = INCONCLUSIVE, reason
    row.action = "look at the events side by side: did the plant, the range or the valve change between them?"
    return row


def _withhold(row: LoopRow, withheld: Withheld) -> LoopRow:
    if withheld.fine_as_it_is:
        row.verdict, row.reason, row.action = GOOD, withheld.reason, "none"
        return row
    row.reason = f"{row.reason}; no suggestion: {withheld.reason}"
    row.action = "retune by hand with care, or make a larger set-point step for a sharper model"
    return row


def _with_settings(row: LoopRow, loop: Loop, form: str, advice: Advice) -> LoopRow:
    """Fill in the columns of a suggestion."""
    new = advice.settings
    row.rule, row.form = advice.rule, loop.form
    row.new_kp, row.new_ti, row.new_td, row.new_tf = (float(v) for v in (new.kp, new.ti, new.td, new.tf))
    if form == "parallel":
        row.new_ki, row.new_kd = float(new.ki), float(new.kd)
    row.new_ms, row.new_ms_worst, row.new_ci = advice.ms, advice.ms_worst, advice.ci
    row.new_op_noise_abs = advice.op_noise
    if loop.op_span is not None:
        row.new_op_noise = 100.0 * advice.op_noise / loop.op_span
    row.stages = json.dumps([_plain(s) for s in advice.stages])
    steps = f", in {len(advice.stages)} stages" if len(advice.stages) > 1 else ""
    row.action = f"set {_words(new)}{steps}"
    try:
        row.new_fields = json.dumps(_fields(loop, new))
    except ValueError as error:  # a faceplate in % without the loop's spans, or a form that cannot hold them
        row.action += f"; the fields of {loop.form} cannot be given: {error}"
    return row


def _fields(loop: Loop, settings: Settings) -> dict[str, Any]:
    """Return the fields of the loop's block, or the form's own names."""
    if loop.form not in FORMS:
        return dict(BLOCKS[loop.form].fields(settings, loop))
    return _plain(settings)


def _plain(settings: Settings) -> dict[str, float | None]:
    """Return settings for JSON: no integral action is null."""
    names = ("kp", "ki", "kd", "tf") if settings.form == "parallel" else ("kp", "ti", "td", "tf")
    values = {n: float(getattr(settings, n)) for n in names}
    return {n: v if math.isfinite(v) else None for n, v in values.items()}


def _words(settings: Settings) -> str:
    """Say settings with their units."""
    if settings.form == "parallel":
        return f"kp = {settings.kp:.4g}, ki = {settings.ki:.4g} /s, kd = {settings.kd:.4g} s"
    integral = f"ti = {settings.ti:.4g} s" if math.isfinite(float(settings.ti)) else "no integral action"
    lead = f", td = {settings.td:.4g} s, tf = {settings.tf:.3g} s" if float(settings.td) > 0 else ""
    return f"kp = {settings.kp:.4g}, {integral}{lead}"


def _changed(old: LoopRow, new: LoopRow) -> bool:
    """Whether a suggestion says something new: another verdict, or settings that differ by more than 5 %."""
    if old.verdict != new.verdict or old.rule != new.rule or old.new_kp is None or new.new_kp is None:
        return True
    pairs = [(old.new_kp, new.new_kp), (old.new_ti, new.new_ti), (old.new_td, new.new_td)]
    return any(not math.isclose(a or 0.0, b or 0.0, rel_tol=0.05) for a, b in pairs)


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


def _health(row: LoopRow, state: Any) -> None:
    """Fill in what the running state knows of the loop's health; empty where nothing was seen."""
    wall, good = float(state["wall_time"]), float(state["good_time"])
    if wall <= 0 or good <= 0:
        return
    row.coverage = min(good / wall, 1.0)
    row.manual = float(state["manual_time"]) / good
    row.saturation = float(state["limit_time"]) / good
    row.travel_per_hour = float(state["travel"]) / good * 3600.0
    if state["warm"] > 0:
        row.offset = float(state["mean_e"])
        row.noise = math.sqrt(float(state["var_d"]) / 6.0)
    row.quantum = float(state["quantum"]) or None
    row.flags = ("manual",) if row.manual > 0.5 else ()


def _nothing_seen(state: Any) -> str:
    """Why a loop was not assessed."""
    if state["seen"] == 0:
        return "no good sample was seen"
    if state["manual_time"] > 0.5 * max(float(state["good_time"]), 1e-9):
        return "in manual"
    return "no set-point step was seen"
