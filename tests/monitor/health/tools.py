"""Samples of a loop, and the figures that come of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.contract.loops import Loop
from monitor.contract.samples import Samples
from monitor.detect.detector import Detector
from monitor.health.loop_health import Health, figures
from tests.support.plants import SECOND, START

Array = NDArray[np.float64]
N = 3000


def noise(n: int = N, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=n)


def samples_of(sp: Any, pv: Any, op: Any, auto: Any = None, period: float = 1.0, time: Any = None) -> Samples:
    """Samples of loop 0, regular unless times [s] are given."""
    n = max(np.size(v) for v in (sp, pv, op))
    seconds = np.arange(n) * period if time is None else np.asarray(time)
    at = START + np.round(seconds * SECOND).astype(np.int64)
    return Samples.of(0, at, *(np.broadcast_to(v, (n,)) for v in (sp, pv, op)), auto)


def run(samples: Samples, chunk: int | None = None, **facts: Any) -> Detector:
    detector = Detector([Loop(name="L", **facts)])
    size = len(samples) if chunk is None else chunk
    for k in range(0, len(samples), max(size, 1)):
        detector.run(samples.take(slice(k, k + size)))
    return detector


def look(detector: Detector, dead_time: float | None = None) -> Health:
    return figures(detector.health[0], float(detector.state["clock"]["period"][0]), dead_time)


def health(
    sp: Any, pv: Any, op: Any, auto: Any = None, dead_time: float | None = None, **more: Any
) -> Health:
    """Figures of one loop; ``more``: period, time, and facts of the loop table."""
    shape = {k: more.pop(k) for k in ("period", "time") if k in more}
    return look(run(samples_of(sp, pv, op, auto, **shape), **more), dead_time)


def mixed(n: int = 2500, seed: int = 4) -> Samples:
    """A loop with everything: oscillation, steps of SP, manual, a gap, missed samples, repeated values."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([1.0, 1.0, 1.0, 1.0, 2.0], n)) + 500.0 * (np.arange(n) > n // 2)
    sp = 50 + 2.0 * (np.arange(n) % 700 > 350)
    e = np.sin(2 * np.pi * t / 33) + 0.2 * rng.normal(size=n)
    pv = np.round((sp - e) / 0.05) * 0.05
    auto = np.arange(n) % 900 < 800
    return samples_of(sp, pv, 30 + 3 * e, auto, time=t)
