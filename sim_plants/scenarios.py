"""Named sets of loops. Each entry of `SCENARIOS` takes a seed and returns loops."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sim_plants.controllers import Controller
from sim_plants.fleet import random_fleet, schedules
from sim_plants.margins import at_sensitivity
from sim_plants.plants import Plant
from sim_plants.settings import robust_simc
from sim_plants.specs import NEVER, LoopSpec, Steps
from sim_plants.troubles import troubles

_MINUTE = 60.0  # [s]

# Pumped tank: gain -0.022 m/(% min) and dead time 1.1 min, as printed.
# R. Rice, D. J. Cooper, Design and tuning of PID controllers for integrating processes, ISA 2002.
_TANK = Plant("integrating", -0.022 / _MINUTE, 1.1 * _MINUTE)


def _tank_pi() -> Controller:
    """Return the PI of Rice and Cooper (2002) with its closed-loop time, sqrt(10) times the dead time."""
    wished, dead_time = math.sqrt(10) * _TANK.dead_time, _TANK.dead_time
    ti = 2 * wished + dead_time
    return Controller(ti / (_TANK.gain * (wished + dead_time) ** 2), ti)


def _limited(controller: Controller) -> Controller:
    return replace(controller, op_low=0.0, op_high=100.0)


def pumped_tank(seed: int) -> list[LoopSpec]:
    """Level of the pumped tank under three settings that Rice and Cooper give, with steps each way.

    Steps and operating point (0.5 m about 4.8 m) are ours.
    """
    settings = {
        "PI": _tank_pi(),
        "PID": Controller(-22.9, 8.0 * _MINUTE, 0.51 * _MINUTE, tf=0.0, c=0.0),
        "PIDF": Controller(-19.5, 8.5 * _MINUTE, 0.51 * _MINUTE, tf=0.64 * 0.51 * _MINUTE),
    }
    return [
        LoopSpec(
            name=f"LIC-101-{name}",
            plant=_TANK,
            controller=_limited(controller),
            pv0=4.8,
            op0=70.0,
            period=1.0,
            setpoint=Steps((300.0, 3300.0), (0.5, -0.5), 12000.0),
            load=Steps((6300.0, 9300.0), (5.0, -5.0), 12000.0),
            noise=0.002,
            seed=seed * 1000 + number,
            pv_low=0.0,
            pv_high=10.0,
            unit="m",
            tuning="published",
        )
        for number, (name, controller) in enumerate(settings.items())
    ]


def pumped_tank_test(seed: int) -> list[LoopSpec]:
    """Level of the pumped tank under P-only control with steps of the set point: Rice and Cooper's test (2002).

    On what such a test shows their PID is tuned: -22.9 %/m, 8.0 and 0.51 min. For a suggestion of that rule the
    loop table says `controller = pid` and `rule = imc-pid`. Gain of the controller, steps and noise are ours.
    """
    return [
        LoopSpec(
            name="LIC-101",
            plant=_TANK,
            controller=_limited(Controller(-5.0)),
            pv0=4.8,
            op0=70.0,
            period=1.0,
            setpoint=Steps((600.0, 3000.0), (0.5, -0.5), 4800.0),
            noise=0.002,
            seed=seed,
            pv_low=0.0,
            pv_high=10.0,
            unit="m",
            tuning="P-only",
        )
    ]


def reference_loops(seed: int, period: float = 0.05) -> list[LoopSpec]:
    """Four integrating loops with known IAE, under series PID with a filter of td/10, noise-free.

    Unit step of the set point at 100 s, unit load step at 2600 s. The last two have the same plant.
    """
    third = Plant("integrating", 0.2, 3.0, (4.0, 1.0))
    cases = {
        "REF-1": (Plant("integrating", 1.0, 1.0), (0.5, 8.0, 0.0)),
        "REF-2": (Plant("integrating", 1.0, 0.0, (1.0, 1.0)), (1.0, 4.0, 1.5)),
        "REF-3": (third, (0.25, 80.0, 2.0)),
        "REF-4": (third, (0.6, 30.0, 3.0)),
    }
    return [
        LoopSpec(
            name=name,
            plant=plant,
            controller=Controller(*settings, form="series"),
            period=period,
            setpoint=Steps((100.0,), (1.0,)),
            load=Steps((2600.0,), (1.0,)),
            seed=seed,
            tuning="published",
        )
        for name, (plant, settings) in cases.items()
    ]


def _demo_cases() -> list[tuple[str, str, Plant, Controller, float, float, str]]:
    """Return tag, tuning, plant, controller, span of PV, set-point step [PV] and unit of the demo's loops."""

    def integrating(gain: float, dead_time: float, *lags: float) -> Plant:
        return Plant("integrating", gain, dead_time, lags)

    def lagging(gain: float, dead_time: float, *lags: float) -> Plant:
        return Plant("self-regulating", gain, dead_time, lags)

    level, small, drum = integrating(0.05, 4.0), integrating(-0.0016, 6.0, 5.0), integrating(0.03, 4.0)
    gas, steam = integrating(0.006, 3.0, 2.0), integrating(-0.5, 4.0, 5.0, 1.0)
    reactor, oven = integrating(0.01, 8.0, 9.0, 3.0), lagging(1.5, 8.0, 60.0, 8.0)
    flow, cooling, feed = lagging(2.0, 2.0, 5.0), lagging(-1.2, 3.0, 8.0, 1.0), lagging(12.0, 2.0, 4.0)
    return [
        ("LIC-101", "good", level, robust_simc(level, 1.0), 100.0, 4.0, "%"),
        ("LIC-102", "sluggish", level, Controller(0.5, 180.0), 100.0, 4.0, "%"),
        ("LIC-103", "sluggish", small, Controller(-11.0, 220.0), 2.0, 0.1, "m"),
        ("LIC-104", "rolling", drum, Controller(0.6, 0.8 / (0.03 * 0.6)), 100.0, 4.0, "%"),
        ("LIC-105", "published", _TANK, _tank_pi(), 10.0, 0.5, "m"),
        ("LIC-106", "good", small, replace(robust_simc(small, 1.0), b=0.0), 2.0, 0.1, "m"),
        (
            "PIC-205",
            "aggressive",
            gas,
            at_sensitivity(gas, Controller(10.0, 30.0), 1.0, 4.0),
            10.0,
            0.3,
            "bar",
        ),
        (
            "PIC-206",
            "good",
            steam,
            replace(robust_simc(steam, 1.0, True, "series"), c=0.0),
            600.0,
            20.0,
            "kPa",
        ),
        ("TIC-310", "good", oven, robust_simc(oven, 1.0), 200.0, 6.0, "degC"),
        ("TIC-311", "good", reactor, replace(robust_simc(reactor, 1.0, True), c=0.0), 150.0, 3.0, "degC"),
        ("FIC-402", "good", flow, robust_simc(flow, 1.0), 200.0, 10.0, "m3/h"),
        ("FIC-403", "sluggish", cooling, Controller(-0.15, 25.0), 120.0, 8.0, "m3/h"),
        ("FIC-404", "manual", feed, robust_simc(feed, 1.0), 1200.0, 40.0, "kg/h"),
    ]


