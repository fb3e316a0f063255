"""Loops that step, and their records plain."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.contract.samples import Samples
from tests.support.plants import pi_loop, times


def stepped(n: int = 900, at: int = 200, size: float = 4.0, **facts: Any) -> Samples:
    sp = np.full(n, 50.0)
    sp[at:] += size
    pv, op = pi_loop(sp, **facts)
    return Samples.of(0, times(n), sp, pv, op)
