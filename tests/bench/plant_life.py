"""The benchmark of plant life: days or weeks in which everything happens, mixed, and each loop's row judged.

``python -m tests.bench.plant_life [--loops N] [--days D] [--kind KIND ...] [--seed S] [--jobs N] [--show]
[--json FILE]``

Each loop has one underlying truth (`plant_life_fleet.NAMES`) on any plant (flow, temperature, pressure, level), and
beside it the life of a plant (`plant_life_days`): warm-ups, spells in manual, set-point steps, load upsets of seven
shapes, a wandering load; sampled every 1, 5 or 10 s, recorded raw, by exception, through a swinging door or in slices
(`plant_life_recording`). The engine of the audit sees the samples and half of the settings; its row is judged by the
one table of `plant_life_truth`.

Columns: loops, those that deserve a verdict, right ones of these, silent ones and wrong ones of all; then the most
frequent wrong reasons. Totals as the goals name them. ``valve recall``: of valves whose band moves PV by three standard
deviations of its noise; ``valve precision``: of rows with the flag `stiction`; ``oscillation``: of loads that swing for
six cycles and more with twice the noise's standard deviation; ``false alarms``: the flag on a healthy loop.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # one loop, one core

from monitor.contract.loops import LoopTable  # noqa: E402 (after the threads)
from monitor.contract.records import RETUNE, LoopRow  # noqa: E402
from monitor.engine import Engine  # noqa: E402
from tests.bench.fleet_run import write  # noqa: E402
from tests.bench.plant_life_fleet import (  # noqa: E402
    AGGRESSIVE,
    BACKLASH,
    HEALTHY,
    HUNTING,
    INTEGRAL,
    MIX,
    NAMES,
    RATE,
    SLOW,
    STICK,
    VALVES,
    WAVES,
)  # fmt: skip
from tests.bench.plant_life_truth import (  # noqa: E402
    RIGHT,
    SILENT,
    WRONG,
    Facts,
    Said,
    deserves,
    judge,
    new_law,
)  # fmt: skip
from tests.bench.plant_life_world import Life, lead, swings  # noqa: E402

SEED = 20_271_203
"""Held out: named here and nowhere else; develop with another one."""
HEAD = (
    f"{'kind':14}{'loops':>6}{'deserve':>8}{'right':>7}{'silent':>8}{'wrong':>7}  most frequent wrong answers"
)
TUNED = (SLOW, AGGRESSIVE, INTEGRAL)
SHOWN = 3
"""Wrong answers of a kind that are named."""


@dataclass
class Outcome:
    """What was said of a loop, and what that is worth."""

    kind: str
    number: int
    deserves: bool
    outcome: str
    why: str
    verdict: str
    flags: tuple[str, ...]
    reason: str
    action: str
    facts: Facts
    plant: dict[str, Any] = field(default_factory=dict)
    new: dict[str, float | None] = field(default_factory=dict)
    ms_after: float = math.nan
    seconds: float = 0.0


def row_of(life: Life) -> LoopRow:
    """Let an engine, as the audit does, see the samples of a life."""
    engine = Engine(LoopTable([life.table]))
    engine.step(life.samples)
    engine.flush()
    return engine.row(0)


def watch(kind: str, number: int, seed: int, days: float) -> Outcome:
    """Draw a loop, let it live, let the product see it, and judge what it says."""
    began = time.perf_counter()
    life = lead(kind, number, seed, days)
    base, facts = life.base, life.facts
    try:
        row = row_of(life)
    except Exception as error:  # noqa: BLE001 (one loop must not end the benchmark; it counts as wrong)
        row = LoopRow(loop=life.table.name, reason=f"{type(error).__name__}: {error}")
        return _outcome(life, row, Said(row, base, facts, math.nan), (WRONG, "crash"), began)
    ms_after, goes_on = math.nan, False
    if row.new_kp is not None:
        law = new_law(base.body.law, row)
        ms_after = base.truth(law)[0]
        goes_on = kind == RATE and swings(base, law)
    said = Said(row, base, facts, ms_after, goes_on)
    return _outcome(life, row, said, judge(said), began)


def _outcome(life: Life, row: LoopRow, said: Said, judged: tuple[str, str], began: float) -> Outcome:
    base, body, law = life.base, life.base.body, life.base.body.law
    return Outcome(
        base.kind, base.number, deserves(base, life.facts), *judged, row.verdict, row.flags, row.reason, row.action,
        life.facts,
        {
            "process": body.plant.process, "natural": base.natural, "slope": body.plant.slope,
            "dead_time": body.plant.dead_time, "every": base.every, "kp": law.kp, "ti": law.ti, "td": law.td,
            "valve": str(body.valve), "known": life.table.kp is not None, "events": len(life.happened.events),
        },
        {name: getattr(row, name) for name in ("new_kp", "new_ti", "new_td", "kp_seen", "ti_seen", "gain")},
        said.ms_after,
        time.perf_counter() - began,
    )  # fmt: skip


def watch_one(args: tuple[str, int, int, float]) -> Outcome:
    return watch(*args)


def table_line(kind: str, outcomes: Sequence[Outcome]) -> str:
    """One row of the table."""
    count = Counter(o.outcome for o in outcomes)
    worth = [o for o in outcomes if o.deserves]
    why = Counter(o.why for o in outcomes if o.outcome == WRONG).most_common(SHOWN)
    return (
        f"{kind:14}{len(outcomes):6d}{len(worth):8d}{_share(o.outcome == RIGHT for o in worth):>7}"
        f"{count[SILENT]:8d}{count[WRONG]:7d}  {', '.join(f'{n} {w}' for w, n in why)}"
    )


def totals(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the totals that the goals name."""
    worth = [o for o in outcomes if o.deserves]
    valves = [o for o in worth if o.kind in {STICK, BACKLASH}]
    named = [o for o in outcomes if "stiction" in o.flags]
    swinging = [o for o in worth if o.kind in {*WAVES, HUNTING}]
    healthy = [o for o in outcomes if o.kind == HEALTHY]
    rows = [
        ("right, of those that deserve a verdict", [o.outcome == RIGHT for o in worth], "80 % or more"),
        ("wrong, of all", [o.outcome == WRONG for o in outcomes], "2 % or less"),
        ("settings that do harm, of all", ["do harm" in o.why for o in outcomes], "none"),
        ("tuning blamed rightly, no settings", [_withheld(o) for o in worth if o.kind in TUNED], "few"),
        ("valve recall", ["stiction" in o.flags for o in valves], "85 % or more"),
        ("valve precision", [o.kind in VALVES for o in named], "97 % or more"),
        ("oscillation recall", ["oscillating" in o.flags for o in swinging], "95 % or more"),
        ("oscillation, false alarms", ["oscillating" in o.flags for o in healthy], "1 % or less"),
    ]
    return [f"{what:40}{sum(v):5d} of {len(v):4d} {_share(v):>5}   goal: {goal}" for what, v, goal in rows]


