"""Fleets of loops as a plant has them, drawn from a seed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from sim_plants.controllers import Controller, Form
from sim_plants.margins import settling_time
from sim_plants.plants import Plant, Process
from sim_plants.settings import TUNINGS, draw, robust_simc, simc
from sim_plants.specs import LoopSpec, Objective, Steps
from sim_plants.truth import loop_table, truth_events, truth_rows

__all__ = ["MIX", "loop_table", "random_fleet", "schedules", "truth_events", "truth_rows"]

MIX: Mapping[str, float] = dict(zip(TUNINGS, (0.45, 0.22, 0.09, 0.09, 0.15), strict=True))
"""Share of each tuning in a fleet."""


@dataclass(frozen=True)
class _Kind:
    """What loops of a kind have in common; ranges are (low, high)."""

    letter: str  # first letter of the tag, ISA-5.1
    share: float
    process: Process
    dead_time: tuple[float, float]  # [s], logarithmic
    lags: tuple[int, int]  # number of them
    lag_ratio: tuple[float, float]  # sum of the lags over dead time, logarithmic
    ranges: tuple[tuple[float, float, str], ...]  # pv_low, pv_high, unit


_VESSEL = ((0.0, 100.0, "%"), (0.0, 2.5, "m"), (0.0, 8.0, "m"), (0.0, 1500.0, "mm"))
_PRESSURE = ((0.0, 6.0, "bar"), (0.0, 40.0, "bar"), (0.0, 600.0, "kPa"))
_TEMPERATURE = ((0.0, 150.0, "degC"), (50.0, 400.0, "degC"), (250.0, 700.0, "K"))
_FLOW = ((0.0, 80.0, "m3/h"), (0.0, 1200.0, "m3/h"), (0.0, 25000.0, "kg/h"), (0.0, 5.0, "t/h"))
_KINDS = (
    _Kind("L", 0.40, "integrating", (1.5, 25.0), (0, 2), (0.1, 3.0), _VESSEL),
    _Kind("P", 0.15, "integrating", (1.0, 8.0), (0, 2), (0.1, 4.0), _PRESSURE),
    _Kind("T", 0.13, "integrating", (4.0, 50.0), (1, 3), (0.3, 6.0), _TEMPERATURE),
    _Kind("F", 0.17, "self-regulating", (1.0, 4.0), (1, 2), (0.5, 5.0), _FLOW),
    _Kind("T", 0.15, "self-regulating", (4.0, 50.0), (1, 3), (1.0, 12.0), _TEMPERATURE),
)

_FORMS: tuple[Form, ...] = get_args(Form)

# Loops in one area of a plant, which the hundreds of their tags count.
_AREA_LOOPS = 20
# SIMC gain of integrating loops [% OP / % PV], gain of the other processes [% PV / % OP], logarithmic.
_FACEPLATE_GAIN = (0.3, 10.0)
_STATIC_GAIN = (0.5, 3.0)
# Largest jump of OP that a set-point step gives, and largest load step [% OP].
_LARGEST_JUMP, _LARGEST_LOAD = 25.0, 15.0
# Steps are this many settling times apart.
_APART = (1.2, 1.8)


def random_fleet(
    n: int,
    seed: int,
    *,
    noise: tuple[float, float] = (0.0, 0.01),
    period: float | None = None,
    mix: Mapping[str, float] = MIX,
) -> list[LoopSpec]:
    """Draw loops: levels, pressures, flows, temperatures, well and badly tuned, all stable.

    Steps of set point and load follow each other when the loop has had time to settle, for ever.

    Parameters
    ----------
    n : int
        Number of loops.
    seed : int
        The same seed gives the same loops, and the first loops of a larger fleet are those of a smaller.
    noise : (float, float)
        Least and largest standard deviation of the noise, as a share of the set-point step.
    period : float or None
        Sample period of all loops; None for 1 s, and 2 or 5 s where the dead time allows [s].
    mix : mapping of str to float
        Share of each tuning of `settings.TUNINGS`.

    Raises
    ------
    ValueError
        If `n` is below 1.
    """
    if n < 1:
        raise ValueError(f"n: {n!r}, expected a number of loops, 1 or more")
    streams = np.random.SeedSequence(seed).spawn(n)
    return [_loop(np.random.default_rng(streams[i]), i, noise, period, mix) for i in range(n)]


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _round(value: float) -> float:
    """Round to three digits, as numbers on a faceplate are."""
    return float(f"{value:.3g}")


def _loop(
    rng: np.random.Generator,
    i: int,
    noise: tuple[float, float],
    period: float | None,
    mix: Mapping[str, float],
) -> LoopSpec:
    kind = _KINDS[rng.choice(len(_KINDS), p=[kind.share for kind in _KINDS])]
    low, high, unit = kind.ranges[rng.integers(len(kind.ranges))]
    span = high - low
    plant = _plant(rng, kind, span)
    dead_time = plant.half_rule()[0]
    if period is None:
        period = float(rng.choice([p for p in (1.0, 1.0, 2.0, 5.0) if p <= max(1.0, dead_time / 4)]))
    tuning = str(rng.choice(list(mix), p=np.array(list(mix.values())) / sum(mix.values())))
    if tuning == "rolling" and not plant.integrating:
        tuning = "sluggish"
    base = _base(rng, plant, period)
    settings = draw(rng, plant, period, base, tuning)
    settings = replace(settings, kp=_round(settings.kp), ti=_round(settings.ti), td=_round(settings.td))
    settings = replace(settings, op_low=0.0, op_high=100.0)
    step = _step(rng, plant, settings, span)
    load = min(_round(rng.uniform(0.5, 1.2) * step * abs(settings.kp)), _LARGEST_LOAD)
    objective: Objective = ("both", "setpoint", "load")[rng.choice(3, p=(0.7, 0.1, 0.2))]
    setpoint, loads = schedules(rng, plant, settings, period, (step, load), objective)
    return LoopSpec(
        name=f"{kind.letter}IC-{(i // _AREA_LOOPS + 1) * 100 + i % _AREA_LOOPS + 1}",
        plant=plant,
        controller=settings,
        pv0=_round(low + span * rng.uniform(0.35, 0.65)),
        op0=float(np.round(rng.uniform(35.0, 65.0), 1)),
        period=period,
        setpoint=setpoint,
        load=loads,
        noise=step * float(rng.uniform(*noise)),
        seed=int(rng.integers(2**62)),
        objective=objective,
        pv_low=low,
        pv_high=high,
        unit=unit,
        tuning=tuning,
    )


def _plant(rng: np.random.Generator, kind: _Kind, span: float) -> Plant:
    """Draw a plant that its valve can move, and whose gain asks for a usual controller."""
    dead_time = _log(rng, *kind.dead_time)
    count = int(rng.integers(kind.lags[0], kind.lags[1] + 1))
    total = dead_time * _log(rng, *kind.lag_ratio)
    shares = np.sort(rng.dirichlet(np.full(count, 0.7)))[::-1] if count else np.zeros(0)
    lags = tuple(_round(total * max(float(share), 0.02)) for share in shares)
    unit = Plant(kind.process, 1.0, _round(dead_time), lags)
    sign = -1 if rng.random() < 0.4 else 1
    # On an integrator, the range of the gains follows from that of the controllers.
    of_controller, of_process = _log(rng, *_FACEPLATE_GAIN), _log(rng, *_STATIC_GAIN)
    gain = simc(unit, 1.0).kp / of_controller if unit.integrating else of_process
    return replace(unit, gain=_round(sign * gain * span / 100))


def _base(rng: np.random.Generator, plant: Plant, period: float) -> Controller:
    """Draw the structure: PI, or PID where there is a lag worth it, in some form with some weights."""
    lag = plant.half_rule()[1]
    derivative = plant.integrating and lag > 3 * period and rng.random() < 0.5
    if not derivative:
        base = robust_simc(plant, period, form="parallel" if rng.random() < 0.1 else "standard")
        return replace(base, b=0.0) if rng.random() < 0.06 else base
    base = robust_simc(plant, period, derivative=True, form=_FORMS[rng.integers(3)])
    b, c = ((1.0, 1.0), (1.0, 0.0), (0.0, 0.0))[rng.choice(3, p=(0.4, 0.5, 0.1))]
    return replace(base, b=b, c=c)


def _step(rng: np.random.Generator, plant: Plant, settings: Controller, span: float) -> float:
    """Draw a set-point step [PV] that does not drive the output into its limits, at once or in the end."""
    jump = abs(settings.kp) * max(settings.b, settings.c * 10 if settings.td else 0.0, 0.5)
    if not plant.integrating:
        jump = max(jump, 1 / abs(plant.gain))
    return _round(min(span * rng.uniform(0.02, 0.08), _LARGEST_JUMP / jump))


def schedules(
    rng: np.random.Generator,
    plant: Plant,
    settings: Controller,
    period: float,
    sizes: tuple[float, float],
    objective: Objective = "both",
    first: float | None = None,
    apart: tuple[float, float] = _APART,
) -> tuple[Steps, Steps]:
    """Draw steps of set point and load, each when the one before has settled, repeated for ever.

    Parameters
    ----------
    rng : numpy.random.Generator
        Where chance comes from.
    plant, settings, period : Plant, Controller, float
        The loop [s].
    sizes : (float, float)
        Of steps of set point [PV] and load [OP]; a set-point step has between 0.6 and 1 of its own.
    objective : {'setpoint', 'load', 'both'}
        Which kinds there are; with 'both', two set-point steps for a load step.
    first : float or None
        Time of the first step; None for a quiet stretch of 120 to 240 periods, or four times `t0` [s].
    apart : (float, float)
        Least and largest distance of the steps, in settling times.

    Returns
    -------
    setpoint, load : Steps
        They come back to where they began; load steps do not meet samples.
    """
    step, load = sizes
    kinds = {"setpoint": "ssss", "load": "llll"}.get(objective, "ssslsl")
    settle = settling_time(plant, settings, period)
    if first is None:
        first = max(120 * period, 4 * plant.t0) * rng.uniform(1.0, 2.0)
    gaps = settle * rng.uniform(*apart, size=len(kinds))
    times = first + np.concatenate([[0.0], np.cumsum(gaps)])
    repeat = np.ceil((times[-1] - first) / period) * period
    up = step * rng.choice([-1, 1])
    moved = {"s": [up, -up, -up * rng.uniform(0.6, 1.0)], "l": [load * rng.choice([-1, 1])]}
    moved["s"].append(-moved["s"][-1])
    moved["l"] = [moved["l"][0], -moved["l"][0]] * 2
    result = []
    for kind in "sl":
        at = [time for time, k in zip(times, kinds, strict=False) if k == kind]
        moves = tuple(float(size) for size in moved[kind][: len(at)])
        exact = tuple(float(np.round(t / period) * period if kind == "s" else np.round(t, 3)) for t in at)
        result.append(Steps(exact, moves, float(repeat) if at else 0.0))
    return result[0], result[1]
