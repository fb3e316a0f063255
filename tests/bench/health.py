"""The benchmark of the health figures: right or wrong by kind of loop, by sampling, by archive; and what they cost.

``python -m tests.bench.health [--loops N] [--seed S] [--slow N]``. Fleets: `health_fleet`. The table of kinds has the
truth in its rows; what the figures say in its columns. The table of samplings has the same simulated loops, scanned
every second with closed loops twenty times slower, as seen every 1, 2, 5 and 10 s: share of the loops whose figure
stays within 5 % of that at 1 s, the median and the largest deviation, and the share withheld.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.health.loop_health import SATURATED_SHARE, Health, figures
from sim_plants.loops import Block, Simulation
from sim_plants.plants import Process
from sim_plants.specs import LoopSpec, Steps
from tests.bench.health_archive import held, interpolated, reports, swinging_door
from tests.bench.health_fleet import CLASSES, Case, draw

SEED = 20_261_122
"""Held out: named here and nowhere else."""
KINDS = ("healthy", "stiction", "oscillating")
RIGHT = {
    "healthy": "healthy",
    "sticking": "stiction",
    "sinusoidal": "oscillating",
    "aggressive": "oscillating",
}
PROCESSES: tuple[Process, ...] = ("integrating", "self-regulating")
SAMPLINGS = (1, 2, 5, 10)
SLOWER = 20.0
INVARIANT = ("oscillation_period", "mean_abs_e", "saturation", "manual", "offset", "travel_per_hour")
NEAR = 0.05


def health_of(block: Block, spec: LoopSpec | None = None, every: int = 1) -> Health:
    """Return the figures of one loop's samples, or of every n-th of them."""
    loop = Loop(name="x")
    if spec is not None and math.isfinite(spec.controller.op_low):
        loop = Loop(name="x", op_low=spec.controller.op_low, op_high=spec.controller.op_high)
    detector = Detector([loop])
    part = block.rows(slice(None, None, every))
    detector.run(Samples.of(0, part.time_ns, part.sp, part.pv, part.op, part.auto))
    return figures(detector.health[0], float(detector.state["clock"]["period"][0]))


def kind_of(health: Health) -> str:
    """Say what the figures say."""
    if not health.oscillating:
        return "healthy"
    return "stiction" if (health.stiction or 0.0) >= 0.5 else "oscillating"


def confusion(loops: int, seed: int) -> dict[tuple[Process, str], Counter[str]]:
    """Count what is said of each kind of loop; half of the limit cycles' limits are not in the loop table."""
    found: dict[tuple[Process, str], Counter[str]] = {}
    for process in PROCESSES:
        for truth in CLASSES:
            cases = (draw(truth, process, k, seed) for k in range(loops))
            said = [kind_of(health_of(c.block, c.spec if k % 2 else None)) for k, c in enumerate(cases)]
            found[process, truth] = Counter(said)
    return found


def share_right(found: dict[tuple[Process, str], Counter[str]], process: Process) -> float:
    """Return the share of a kind of process's loops that are called what they are."""
    own = {truth: count for (p, truth), count in found.items() if p == process}
    return sum(c[RIGHT[t]] for t, c in own.items()) / sum(c.total() for c in own.values())


def slowed(spec: LoopSpec, factor: float) -> LoopSpec:
    """Return the same loop, slower by a factor, at the same scan."""
    plant, own = spec.plant, spec.controller
    gain = plant.gain / factor if plant.integrating else plant.gain

    def later(steps: Steps) -> Steps:
        return Steps(tuple(t * factor for t in steps.times), steps.sizes, steps.repeat * factor)

    return replace(
        spec,
        plant=replace(
            plant, gain=gain, dead_time=plant.dead_time * factor, lags=tuple(t * factor for t in plant.lags)
        ),
        controller=replace(own, ti=own.ti * factor, td=own.td * factor),
        setpoint=later(spec.setpoint),
        load=later(spec.load),
        modes=later(spec.modes),
        wander=spec.wander / math.sqrt(factor),
    )


def slow_loops(loops: int, seed: int) -> Iterator[tuple[LoopSpec, Block]]:
    """Make slow loops of each kind; of the healthy ones, one in three is in manual at times, one without integral."""
    for process in PROCESSES:
        for truth in CLASSES:
            for k in range(loops):
                case: Case = draw(truth, process, 1000 + k, seed)
                spec = case.spec
                if truth == "healthy" and k % 3 == 1:
                    spec = replace(spec, modes=Steps((2000.0, 3500.0), (-1.0, 1.0), 4000.0))
                if truth == "healthy" and k % 3 == 2:
                    spec = replace(
                        spec,
                        controller=replace(spec.controller, ti=math.inf),
                        load=Steps((10.0,), (5.0,)),
                        setpoint=Steps(),
                    )
                spec = slowed(spec, SLOWER)
                yield spec, Simulation([spec]).advance(8000 * SLOWER)


