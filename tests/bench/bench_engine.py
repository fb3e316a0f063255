"""Samples a second of the kernel beside a floor, and milliseconds for each assessed event.

``python -m tests.bench.bench_engine``. The floor is a bare compiled loop that reads the same columns.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numba
import numpy as np

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.engine import Engine
from sim_plants.fleet import random_fleet
from sim_plants.loops import Simulation
from tests.support.plants import samples_of, table_of, times

ROUNDS = 5


@numba.njit
def _floor(loop, time, sp, pv, op, auto, quality):  # type: ignore[no-untyped-def]
    """Read every column once."""
    total = 0.0
    for k in range(len(time)):
        if auto[k] and quality[k] > 0:
            total += sp[k] - pv[k] + op[k] + (time[k] & 1) + loop[k]
    return total


def best(run: Callable[[], object]) -> float:
    """Shortest of some runs [s]."""
    took = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        run()
        took.append(time.perf_counter() - start)
    return min(took)


def quiet(loops: int, n: int) -> Samples:
    """Samples of quiet loops, noise only, interleaved in time."""
    rng = np.random.default_rng(0)
    pv = 50 + rng.normal(0, 0.1, n * loops)
    loop, at = np.tile(np.arange(loops, dtype=np.int32), n), np.repeat(times(n), loops)
    return Samples.of(loop, at, 50.0, pv, 30.0)


def rate(name: str, loops: int, n: int) -> None:
    """Print the kernel's rate on quiet data and its ratio to the floor; and its rate while the loops' memory is new."""
    samples, m = quiet(loops, n), n * loops
    columns = (samples.loop, samples.time, samples.sp, samples.pv, samples.op, samples.auto, samples.quality)
    _floor(*columns)
    floor = best(lambda: _floor(*columns))
    names = [Loop(name=str(k)) for k in range(loops)]
    Detector(names[:1]).run(samples.take(slice(0, 1)))
    detector, took = Detector(names), []
    for _ in range(1 + ROUNDS):
        start = time.perf_counter()
        detector.run(samples)
        took.append(time.perf_counter() - start)
        detector.take_blocks(), detector.take_stretches()
        samples.time[:] += n * 10**9
    first, kernel = took[0], min(took[1:])
    rates = f"{1e-6 * m / kernel:5.1f} M samples/s ({1e-6 * m / first:.1f} at first)"
    print(f"{name:28s} {rates}, floor {1e-6 * m / floor:7.1f}, ratio {kernel / floor:.1f}")


def events() -> None:
    """Print what an assessed event costs, fit, intervals, verdict and suggestion included."""
    specs = random_fleet(60, 2, noise=(0.005, 0.01), period=1.0)
    samples = samples_of(Simulation(specs).advance(6000.0))
    for name, facts in (("settings known", {}), ("settings not known", {"kp": None, "ki": None, "kd": None})):
        engine = Engine(LoopTable(table_of(specs, **facts)))
        engine.detect(samples)
        engine.assess(3)
        took = []
        while engine.backlog:
            start = time.perf_counter()
            engine.assess(1)
            took.append(1e3 * (time.perf_counter() - start))
        median, p99 = np.percentile(took, [50, 99])
        print(f"{name:28s} {median:7.1f} ms an event in the median, {p99:.1f} ms p99, {len(took)} events")


if __name__ == "__main__":
    rate("one loop, a million samples", 1, 1_000_000)
    rate("1,000 loops, frames", 1000, 1000)
    rate("100,000 loops, frames", 100_000, 20)
    events()
