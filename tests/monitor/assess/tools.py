"""A step that is assessed."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import Assessment
from monitor.contract.samples import Samples
from monitor.engine import Engine
from tests.support.plants import pi_loop, times
from tests.support.runs import Seen, run


def stepped(n: int = 900, at: int = 200, size: float = 4.0, **facts: Any) -> Samples:
    sp = np.full(n, 50.0)
    sp[at:] += size
    pv, op = pi_loop(sp, **facts)
    return Samples.of(0, times(n), sp, pv, op)


def assessed(samples: Samples, **facts: Any) -> tuple[Assessment, Engine, Seen]:
    engine, seen = run(Loop(**({"name": "L", "kp": 2.0, "ti": 40.0} | facts)), samples)
    return next(a for a in seen.assessments if a.kind == "setpoint"), engine, seen
