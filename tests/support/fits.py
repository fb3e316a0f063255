"""A fit as the tests of what comes after it need one."""

from __future__ import annotations

import numpy as np

from monitor.identify.fit import Fit
from tuners.models import INTEGRATING


def make_fit(
    gain: float = 0.05,
    lag: float = 2.0,
    dead_time: float = 4.0,
    sd: tuple[float, float, float] = (0.02, 0.2, 0.2),
    process: str = INTEGRATING,
    log_likelihood: float = 100.0,
    lag2: float = 0.0,
) -> Fit:
    return Fit(
        process=process,
        gain=gain,
        lag=lag,
        dead_time=dead_time,
        lag2=lag2,
        scatter=np.diag(np.square(sd)),
        floor=np.array([1e-4, 0.01, 0.01]),
        quality=0.99,
        log_likelihood=log_likelihood,
        sigma=0.01,
    )