def deviations(loops: int, seed: int) -> dict[tuple[str, int], list[float | None]]:
    """Return each figure's relative deviation at each sampling from that at 1 s; None where either is withheld."""
    found: dict[tuple[str, int], list[float | None]] = {}
    for spec, block in slow_loops(loops, seed):
        seen = {every: health_of(block, spec, every) for every in SAMPLINGS}
        for name in INVARIANT:
            reference = getattr(seen[1], name)
            if reference is None and name == "oscillation_period" and not seen[1].oscillating:
                continue
            if reference is not None and abs(reference) <= _least(name, seen[1]):
                continue
            for every in SAMPLINGS[1:]:
                value = getattr(seen[every], name)
                off = None if value is None or reference is None else abs(value / reference - 1.0)
                found.setdefault((name, every), []).append(off)
    return found


def _least(name: str, health: Health) -> float:
    """Return below what a figure is as good as zero: a relative deviation of it says nothing."""
    if name == "offset":
        return 0.5 * (health.mean_abs_e or 0.0)
    return {"saturation": 0.01, "manual": 0.01}.get(name, 0.0)


def archived() -> Iterator[tuple[str, float, float | None, float | None]]:
    """Yield signal, compression ratio, and the figure for interpolated and for raw archive data."""
    rng = np.random.default_rng(5)
    n, t = 20_000, np.arange(20_000)
    flow = 50.0 + 0.5 * rng.normal(size=n)
    level = 50.0 + lfilter([1.0], [1.0, -0.99], rng.normal(size=n)) * 0.14
    wave = 50.0 + np.sin(2 * np.pi * t / 60.0) + 0.05 * rng.normal(size=n)
    for name, pv in (("noisy flow", flow), ("sluggish level", level), ("oscillation", wave)):
        for deviation in (0.1, 0.25, 0.5, 1.0):
            kept = swinging_door(pv, deviation)
            yield f"{name}, {deviation:g} %", n / len(kept), *_compression(pv, interpolated(pv, kept), kept)
        kept = reports(pv, 0.5)
        yield f"{name}, held within 0.5 %", n / len(kept), *_compression(pv, held(pv, kept), kept)
        rounded = np.round(pv / 0.1) * 0.1
        yield f"{name}, raw in steps of 0.1", 1.0, *_compression(rounded, rounded, np.arange(n))
        yield f"{name}, raw", 1.0, *_compression(pv, pv, np.arange(n))


def _compression(pv: np.ndarray, shown: np.ndarray, kept: np.ndarray) -> tuple[float | None, float | None]:
    def of(values: np.ndarray, at: np.ndarray) -> float | None:
        detector = Detector([Loop(name="x")])
        detector.run(Samples.of(0, at.astype(np.int64) * 1_000_000_000, 50.0, values, values))
        return figures(detector.health[0], float(detector.state["clock"]["period"][0])).compression

    return of(shown, np.arange(len(pv))), of(pv[kept], kept)


def cost(n: int = 1_000_000) -> float:
    """Return the kernel's time for a sample of a quiet loop [ns]."""
    rng = np.random.default_rng(0)
    columns = 50.0 + rng.normal(0, 0.1, n), 30.0 + rng.normal(0, 0.1, n)
    samples = Samples.of(0, np.arange(n) * 1_000_000_000, 50.0, *columns)
    took = []
    for _ in range(4):
        detector = Detector([Loop(name="x")])
        start = time.perf_counter()
        detector.run(samples)
        took.append(time.perf_counter() - start)
    return min(took) / n * 1e9


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--loops", type=int, default=100, help="loops of each kind")
    parser.add_argument("--slow", type=int, default=6, help="slow loops of each kind, for the samplings")
    parser.add_argument("--seed", type=int, default=SEED)
    args = parser.parse_args()
    found = confusion(args.loops, args.seed)
    for process in PROCESSES:
        print(f"{process:16s}" + "".join(f"{k:>13s}" for k in KINDS))
        for truth in CLASSES:
            row = found[process, truth]
            print(f"  {truth:14s}" + "".join(f"{row[k]:13d}" for k in KINDS))
        print(f"  right: {100 * share_right(found, process):.1f} %")
    print(f"\n{'figure':20s}  at  loops  within 5 %  median   worst  withheld")
    for (name, every), off in deviations(args.slow, args.seed).items():
        known = np.array([d for d in off if d is not None])
        near, middle, worst = (known <= NEAR).mean(), np.median(known), known.max()
        print(
            f"{name:20s} {every:2d} s {len(off):5d} {100 * near:9.0f} % {100 * middle:6.2f} % {100 * worst:6.1f} %"
            f" {100 * (1 - len(known) / len(off)):6.0f} %"
        )
    print(f"\n{'signal and archive':32s}  ratio  shown   raw")
    for name, ratio, shown, raw in archived():
        print(f"{name:32s} {ratio:6.1f} {_two(shown):>6s} {_two(raw):>6s}")
    print(f"\n{cost():.0f} ns a sample, the whole kernel; limit of saturation {SATURATED_SHARE:g}")


def _two(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


if __name__ == "__main__":
    sys.exit(main())
