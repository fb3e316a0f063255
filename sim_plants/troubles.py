"""Loops whose trouble is not, or not only, their settings."""

from dataclasses import replace

import numpy as np

from sim_plants.controllers import Controller
from sim_plants.fleet import schedules
from sim_plants.plants import Plant
from sim_plants.settings import robust_simc
from sim_plants.specs import LoopSpec, Steps

_VESSEL = Plant("integrating", 0.03, 4.0, (2.0,))
_LINE = Plant("self-regulating", 1.5, 2.0, (6.0,))
_DRUM = Plant("integrating", 0.02, 3.0, (6.0, 2.0), inverse=(4.0,))
_BIG = Plant("integrating", 0.002, 5.0)
_RARELY = Steps((1800.0, 3600.0), (4.0, -4.0), 3600.0)


def _loop(name: str, plant: Plant, controller: Controller, seed: int, tuning: str) -> LoopSpec:
    """Return a loop in % of PV, with steps of 4 % and their loads, and a noise of 0.02 %."""
    rng = np.random.default_rng([seed, sum(name.encode())])
    load = min(4.0 * abs(controller.kp), 8.0)
    setpoint, loads = schedules(rng, plant, controller, 1.0, (4.0, load), first=300.0)
    return LoopSpec(
        name=name,
        plant=plant,
        controller=replace(controller, op_low=0.0, op_high=100.0),
        pv0=50.0,
        op0=50.0,
        setpoint=setpoint,
        load=loads,
        noise=0.02,
        seed=int(rng.integers(2**62)),
        pv_low=0.0,
        pv_high=100.0,
        unit="%",
        tuning=tuning,
    )


def troubles(seed: int) -> list[LoopSpec]:
    """Nine loops, each with one trouble that its `tuning` names; their settings are good but for two.

    Sticky valve, output at its limit under a load, coarse transmitter, no integral action, surge vessel with
    a wandering load, much noise, inverse response, half the time in manual, and nothing but a wandering load.
    """
    vessel, line = robust_simc(_VESSEL, 1.0), robust_simc(_LINE, 1.0)
    big = Controller(4.0, 500.0)
    sticky = _loop("FIC-501", _LINE, line, seed, "sticky")
    limited = _loop("LIC-502", _BIG, big, seed, "limited")
    coarse = _loop("LIC-503", _VESSEL, vessel, seed, "coarse")
    offset = _loop("LIC-504", _VESSEL, replace(vessel, ti=float("inf")), seed, "no integral")
    surge = _loop("LIC-505", _BIG, Controller(0.6, 4000.0), seed, "surge")
    noisy = _loop("PIC-506", _VESSEL, vessel, seed, "noisy")
    drum = _loop("LIC-507", _DRUM, robust_simc(_DRUM, 1.0), seed, "inverse")
    manual = _loop("FIC-508", _LINE, line, seed, "at times manual")
    quiet = _loop("LIC-509", _VESSEL, vessel, seed, "quiet")
    nothing = Steps()
    return [
        # a step of the set point every half hour, so that its cycle is seen between them
        replace(sticky, stiction=1.5, wander=0.02, setpoint=_RARELY, load=Steps()),
        # 40 % more than the valve has left, for ten minutes every two hours.
        replace(limited, op0=80.0, load=Steps((3000.0, 3600.0), (-60.0, 60.0), 7200.0)),
        replace(coarse, quantum=0.4),
        offset,
        replace(
            surge, objective="averaging", wander=0.1, max_load=10.0, max_deviation=20.0, setpoint=nothing
        ),
        replace(noisy, noise=0.03 * 4.0),
        drum,
        replace(manual, modes=Steps((3600.0, 5400.0), (-1.0, 1.0), 7200.0), wander=0.02),
        replace(quiet, setpoint=nothing, load=nothing, wander=0.01),
    ]
