"""The benchmark of begins: records that start in a response, and set points that move in any way, at any time.

``python -m tests.bench.beginnings [--kind NAME ...] [--loops N] [--seed S] [--show N]``: a table row for each kind.

Loops are those of `retune` (PID on integrating, PI on self-regulating plants, tuned from far too slow to rolling and
ringing), noise .1 to 3 % of the moves, settings in the table, kind of process not.

- tail: a record cut at a random instant of a response to a set-point or load step that was 1 to 20 times as large as
  the later ones; then a set-point and a load step, two settling times apart.
- moves: six set-point steps, .15 to 2 settling times apart, after an upset up to 20 times as large.
- manual: three set-point steps after a switch from manual with PV elsewhere.
- ramps: up and down within .1 to 1 settling times. slave: a master moves the set point at every sample, with a memory
  of 3 to 30 dead times.

``found``: share of the set point's moves and load steps, of at least 5 standard deviations of PV's noise, that have an
event of their kind; ``scored``: of these, with an index. ``false``: events of either kind that no move and no load
explains, per record. ``gain in``: gains whose 95 % interval holds the truth, of those trusted; ``half``: median of its
half width; ``wide``: share above 15 %.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402 (after the threads)

from monitor.contract.loops import LoopTable  # noqa: E402
from monitor.contract.records import Assessment  # noqa: E402
from monitor.engine import Engine  # noqa: E402
from tests.bench.beginnings_fleet import KINDS, Record, draw  # noqa: E402
from tests.support.plants import table_of  # noqa: E402

NEAR_PERIODS = 2.5
"""Sample periods by which a set-point event may be off its move."""
HEAD = (
    f"{'kind':8}{'records':>8}{'moves':>7}{'found':>8}{'scored':>8}{'loads':>7}{'found':>8}{'scored':>8}{'false':>7}"
    f"{'gains':>7}{'in':>7}{'half':>7}{'wide':>7}{'s':>6}"
)


@dataclass
class Tally:
    """What became of a kind's records."""

    kind: str
    records: int = 0
    wanted: dict[str, int] = field(default_factory=lambda: {"setpoint": 0, "load": 0})
    found: dict[str, int] = field(default_factory=lambda: {"setpoint": 0, "load": 0})
    scored: dict[str, int] = field(default_factory=lambda: {"setpoint": 0, "load": 0})
    false: list[Assessment] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)
    halves: list[float] = field(default_factory=list)
    inside: int = 0
    seconds: float = 0.0


def watch(kind: str, loops: int, seed: int) -> Tally:
    """Run the records of a kind through an engine of their own each."""
    tally, began = Tally(kind), time.perf_counter()
    for number in range(loops):
        record = draw(kind, number, seed)
        engine = Engine(LoopTable(table_of([record.spec], process="auto")))
        records = [*engine.step(record.samples), *engine.flush()]
        _count(tally, record, [r for r in records if isinstance(r, Assessment)])
    tally.seconds = time.perf_counter() - began
    return tally


def _count(tally: Tally, record: Record, assessments: list[Assessment]) -> None:
    """Give each move and each load the nearest event of its kind."""
    tally.records += 1
    period = record.spec.true_period
    ramp = 0.1 / record.spec.setpoint_rate if record.spec.setpoint_rate else 0.0  # its begin drowns in noise
    reach = {
        "setpoint": max(NEAR_PERIODS * period, ramp),
        "load": max(2.0 * record.spec.plant.t0, 5 * period),
    }
    free = list(assessments)
    for kind, times in (("setpoint", record.setpoints), ("load", record.loads)):
        for at in times:
            near = [a for a in free if a.kind == kind and abs(a.start - at) <= reach[kind] * 1e9]
            tally.wanted[kind] += 1
            if not near:
                tally.missed.append(f"{record.spec.name} {kind} at {at}")
                continue
            best = min(near, key=lambda a: abs(a.start - at))
            free.remove(best)
            tally.found[kind] += 1
            tally.scored[kind] += best.ci is not None
    if tally.kind != "slave":
        tally.false += [a for a in free if a.kind != "disturbance"]
    for a in assessments:
        if a.process == "undecided" or a.gain is None or a.gain_lo is None or a.gain_hi is None:
            continue
        if a.process.startswith("integ") != record.spec.plant.integrating:
            continue
        tally.halves.append(abs(a.gain_hi - a.gain_lo) / 2.0 / abs(a.gain))
        tally.inside += a.gain_lo <= record.spec.plant.gain <= a.gain_hi


def table_line(t: Tally) -> str:
    """One row of the table."""

    def share(part: int, whole: int) -> str:
        return f"{100.0 * part / whole:7.1f}%" if whole else f"{'':8}"

    line = f"{t.kind:8}{t.records:8d}"
    for kind in ("setpoint", "load"):
        line += (
            f"{t.wanted[kind]:7d}{share(t.found[kind], t.wanted[kind])}{share(t.scored[kind], t.found[kind])}"
        )
    halves = np.array(t.halves or [np.nan])
    line += f"{len(t.false) / max(t.records, 1):7.2f}{len(t.halves):7d}{100 * t.inside / len(halves):6.1f}%"
    return line + f"{100 * np.median(halves):6.1f}%{100 * np.mean(halves > 0.15):6.1f}%{t.seconds:6.0f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the kinds asked for and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--kind", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--loops", type=int, default=100)
    parser.add_argument("--seed", type=int, default=20_121_112)
    parser.add_argument("--show", type=int, default=0, help="describe this many of what is false or missed")
    args = parser.parse_args(arguments)
    print(HEAD)
    for name in args.kind:
        tally = watch(name, args.loops, args.seed)
        print(table_line(tally), flush=True)
        for a in tally.false[: args.show]:
            print(
                f"  false: {a.loop} {a.kind} {a.start} {a.state} {a.amplitude:.3g} fit {a.fit} ci {a.ci} {a.reason}"
            )
        for text in tally.missed[: args.show]:
            print(f"  missed: {text}")


if __name__ == "__main__":
    main()
