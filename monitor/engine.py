"""The engine: samples in, records out. Owns all state; knows no clock, no file, no socket.

Live service and audit drive the same engine, and the same samples give the same records however they are
batched: detection works sample by sample, and a loop's assessment rests on that loop's events alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.assess.disturbance import assess_disturbance
from monitor.assess.event import assess_event
from monitor.assess.told import closing, window_of
from monitor.contract.danger import worst_first
from monitor.contract.evidence import Answers
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import SETPOINT, Event, LoopRow, Record, Suggestion, event_id
from monitor.contract.samples import Samples
from monitor.detect.constants import SUSPECTED_LOAD_QUANTA
from monitor.detect.detector import Detector, Found
from monitor.detect.event import BY_GAP, BY_SETTINGS, LOAD_STEP, ClosedEvent, Stretch
from monitor.detect.state import FATES
from monitor.health.diagnoses import Diagnoses
from monitor.health.diagnosis import Signs
from monitor.health.loop_health import by_exception, figures
from monitor.health.measurement import compression_of
from monitor.memory import LoopMemory, WaitingEvent
from monitor.reporting.stage import Reporting
from monitor.samples_seen import SamplesSeen
from monitor.verdict.answers import answers_of
from monitor.verdict.history import LoopHistory
from monitor.verdict.in_force import InForce
from monitor.verdict.moves import is_led, moves_in_words
from monitor.verdict.parts import Tuning
from monitor.verdict.row import loop_row, says_new


class Engine:
    """Watches the loops of a table.

    Parameters
    ----------
    loops
        Read, and extended by `add`; not copied.
    most_stretches
        Loops whose stretches may wait to be looked at; of others they are let go. None: any number, as where the same
        samples have to give the same records however they are batched.
    """

    def __init__(self, loops: LoopTable, most_stretches: int | None = None) -> None:
        self.loops = loops
        self.most_stretches = most_stretches
        self.reporting = Reporting(list(loops))
        self.detector = Detector(list(loops))
        self.seen = SamplesSeen(self.detector, self.reporting)
        """What became of the samples."""
        self._histories: dict[int, LoopHistory] = {}
        self.waiting: list[WaitingEvent] = []
        """Events that have closed and are to be assessed, in order; those that another engine closed may be added."""
        self._diagnoses = Diagnoses(most_stretches)
        self._stretches: dict[int, list[Stretch]] = {}
        """By row: to be looked at before the row's next event, or when nothing else waits."""
        self._declared: dict[int, Loop] = {}
        """Rows of the loop table as they were before something else was said of their loops."""
        self._changed: set[int] = set()
        """Rows of loops of which more is known than when this was last asked."""
        self.disturbances = 0
        """Upsets that are no clean step."""
        self.passed_over = 0
        """Suspected load steps that no step explains, and that do not stand out of what the loop always does."""

    def follow(self) -> None:
        """Watch what was added to the loop table: a thousand loops at once cost as much as one."""
        known = len(self.detector.state)
        if known < len(self.loops):
            self.reporting.add(self.loops.loops[known:])
            self.detector.add(self.loops.loops[known:])

    def retuned(self, row: int, loop: Loop) -> list[Record]:
        """Take over a loop's new settings: they close the suggestion, and start the comparison of before and after.

        An open event is closed first, and judged by the settings under which it ran. The process that past
        events showed stays known; their indices no longer speak for the loop.
        """
        records = self._finish(row, BY_SETTINGS)
        self._declared.setdefault(row, self.loops[row])
        self.loops.replace(row, loop)
        self.take_over(row)
        self._history(row).retune(self.seen.last(row).time + 1, self.loops[row])
        self._diagnoses.forget(row)
        self._changed.add(row)
        return records

    def redeclared(self, row: int, loop: Loop) -> list[Record]:
        """Take over a loop's row of the loop table, which is another one now."""
        records = self.retuned(row, loop)
        self._declared.pop(row)
        return records

    def take_over(self, row: int) -> None:
        """Take over a loop's ranges, limits and period, as its row has them now."""
        self.reporting.set_period(row, self.loops[row])
        self.detector.set_limits(row, self.loops[row])

    def set_back(self, row: int, first: int) -> list[Record]:
        """Begin a loop anew at an earlier time, ``first`` [ns]: its clock was set back, and an open event ends."""
        records = self._let_go([row])
        self.reporting.forget(row)
        records += self._take(self.detector.flush([row], BY_GAP))
        self.detector.set_back(row, first)
        return records

    def retire(self, row: int) -> list[Record]:
        """Give up a loop; an open event ends. Its row is as new, for whoever takes it next."""
        records = self._finish(row, BY_GAP)
        self.seen.keep(row)
        self.reporting.forget(row)
        self._histories.pop(row, None)
        self._diagnoses.forget(row)
        self.detector.forget(row)
        self._declared.pop(row, None)
        self._changed.discard(row)
        return records

    def _finish(self, row: int, cause: int) -> list[Record]:
        """End a loop's open event, and assess those that wait."""
        records = self._let_go([row]) + self._take(self.detector.flush([row], cause))
        own = [waiting for waiting in self.waiting if waiting.event.row == row]
        self.waiting = [waiting for waiting in self.waiting if waiting.event.row != row]
        records += [record for waiting in own for record in self._assess(waiting)]
        self._look_at_stretches(row)
        return records

    # -- samples in, records out ------------------------------------------------------------------

    def step(self, samples: Samples) -> list[Record]:
        """Take in samples (each loop's times increasing) and assess every event that they close."""
        return self.detect(samples) + self.assess()

    def detect(self, samples: Samples) -> list[Record]:
        """Take in samples; return openings and closings. Assessments wait for `assess`."""
        return [record for piece in self.reporting.run(samples) for record in self._detect(piece)]

    def _detect(self, samples: Samples) -> list[Record]:
        """Take in samples of loops whose rows come at a rate, or were filled."""
        records = self._take(self.detector.run(samples))
        for stretch in self.detector.take_stretches():
            full = self.most_stretches is not None and len(self._stretches) >= self.most_stretches
            if full and stretch.row not in self._stretches:
                continue
            self._stretches.setdefault(stretch.row, []).append(stretch)
        return records

    def _let_go(self, rows: list[int] | None = None) -> list[Record]:
        """Take in what waits until it is known how rows come."""
        return [record for piece in self.reporting.flush(rows) for record in self._detect(piece)]

    def assess(self, most: int | None = None) -> list[Record]:
        """Assess waiting events, oldest first, then look at the controllers in stretches; at most ``most`` of both."""
        n = self.backlog if most is None else min(most, self.backlog)
        now, self.waiting = self.waiting[:n], self.waiting[n:]
        records = [record for waiting in now for record in self._assess(waiting)]
        for row in sorted(self._stretches.keys() | self._diagnoses.waiting.keys())[: n - len(now)]:
            self._look_at_stretches(row)
            self._diagnoses.catch_up(row)
            self._changed.add(row)
        return records

    @property
    def backlog(self) -> int:
        """Events, and loops with stretches or blocks, that wait for `assess`."""
        return len(self.waiting) + len(self._stretches.keys() | self._diagnoses.waiting.keys())

    def close(self) -> list[Record]:
        """Close what is open, because the data end here; assessments wait for `assess`."""
        return self._let_go() + self._take(self.detector.flush())

    def flush(self) -> list[Record]:
        """Close what is open, because the data end here, and assess it."""
        return self.close() + self.assess()

    def _take(self, found: Found) -> list[Record]:
        """Report openings and closings; a suspected load step is reported when it is known what it was."""
        self._diagnoses.wait(self.detector.take_blocks())
        records: list[Record] = []
        for event in found:
            self._changed.add(event.row)
            closed = event if isinstance(event, ClosedEvent) else None
            loop = self.loops[event.row].name
            identity = event_id(loop, event.onset)
            if closed is None or closed.kind != LOAD_STEP:
                records.append(
                    Event(
                        id=identity,
                        loop=loop,
                        kind=SETPOINT,
                        state="open" if closed is None else closed.state,
                        start=event.onset,
                        end=None if closed is None else closed.end,
                        amplitude=event.amplitude,
                    )
                )
            if closed is not None:
                self.waiting.append(WaitingEvent(identity, closed, self.reporting.dead_band(closed.row)))
        return records

    def _history(self, row: int) -> LoopHistory:
        return self._histories.setdefault(row, LoopHistory(InForce(self.loops[row])))

    def _look_at_stretches(self, row: int, until: int | None = None) -> None:
        """See the controller in a loop's waiting stretches that end by ``until`` [ns], all by default."""
        waiting, history = self._stretches.pop(row, []), self._history(row)
        for k, stretch in enumerate(waiting):
            if until is not None and stretch.end > until:
                self._stretches[row] = waiting[k:]
                break
            history.look(stretch.window, stretch.start, stretch.end, stretch.period)

    def _assess(self, waiting: WaitingEvent) -> list[Record]:
        """See the controller in an event, and judge both; a loop's order is that of time, however it was batched."""
        event = waiting.event
        self._look_at_stretches(event.row, event.end)
        history = self._history(event.row)
        if not (event.thinned and history.in_force.seen_since(event.onset)):
            first = event.onset + round(event.window.time[0] * 1e9)
            history.look(event.window, first, event.end, event.period)
        signs = self._diagnoses.look(event.row, event.end)
        self._changed.add(event.row)
        return self._judged(event, history, waiting.dead_band, signs)

    def _judged(
        self, event: ClosedEvent, history: LoopHistory, dead_band: float | None, signs: Signs
    ) -> list[Record]:
        row, in_force = event.row, history.in_force
        if dead_band is not None:
            event = replace(event, quantum=max(event.quantum, dead_band))
            # a dead band is as coarse as a transmitter's last bit
            if event.kind == LOAD_STEP and abs(event.amplitude) < SUSPECTED_LOAD_QUANTA * dead_band:
                self.passed_over += 1
                return []
        controller = in_force.extra_delay, in_force.contradiction
        made_up = compression_of(event.health["measurement"]) or 0.0
        finding = assess_event(
            in_force.loop,
            event,
            *controller,
            thorough=history.under_way,
            reconstructed=1.0 if dead_band is not None else made_up,
        )
        if not finding.is_event:
            return [] if finding.is_tail else self._disturbed(event, history, made_up, dead_band, signs)
        finding = history.add(finding)
        records: list[Record] = [] if finding.record.kind == SETPOINT else [closing(finding.record)]
        records += [finding.record, window_of(event, finding.record, finding.fit)]
        standing = self._row(row, event.health, event.period, dead_band, signs)
        history.verdict = standing.verdict
        if standing.new_kp is None:
            history.published = None
        elif history.published is None or says_new(history.published, standing):
            history.published = standing
            evidence = tuple(f.record.id for f in history.usable)
            records.append(Suggestion(row=standing, evidence=evidence))
        return records

    def _disturbed(
        self, event: ClosedEvent, history: LoopHistory, made_up: float, dead_band: float | None, signs: Signs
    ) -> list[Record]:
        """Record a suspected load step that no step explains, where it stands out."""
        record = assess_disturbance(history.loop, event, history.model, made_up)
        if record is None:
            self.passed_over += 1
            return []
        self.disturbances += 1
        record = history.add_disturbance(record)
        history.verdict = self._row(event.row, event.health, event.period, dead_band, signs).verdict
        return [closing(record), record, window_of(event, record, None)]

    # -- the loop as it stands --------------------------------------------------------------------

    def row(self, row: int, units: str | None = None) -> LoopRow:
        """Return a loop's current row: its verdict, and its health so far.

        Parameters
        ----------
        units
            What its samples show of SP being in another unit than PV; None: nothing.
        """
        state = self.detector.state[row]
        moves = {name: int(state["moves"][name]) for name in FATES}
        period, dead_band = float(state["clock"]["period"]), self.reporting.dead_band(row)
        signs = self._diagnoses.signs(row)
        return self._row(row, self.detector.health[row], period, dead_band, signs, moves, units)

    def _row(
        self,
        row: int,
        health: np.void,
        period: float,
        dead_band: float | None,
        signs: Signs,
        moves: Mapping[str, int] | None = None,
        units: str | None = None,
    ) -> LoopRow:
        """Return a loop's row with its health, period [s], dead band [PV], signs and moves' fates of some moment."""
        history = self._histories.get(row)
        tuning = Tuning() if history is None else history.tuning
        seen = by_exception(figures(health, period, tuning.model.get("dead_time")), dead_band)
        in_force = InForce(self.loops[row]) if history is None else history.in_force
        if moves is not None:
            tuning = replace(tuning, moves=moves_in_words(moves), led=is_led(moves))
        return loop_row(in_force, tuning, replace(seen, signs=signs, units=units))

    def rows(self) -> list[LoopRow]:
        """Return one row for each loop, worst first: by verdict, then by index, then by name."""
        rows = [self.row(k) for k in range(len(self.loops))]
        return sorted(rows, key=worst_first)

    def answers(self, row: int, standing: LoopRow) -> tuple[Answers, ...]:
        """Return what a loop makes of unit steps, today and by what its row as it stands suggests."""
        history = self._histories.get(row)
        return () if history is None else answers_of(history, standing)

    def verdict(self, row: int) -> str | None:
        """Return a loop's verdict as of its last event, None where nothing was assessed."""
        history = self._histories.get(row)
        return None if history is None else history.verdict

    def open_rows(self) -> NDArray[np.intp]:
        """Return the rows of the loops with an open event."""
        return self.detector.open_rows

    # -- what outlives the process ------------------------------------------------------------------

    def take_changed(self) -> set[int]:
        """Return the rows of the loops of which more is known than when this was last asked."""
        changed, self._changed = self._changed, set()
        return changed

    def declared(self, row: int) -> Loop:
        """Return a loop's row of the loop table, as it was before something else was said of the loop."""
        return self._declared.get(row, self.loops[row])

    def remember(self, row: int) -> LoopMemory:
        """Return what samples have shown of a loop: not a copy, to be used before the next ones."""
        numbers = {"state": self.detector.state[row], "health": self.detector.health[row]}
        numbers |= {name: array[0] for name, array in self.reporting.known(np.array([row])).items()}
        return LoopMemory(self._histories.get(row), self._diagnoses.of(row), numbers)

    def recall(self, row: int, declared: Loop, loop: Loop, memory: LoopMemory | None) -> None:
        """Go on with what another engine knew of a loop; its samples begin anew, as after a gap.

        Parameters
        ----------
        declared, loop
            Its row of the loop table then, and with what was said since: that holds, unless the row is another one now.
        memory
            What samples had shown; None: that cannot be read.
        """
        table = self.loops[row]
        if memory is not None:
            if memory.history is not None:
                self._histories[row] = memory.history
            self._diagnoses.go_on(row, memory.diagnosis)
            self.detector.recall(row, memory.numbers)
            self.reporting.adopt(row, memory.numbers)
            self.seen.take_off(row)
        if table == declared != loop:
            self._declared[row] = table
            self.loops.replace(row, loop)
            self.take_over(row)
        elif table != declared:
            self.loops.replace(row, loop)
            self.redeclared(row, table)

    # -- open events that outlive it as well --------------------------------------------------------

    def known(self, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
        """Copy all that is known of loops with an open event: plain arrays with a row for each loop.

        Among them ``onset``, of its event [ns since 1970]. For no loops: the layouts alone.
        """
        return {**self.detector.known(rows), **self.reporting.known(rows)}

    def adopt(self, row: int, known: dict[str, Any]) -> None:
        """Go on with a loop whose event was open when another engine ended: its row of each array of `known`."""
        self.seen.keep(row)
        self.detector.adopt(row, known)
        self.reporting.adopt(row, known)
        self.seen.take_off(row)
