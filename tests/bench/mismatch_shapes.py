"""Plants of the benchmark `mismatch`, by the name of their shape; times scale with a dead time drawn before."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from tests.bench.mismatch_plant import INTEGRATING, SELF, Plant, chain, lag, swing

Rng = np.random.Generator


def log(rng: Rng, low: float, high: float) -> float:
    """Draw a number, its logarithm evenly."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def half_rule(dead_time: float, lags: Sequence[float], inverse: float = 0.0) -> tuple[float, float]:
    """Return effective dead time and retained lag [s] (Skogestad 2003, section 2)."""
    first, second = (*sorted(lags, reverse=True), 0.0, 0.0)[:2]
    kept = first + second / 2
    return dead_time + sum(lags) + inverse - kept, kept


def simple(process: str, gain: float, dead: float, lags: Sequence[float], inverse: float = 0.0) -> Plant:
    """Return a plant of lags and a dead time, with an inverse response of a time [s] or none."""
    theta, kept = half_rule(dead, lags, inverse)
    blocks = [lag(x, -inverse if k == 0 else 0.0) for k, x in enumerate(lags)]
    space = chain(gain, process == INTEGRATING, *blocks)
    return Plant(process, space, dead, theta, kept, gain, {process: (gain, gain)})


def integrating(rng: Rng, dead: float, gain: float) -> Plant:
    return simple(INTEGRATING, gain, dead, [dead * log(rng, 0.1, 6.3) for _ in range(rng.integers(0, 4))])


def self_regulating(rng: Rng, dead: float, gain: float) -> Plant:
    first = dead * log(rng, 1.0, 30.0)
    second = first * rng.uniform(0.0, 0.3)
    return simple(SELF, 1e2 * gain, dead, [first, second] if second > 0.01 * first else [first])


def either(rng: Rng, dead: float, gain: float) -> Plant:
    return (self_regulating if rng.random() < 1 / 3 else integrating)(rng, dead, gain)


def slow_lag(rng: Rng, dead: float, gain: float) -> Plant:
    return simple(SELF, 1e2 * gain, dead, [dead * log(rng, 5.0, 30.0)])


def high_order(rng: Rng, dead: float, gain: float) -> Plant:
    each, order = dead * log(rng, 0.5, 3.0), int(rng.integers(4, 7))
    lags = [each * log(rng, 0.7, 1.4) for _ in range(order)]
    return simple(INTEGRATING if rng.random() < 0.5 else SELF, gain, dead, lags)


def dead_time_only(rng: Rng, dead: float, gain: float) -> Plant:
    return simple(SELF, 1e2 * gain, dead, [dead * log(rng, 0.05, 0.5)])


def inverse(rng: Rng, dead: float, gain: float) -> Plant:
    process = INTEGRATING if rng.random() < 0.5 else SELF
    lags = [dead * log(rng, 0.5, 6.0) for _ in range(2 if process == SELF else rng.integers(1, 3))]
    return simple(process, gain, dead, lags, dead * log(rng, 0.3, 3.0))


def lead(rng: Rng, dead: float, gain: float) -> Plant:
    lags = [dead * log(rng, 1.0, 6.0), dead * log(rng, 0.5, 6.0)]
    zero = lags[0] * log(rng, 0.3, 3.0)
    process = INTEGRATING if rng.random() < 0.5 else SELF
    space = chain(gain, process == INTEGRATING, lag(lags[0], zero), lag(lags[1]))
    theta, kept = half_rule(dead, lags)
    return Plant(process, space, dead, theta, kept, gain, {process: (gain, gain)}, half_rule=False)


def leak(rng: Rng, dead: float, gain: float) -> Plant:
    """Return a vessel that empties itself by and by: an integrator for as long as one event lasts, nearly."""
    tau = dead * log(rng, 20.0, 200.0)
    lags = [dead * log(rng, 0.1, 2.0)] if rng.random() < 0.5 else []
    theta, kept = half_rule(dead, lags)
    full = gain * tau
    gains = {INTEGRATING: (gain, gain), SELF: (full, full)}
    space = chain(full, False, lag(tau), *map(lag, lags))
    return Plant(SELF, space, dead, theta, kept, gain, gains, half_rule=False, ruled=INTEGRATING)


