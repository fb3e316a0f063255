"""Random loops that several tests share."""

import math

import numpy as np

from tuners.models import IntegratingModel, SelfRegulatingModel
from tuners.settings import Settings


def draw_loops(count, seed, hard=False, quick=False):
    """Random loops of every kind: P, PI, PD, PID in every form on integrating and self-regulating models.

    `hard`: up to far too tight; `quick`: with integral action, settling within some 100 dead times.
    """
    rng = np.random.default_rng(seed)
    loops = []
    while len(loops) < count:
        theta = 10 ** rng.uniform(-1, 2)
        lag, lag2 = theta * 10 ** rng.uniform(-1, 0.7 if quick else 1.3, 2) * (rng.random(2) > 0.3)
        gain = 10 ** rng.uniform(-2, 2) * rng.choice([-1, 1])
        tight = 10 ** rng.uniform(-0.4 if quick else -1.5, 0.3 if hard else 0.05)
        if rng.random() < 0.5:
            model = IntegratingModel(gain, theta, lag)
            kp = tight / (2 * gain * theta)
        else:
            model = SelfRegulatingModel(gain, theta, lag + 0.05 * theta, lag2)
            kp = tight * (model.lag + theta) / (2 * gain * theta)
        ti = (
            math.inf
            if rng.random() < 0.2 and not quick
            else theta * 10 ** rng.uniform(0.3, 1.1 if quick else 1.5)
        )
        td = theta * 10 ** rng.uniform(-1, 0.5) * (rng.random() > 0.4)
        form = str(rng.choice(["standard", "series", "parallel"]))
        loops.append((model, Settings(kp, ti, td, td / rng.uniform(4, 20), form)))
    return loops
