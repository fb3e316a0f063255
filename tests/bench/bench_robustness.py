"""Evaluations of Ms a second on one core, beside the floor: bare complex arithmetic on a grid of the same size.

Run: python -m tests.bench.bench_robustness [--loops N]
"""

import argparse
import time

import numpy as np

from tuners.loops import LOG_POINTS
from tuners.models import IntegratingModel, SelfRegulatingModel
from tuners.responses import closed_loop_response
from tuners.robustness import margins, peak_sensitivity
from tuners.settings import Settings

GOAL = 20_000  # evaluations of Ms a second


def fleet(count, seed=1):
    """Integrating loops under series PID, integrating under PI, self-regulating under standard PID; detuned."""
    rng = np.random.default_rng(seed)
    theta = 10 ** rng.uniform(-1, 2, count)
    lag = theta * 10 ** rng.uniform(-1, 1, count)
    tight = 0.5 * 10 ** rng.uniform(-0.8, 0.3, count)
    integrating = IntegratingModel(1 / theta, theta, lag)
    return {
        "PID, integrating": (integrating, Settings(tight, 8 * theta, lag, lag / 10, "series")),
        "PI, integrating": (IntegratingModel(1 / theta, theta), Settings(tight, 8 * theta)),
        "PID, self-regulating": (
            SelfRegulatingModel(1.0, theta, lag),
            Settings(
                tight * (2 * lag + theta) / theta,
                lag + theta / 2,
                d := lag * theta / (2 * lag + theta),
                d / 10,
            ),
        ),
    }


def rate(function, count, seconds=1.0):
    """Loops a second: the best of repeated runs, as others may use the machine."""
    best, end = 0.0, time.perf_counter() + seconds
    while True:
        start = time.perf_counter()
        function()
        now = time.perf_counter()
        best = max(best, count / (now - start))
        if now > end:
            return best


def bare_grid(model, settings):
    """Return the floor: 1/abs(1 + C P) once on LOG_POINTS frequencies a loop, no search, no stability."""
    omega = np.geomspace(0.01, 10, LOG_POINTS)[:, np.newaxis] / model.dead_time
    return (1 / np.abs(1 + model.frequency_response(omega) * settings.frequency_response(omega))).max(axis=0)


def main():
    """Print the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=4096)
    count = parser.parse_args().loops
    for name, (model, settings) in fleet(count).items():
        ms = rate(lambda m=model, s=settings: peak_sensitivity(m, s), count)
        full = rate(lambda m=model, s=settings: margins(m, s), count)
        floor = rate(lambda m=model, s=settings: bare_grid(m, s), count)
        print(
            f"{name:22} Ms {ms:8.0f}/s (goal {GOAL}), all margins {full:8.0f}/s, "
            f"bare grid of {LOG_POINTS} points {floor:8.0f}/s, ratio {floor / ms:.2f}"
        )
    one = (IntegratingModel(1.0, 1.0), Settings(0.5, 8.0))
    single = rate(lambda: peak_sensitivity(*one), 1)
    response = rate(lambda: closed_loop_response(*one), 1)
    print(f"one loop by itself     Ms {1e3 / single:.2f} ms, response with IAE {1e3 / response:.2f} ms")


if __name__ == "__main__":
    main()
