"""A step that is assessed."""

from __future__ import annotations

from typing import Any

from monitor.contract.loops import Loop
from monitor.contract.records import Assessment
from monitor.contract.samples import Samples
from monitor.engine import Engine
from tests.support.runs import Seen, run


def assessed(samples: Samples, **facts: Any) -> tuple[Assessment, Engine, Seen]:
    engine, seen = run(Loop(**({"name": "L", "kp": 2.0, "ti": 40.0} | facts)), samples)
    return next(a for a in seen.assessments if a.kind == "setpoint"), engine, seen