def two_lags(rng: Rng, dead: float, gain: float) -> Plant:
    first = dead * log(rng, 5.0, 30.0)
    return simple(SELF, 1e2 * gain, dead, [first, first * rng.uniform(0.3, 1.0)])


def _resonant(rng: Rng, dead: float, gain: float, zeta: float) -> Plant:
    lags = [dead * log(rng, 0.1, 3.0)] if rng.random() < 0.5 else []
    omega = log(rng, 1.0, 10.0) / (dead + sum(lags))
    process = INTEGRATING if not lags or rng.random() < 2 / 3 else SELF
    theta, kept = half_rule(dead + 2 * zeta / omega, lags)
    space = chain(gain, process == INTEGRATING, *map(lag, lags), swing(omega, zeta))
    return Plant(process, space, dead, theta, kept, gain, {process: (gain, gain)}, half_rule=False)


def resonance_narrow(rng: Rng, dead: float, gain: float) -> Plant:
    return _resonant(rng, dead, gain, 0.03)


def resonance_broad(rng: Rng, dead: float, gain: float) -> Plant:
    return _resonant(rng, dead, gain, 0.2)


def resonance_hidden(rng: Rng, dead: float, gain: float) -> Plant:
    """Return an integrator with a small mode beside it that a slow loop does not excite."""
    omega = log(rng, 1.0, 5.0) / dead
    mode = swing(omega, 0.03, rng.uniform(0.1, 0.4) * gain / omega)
    space = chain(gain, True).beside(mode)
    gains = {INTEGRATING: (gain, gain)}
    return Plant(INTEGRATING, space, dead, dead, 0.0, gain, gains, half_rule=False)


def recycle(rng: Rng, dead: float, gain: float) -> Plant:
    """Return a process whose product heats its own feed: slow tail, higher gain."""
    k, tau, share = 1e2 * gain, dead * log(rng, 1.0, 10.0), rng.uniform(0.3, 0.8)
    space = chain(k, False, lag(tau)).recycled(chain(share / k, False, lag(tau * log(rng, 1.0, 5.0))))
    full = k / (1 - share)
    return Plant(SELF, space, dead, dead, tau, k, {SELF: (full, full)}, half_rule=False)


def gain_and_integrator(rng: Rng, dead: float, gain: float) -> Plant:
    """Return an integrator with a quick part beside it, as of a level that flashes."""
    quick = dead * log(rng, 0.5, 5.0) * rng.choice([-0.3, 1.0])
    space = chain(gain, True).beside(chain(gain * quick, False, lag(dead * log(rng, 0.2, 2.0))))
    gains = {INTEGRATING: (gain, gain)}
    return Plant(INTEGRATING, space, dead, dead + max(-quick, 0.0), 0.0, gain, gains, half_rule=False)


def underdamped(rng: Rng, dead: float, gain: float) -> Plant:
    k, zeta, omega = 1e2 * gain, rng.uniform(0.2, 0.6), 1 / (dead * log(rng, 1.0, 5.0))
    return Plant(
        SELF, chain(k, False, swing(omega, zeta)), dead, dead + 1 / omega, 2 * zeta / omega, k,
        {SELF: (k, k)}, half_rule=False,
    )  # fmt: skip


SHAPES: dict[str, Callable[[Rng, float, float], Plant]] = {
    function.__name__: function
    for function in (
        *(integrating, self_regulating, either, slow_lag, high_order, dead_time_only, inverse, lead, leak),
        *(two_lags, resonance_narrow, resonance_broad, resonance_hidden, recycle, gain_and_integrator),
        underdamped,
    )
}