def _withheld(o: Outcome) -> bool:
    return o.verdict == RETUNE and o.new["new_kp"] is None


def _share(values: Iterable[bool]) -> str:
    known = list(values)
    return f"{sum(known) / len(known):.0%}" if known else "-"


def describe(outcomes: Iterable[Outcome]) -> str:
    """Say what was wrong, loop by loop."""
    return "\n".join(
        f"  {o.kind}-{o.number} ({o.facts.how}, {o.plant['process']}, {o.plant['every']} s): {o.why}: {o.verdict}, "
        f"{', '.join(o.flags) or 'no flags'}: {o.reason}"
        for o in outcomes
        if o.outcome == WRONG
    )


def run(args: argparse.Namespace) -> list[Outcome]:
    """Judge the loops asked for, with a line of progress."""
    mix = [k for k in MIX if k in args.kind]
    tasks = [(mix[n % len(mix)], n, args.seed, args.days) for n in range(args.loops)]
    began, outcomes = time.monotonic(), []
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for n, outcome in enumerate(pool.map(watch_one, tasks), 1):
            outcomes.append(outcome)
            left = (time.monotonic() - began) / n * (len(tasks) - n)
            print(f"\r{n} of {len(tasks)}, {left / 60:.1f} min left ", end="", flush=True, file=sys.stderr)
    print(file=sys.stderr)
    return outcomes


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the loops and print the table and the totals."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--loops", type=int, default=1000)
    parser.add_argument("--days", type=float, default=7.0)
    parser.add_argument("--kind", nargs="+", choices=NAMES, default=list(NAMES))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--show", action="store_true", help="describe every wrong answer")
    parser.add_argument("--json", help="write every outcome to this file, one line each")
    args = parser.parse_args(arguments)
    outcomes = run(args)
    print(HEAD)
    for kind in NAMES:
        own = [o for o in outcomes if o.kind == kind]
        if own:
            print(table_line(kind, own))
    print(table_line("all", outcomes), *totals(outcomes), sep="\n")
    if args.show:
        print(describe(outcomes))
    if args.json:
        write(outcomes, args.json)


if __name__ == "__main__":
    main()
