"""The benchmark of events: nothing invented on loops that are left alone, nothing missed of what happens.

``python -m tests.bench.detection [--kind NAME ...] [--loops N] [--weeks W] [--seed S]``: one table row for each
kind, what misses its goal marked with ``!``. The defaults watch 100 loop-weeks of each kind at 1 Hz, 60 million
samples, in about half a minute on a core, and 200 loops with six known events each.

An event is what the engine reports: an assessed set-point or load step. ``suspected`` counts load steps that were
looked at, verified or not; ``disturb.`` those of them that are reported as upsets that are no clean step, and may be as
many as false load events.

*Left alone* (plants and good PI and PID settings of `sim_plants.fleet`, integrating and self-regulating):

- white: noise of 0.01 to 1 % of PV's span. coloured: the same, with a correlation time of 2 to 200 s. quantised: 8 to
  12 bit, noise of 0.05 to 2 steps, a slightly wandering load. At most 2 events in 100 loop-weeks.
- cycling: an integrator whose valve sticks by 0.3 to 3 % hunts for ever.
- wander: a load that wanders by 0.2 to 5 % of OP with a memory of ten minutes to a day, white noise.
- ramps: SP moves by 0.5 to 5 % of span within two minutes to an hour, rests for five minutes to two hours, and comes
  back.
- cascade: a master moves SP by 0.1 to 3 % of span (standard deviation; correlation time 30 to 1000 s), at every
  sample or every 2, 5, 10 or 30 s. Of both, the moves are recorded; at most 0.1 load events a loop-week.

No kind may bring an assessment that says `retune`. ``flags``: flags at the end that say that a loop oscillates, its
valve sticks, or its data are not to be trusted; none, but for the valve that cycles.

*Known events* (tunings as plants have them, good and bad): six steps of either sign, 1.5 to 4 settling times apart.
The smallest of a loop's steps has 5 to 50 standard deviations of PV's noise: a set-point step by its size, a load step
by the largest deviation of PV that it causes without noise. Found: one assessment of its kind begins within the
response's T0, or 60 s, of it; everything else that is reported is false. Onset: share of those found whose onset is
right within two dead times (at least two samples).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from monitor.contract.loops import LoopTable
from monitor.contract.records import DISTURBANCE, RETUNE, Assessment
from monitor.engine import Engine
from sim_plants.loops import Simulation
from sim_plants.specs import LoopSpec
from sim_plants.truth import truth_events
from tests.bench.detection_fleet import KINDS, Kind, fleet, lasts
from tests.support.plants import samples_of, table_of

WEEK = 7 * 86400.0
CHUNK = 2_000_000
"""Samples at a time: 100 MB."""
GOAL = 0.98
"""Least precision, recall, and share of onsets that are right."""
CONDEMN = {
    "oscillating",
    "stiction",
    "stuck_pv",
    "mapping_suspect",
    "compressed",
    "undersampled",
    "config_change",
}
"""Flags that no healthy loop may bear at the end."""
MOVING = ("ramps", "cascade")
"""Kinds whose set point moves: that is recorded, and blames no loop."""
HEAD = (
    f"{'kind':11}{'loop-weeks':>11}{'suspected':>10}{'set point':>10}{'load':>8}{'disturb.':>10}"
    f"{'retune':>8}{'flags':>8}{'precision':>11}{'recall':>9}{'onset':>8}{'s':>7}"
)


@dataclass
class Outcome:
    """What was reported of one kind of loops."""

    kind: str
    weeks: float
    suspected: int
    assessments: list[Assessment]
    """Of set-point and load steps."""
    specs: list[LoopSpec]
    seconds: float
    disturbances: list[Assessment] = field(default_factory=list)
    flags: list[str] = field(default_factory=list)
    """Flags of `CONDEMN` that loops bear at the end, each with its loop."""
    wanted: int = 0
    matches: list[tuple[Assessment, float]] = field(default_factory=list)
    """Assessments of known events, with the error of the onset [s]."""

    def false(self, kind: str) -> list[Assessment]:
        """Assessments of a kind that no known event explains."""
        true = {id(a) for a, _ in self.matches}
        return [a for a in self.assessments if a.kind == kind and id(a) not in true]

    @property
    def retunes(self) -> list[Assessment]:
        """Assessments that blame a loop which is left alone."""
        return [] if self.wanted else [a for a in self.assessments if a.verdict == RETUNE]

    @property
    def precision(self) -> float:
        return len(self.matches) / max(len(self.assessments), 1)

    @property
    def recall(self) -> float:
        return len(self.matches) / max(self.wanted, 1)

    @property
    def onset(self) -> float:
        """Share of the known events found whose onset is right."""
        plants = {s.name: s.plant for s in self.specs}
        right = [abs(error) <= max(2 * plants[a.loop].half_rule()[0], 2.0) for a, error in self.matches]
        return sum(right) / max(len(right), 1)


def watch(name: str, loops: int, weeks: float, seed: int) -> Outcome:
    """Simulate loops of a kind for ``weeks`` each, or until their known events are over, under an engine."""
    kind, began = KINDS[name], time.perf_counter()
    specs = fleet(kind, loops, seed)
    if not kind.events:
        return _watch(name, kind, specs, weeks * WEEK, began)
    parts = [_watch(name, kind, [s], lasts(s), began) for s in specs]
    whole = Outcome(name, 0.0, 0, [], specs, time.perf_counter() - began)
    for part in parts:
        whole.weeks += part.weeks
        whole.suspected += part.suspected
        whole.wanted += part.wanted
        whole.flags += part.flags
        whole.disturbances += part.disturbances
        whole.assessments += part.assessments
        whole.matches += part.matches
    return whole


def _watch(name: str, kind: Kind, specs: list[LoopSpec], seconds: float, began: float) -> Outcome:
    simulation, engine = Simulation(specs), Engine(LoopTable(table_of(specs)))
    found: list[Assessment] = []
    at = 0.0
    while at < seconds:
        part = min(max(CHUNK // len(specs), 1), seconds - at)
        records = engine.step(samples_of(simulation.advance(part)))
        found += [r for r in records if isinstance(r, Assessment)]
        at += part
    found += [r for r in engine.flush() if isinstance(r, Assessment)]
    suspected = engine.passed_over + sum(a.kind != "setpoint" for a in found)
    weeks = len(specs) * seconds / WEEK
    steps = [a for a in found if a.kind != DISTURBANCE]
    outcome = Outcome(name, weeks, suspected, steps, specs, time.perf_counter() - began)
    outcome.disturbances = [a for a in found if a.kind == DISTURBANCE]
    outcome.flags = [
        f"{row.loop} {flag}" for row in engine.rows() for flag in CONDEMN.intersection(row.flags)
    ]
    if kind.events:
        _match(outcome, kind.events, seconds, simulation.start_ns)
    return outcome


def _match(outcome: Outcome, kind: str, seconds: float, start: int) -> None:
    """Give each known event the assessment of its kind that begins nearest to it, if it is near."""
    reach = {s.name: max(s.plant.t0, 60.0) for s in outcome.specs}
    free = [a for a in outcome.assessments if a.kind == kind]
    for event in truth_events(outcome.specs, seconds):
        outcome.wanted += 1
        errors = [
            (abs(error), error, a)
            for a in free
            if a.loop == event["loop"]
            and abs(error := (a.start - start) * 1e-9 - event["onset"]) <= reach[a.loop]
        ]
        if errors:
            _, error, nearest = min(errors, key=lambda e: e[0])
            free.remove(nearest)
            outcome.matches.append((nearest, error))


def table_line(o: Outcome) -> str:
    """One row of the table."""

    def cell(text: str, bad: bool, width: int) -> str:
        return f"{text + ('!' if bad else ' '):>{width}}"

    known = bool(KINDS[o.kind].events)
    setpoints, loads = len(o.false("setpoint")), len(o.false("load"))
    line = f"{o.kind:11}{o.weeks:11.1f}{o.suspected:10d}"
    line += cell(str(setpoints), not known and setpoints > 0 and o.kind not in MOVING, 10)
    line += cell(str(loads), loads > KINDS[o.kind].most_loads * o.weeks, 8)
    upsets = len(o.disturbances)
    line += cell(str(upsets), upsets > KINDS[o.kind].most_loads * o.weeks, 10)
    line += cell(str(len(o.retunes)), len(o.retunes) > 0, 8)
    line += cell(str(len(o.flags)), len(o.flags) > 0 and o.kind != "cycling", 8)
    for value, width in ((o.precision, 11), (o.recall, 9), (o.onset, 8)):
        line += cell(f"{100 * value:.1f} %", value < GOAL, width) if known else " " * width
    return f"{line}{o.seconds:7.0f}"


def describe(o: Outcome, most: int) -> str:
    """Say what was invented, and what was missed, loop by loop."""
    wrong = [] if o.kind == "cycling" else o.flags
    lines = [
        f"  {a.loop} {a.kind} at {(a.start - 1_767_225_600_000_000_000) / 1e9:.1f} s: {a.amplitude:.3g}, fit {a.fit},"
        f" {a.state}, {a.verdict}"
        for a in [*o.false("setpoint"), *o.false("load"), *o.disturbances][:most]
    ]
    return "\n".join([*lines, *(f"  {flag}" for flag in wrong[:most])])


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the kinds asked for and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--kind", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--loops", type=int, help="loops a kind (100; 200 where events are known)")
    parser.add_argument("--weeks", type=float, default=1.0, help="time that loops left alone are watched")
    parser.add_argument("--seed", type=int, default=20_260_101)
    parser.add_argument("--show", type=int, default=0, help="describe this many false events of each kind")
    args = parser.parse_args(arguments)
    print(HEAD)
    for name in args.kind:
        outcome = watch(name, args.loops or (200 if KINDS[name].events else 100), args.weeks, args.seed)
        print(table_line(outcome), flush=True)
        if args.show:
            print(describe(outcome, args.show))


if __name__ == "__main__":
    main()