def demo(seed: int) -> list[LoopSpec]:
    """Thirteen loops sampled every second, their first steps after 100 to 200 s, for ever after.

    Sluggish: LIC-102, LIC-103, FIC-403. Slowly rolling: LIC-104. Aggressive: PIC-205 (Ms about 4). In manual:
    FIC-404. LIC-105 is the pumped tank of Rice and Cooper. The others are good.
    """
    cases = _demo_cases()
    streams = np.random.SeedSequence(seed).spawn(len(cases))
    loops = []
    for number, (name, tuning, plant, settings, span, step, unit) in enumerate(cases):
        rng = np.random.default_rng(streams[number])
        load = min(float(f"{step * abs(settings.kp):.2g}"), 10.0)
        first = 100.0 + 100.0 * number / len(cases)
        setpoint, loads = schedules(rng, plant, settings, 1.0, (step, load), first=first, apart=(1.0, 1.25))
        manual = tuning == "manual"
        loops.append(
            LoopSpec(
                name=name,
                plant=plant,
                controller=_limited(settings),
                pv0=span / 2,
                op0=50.0,
                period=1.0,
                setpoint=NEVER if manual else setpoint,
                load=NEVER if manual else loads,
                auto=not manual,
                output=Steps((170.0, 570.0), (2.0, -2.0), 800.0) if manual else NEVER,
                noise=step * float(rng.uniform(0.002, 0.01)),
                seed=int(rng.integers(2**62)),
                pv_low=0.0,
                pv_high=span,
                unit=unit,
                tuning=tuning,
            )
        )
    return loops


def fleet(seed: int) -> list[LoopSpec]:
    """Return a hundred loops as a plant has them."""
    return random_fleet(100, seed)


SCENARIOS: dict[str, Callable[[int], list[LoopSpec]]] = {
    "demo": demo,
    "fleet": fleet,
    "pumped-tank": pumped_tank,
    "pumped-tank-test": pumped_tank_test,
    "reference-loops": reference_loops,
    "troubles": troubles,
}
"""Loops by the name of the scenario, from a seed."""
