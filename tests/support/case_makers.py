"""Makers of `case_variants`: cases whose cause lies in process, valve, drive, tuning or another controller."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, RETUNE
from tests.bench.mismatch_plant import INTEGRATING, SELF, Law, Plant, peak
from tests.bench.mismatch_shapes import Rng, log, simple
from tests.bench.mismatch_sim import Valve
from tests.support.case_variants import (
    NO_ADVICE,
    NOT_GOOD,
    NOT_THE_VALVE,
    SAFE,
    START_S,
    Claim,
    Maker,
    Run,
    Variant,
    gain_within,
    integral_weaker,
    names,
    never,
    samples_of,
    unflagged,
)  # fmt: skip

ROLLING_MS = 40.0
"""Ms of a loop whose swing hardly dies."""


def table(name: str, law: Law, process: str = INTEGRATING, **facts: object) -> Loop:
    """Return what a loop table says of a loop, limits of OP included."""
    known = {"kp": law.kp, "ti": law.ti, "td": law.td, "form": law.form, "op_low": 0.0, "op_high": 100.0}
    return Loop(name=name, process=process, **(known | facts))  # type: ignore[arg-type]


def level(rng: Rng, low: float = 0.003, high: float = 0.02, dead: tuple[float, float] = (3.0, 12.0)) -> Plant:
    """Draw an integrator with a dead time."""
    return simple(INTEGRATING, log(rng, low, high), float(round(log(rng, *dead))), [])


def pi_of(plant: Plant, product: float, share: float) -> Law:
    """PI settings of a share of SIMC's gain, with gain kp ti = product."""
    kp = share / (2 * plant.slope * plant.theta)
    return Law(float(f"{kp:.3g}"), float(f"{product / (plant.slope * kp):.3g}"), 0.0, 0.0)


def rolling(plant: Plant, kp: float) -> Law:
    """PI settings of a gain whose integral is so strong that the loop swings and hardly ever comes to rest."""
    for product in np.geomspace(0.5, 0.01, 400):
        law = Law(kp, float(f"{product / (plant.slope * kp):.4g}"), 0.0, 0.0)
        if peak(plant, law, 1.0) > ROLLING_MS:
            return law
    raise ValueError(f"kp: {kp!r}, no integral time lets the loop roll")


def drive_minimum_speed(rng: Rng, case: str) -> list[Variant]:
    """A drive that runs no slower than a third: steps down run into it."""
    plant = level(rng, 0.006, 0.015)
    law = pi_of(plant, rng.uniform(3.5, 6.0), rng.uniform(0.3, 0.6))
    size = rng.uniform(4.0, 6.0)
    minimum = rng.uniform(25.0, 35.0)
    op0 = minimum + rng.uniform(0.3, 0.5) * law.kp * size
    run = Run.of(rng, plant, law, 15_800, 0.03, op0=op0, floor=minimum - op0)
    run.setpoint((1800, size), (5400, 0.0), (9000, 1.6 * size), (12_600, 0.0))
    claims = (gain_within(1.3), SAFE, NOT_THE_VALVE)
    return [
        Variant(case, table("VFD-min", law, pv_low=0.0, pv_high=100.0), run.samples(), plant, law, claims)
    ]


def evaporator_cycle(rng: Rng, case: str) -> list[Variant]:
    """Integral far too strong for the gain: one cycles, one with another Ti in the table, one with steps."""
    plant = simple(INTEGRATING, log(rng, 0.02, 0.08), float(round(log(rng, 2.0, 4.0))), [])
    kp = float(f"{rng.uniform(0.12, 0.22) / (2 * plant.slope * plant.theta):.3g}")
    strong = rolling(plant, kp)
    milder = replace(strong, ti=4 * strong.ti)
    out = []
    for name, law, told in (
        ("EVAP-cycle", strong, strong.ti),
        ("EVAP-tiwrong", strong, strong.ti * float(rng.choice([30.0, 60.0]))),
        ("EVAP-step", milder, milder.ti),
    ):
        run = Run.of(rng, plant, law, 3000, 0.3, 1)
        size = rng.uniform(3.0, 6.0)
        run.setpoint((300, size), (400, 0.0)) if law is strong else run.setpoint((1200, size))
        claims = [SAFE, integral_weaker(4.0 if law is strong else 2.0), NOT_GOOD, NOT_THE_VALVE]
        if name == "EVAP-tiwrong":
            claims = [SAFE, names("ti", "reset", "minute", "integral", flags=["settings_mismatch"]), NOT_GOOD]
        out.append(Variant(case, table(name, law, ti=told), run.samples(), plant, law, tuple(claims)))
    return out


def fryer_level_cycle(rng: Rng, case: str) -> list[Variant]:
    """A slow level that rolls with a period of half an hour and more and never dies; the same with a step."""
    out = []
    dead = float(round(log(rng, 50.0, 90.0)))
    plant = simple(INTEGRATING, log(rng, 3e-4, 8e-4), dead, [])
    kp = float(f"{rng.uniform(0.1, 0.2) / (2 * plant.slope * dead):.3g}")
    law = rolling(plant, kp)
    run = Run.of(rng, plant, law, 28_200, 0.06, 10).load((100, rng.uniform(5.0, 15.0)))
    samples = run.samples()
    samples = samples.take(np.arange(300, len(samples)))  # it rolls already when the record begins
    claims = (SAFE, integral_weaker(4.0), NOT_GOOD, NOT_THE_VALVE, names("integral", "reset"))
    out.append(
        Variant(case, table("FRYER-cycle", law, pv_low=0.0, pv_high=100.0), samples, plant, law, claims)
    )
    quicker = simple(INTEGRATING, plant.slope, float(round(0.45 * dead)), [])
    mild = replace(law, ti=2.5 * law.ti)
    run = Run.of(rng, quicker, mild, 25_200, 0.06, 10).setpoint((9000, rng.uniform(0.8, 1.5)))
    claims = (SAFE, gain_within(1.3), integral_weaker(2.0), NOT_THE_VALVE, NOT_GOOD)
    loop = table("FRYER-step", mild, pv_low=0.0, pv_high=100.0)
    return [*out, Variant(case, loop, run.samples(), quicker, mild, claims)]


def horizontal_drum(rng: Rng, case: str) -> list[Variant]:
    """A lying cylinder: the gain near its ends is larger than in the middle."""
    plant = level(rng, 0.006, 0.015, (4.0, 10.0))
    law = pi_of(plant, rng.uniform(3.0, 6.0), rng.uniform(0.2, 0.35))
    low = rng.uniform(0.08, 0.12)
    run = Run.of(rng, plant, law, 19_500, 0.04, 3, valve=Valve("drum", 100.0, 0.5))
    run.pv0 = 50.0
    size, down = rng.uniform(3.0, 5.0), 100.0 * (low - 0.5)
    run.setpoint((1800, size), (5400, 0.0), (9000, down), (14_000, down + 3.0), (17_600, down))
    factors = (1.0, math.sqrt(0.25 / (low * (1 - low))))
    loop = table("DRUM-horizontal", law, pv_low=0.0, pv_high=100.0)
    return [Variant(case, loop, run.samples(), plant, law, (SAFE, gain_within(2.0), NOT_THE_VALVE), factors)]


def no_response(rng: Rng, case: str) -> list[Variant]:
    """PV stays away from the set point for hours while OP ramps: the valve is blocked, and the integral slow."""
    out = []
    for name in ("AIC-1", "PIC-2"):
        sign = float(rng.choice([-1, 1]))
        plant = simple(SELF, sign * log(rng, 0.3, 3.0), 20.0, [log(rng, 60.0, 300.0)])
        kp = sign * log(rng, 0.1, 0.6) / abs(plant.slope)
        hours = rng.uniform(2.0, 4.0)
        noise = log(rng, 0.01, 0.1) * abs(plant.slope)
        away = noise * log(rng, 8.0, 40.0)
        reach = rng.uniform(4.0, 25.0)  # how far OP ramps within the record [OP]
        law = Law(kp, abs(kp) * away * hours * 3600 / reach, 0.0, 0.0)
        run = Run.of(rng, plant, law, hours * 3600 + 3600, noise, 10)
        run.what.shut[:] = True
        run.load((1, float(rng.choice([-1, 1])) * away / abs(plant.slope)))
        samples = run.samples()
        samples = samples.take(np.arange(360, len(samples)))
        claims = (names(flags=["no_response"]), never("add integral"), NO_ADVICE, NOT_GOOD)
        out.append(Variant(case, Loop(name=name), samples, plant, law, claims))
    return out


def slow_motor_valve(rng: Rng, case: str) -> list[Variant]:
    """A motor that takes minutes for what the controller asks for at once."""
    plant = level(rng, 0.003, 0.006, (4.0, 8.0))
    law = pi_of(plant, rng.uniform(6.0, 10.0), rng.uniform(0.15, 0.3))
    size = rng.uniform(6.0, 9.0)
    kick = min(law.kp * size, 45.0)
    run = Run.of(rng, plant, law, 10_800, 0.04, valve=Valve("rate", kick / rng.uniform(200.0, 350.0)))
    run.setpoint((1200, kick / law.kp), (6000, 0.0))
    slow = Claim(
        "the valve named, or the gain right",
        lambda v, row, _f: (
            any(w in row.reason.lower() for w in ("valve", "rate", "slowly"))
            or row.gain is None
            or 0.7 <= row.gain / v.plant.slope <= 1.4
        ),
    )
    swing = Claim(
        "no more gain for a valve that is too slow", lambda v, row, _f: not _swings(v, row, run.body.valve)
    )
    loop = table("LIC-mov", law, pv_low=0.0, pv_high=100.0)
    facts = {"size": kick / law.kp}
    return [Variant(case, loop, run.samples(), plant, law, (SAFE, slow, swing), facts=facts)]


def _swings(variant: Variant, row: object, valve: Valve) -> bool:
    """Whether the loop with its valve swings on after the step of the record under what is suggested."""
    law = variant.suggested(row)  # type: ignore[arg-type]
    if law is None:
        return False
    run = Run.of(np.random.default_rng(0), variant.plant, law, 20_000, 0.0, valve=valve)
    lived = run.setpoint((100, variant.facts["size"])).live()
    error = np.abs(lived.sp - lived.true)
    return bool(error[-5000:].max() > 0.1 * variant.facts["size"])


def split_range(rng: Rng, case: str) -> list[Variant]:
    """Above half of OP one side works, below the other, with several times the gain."""
    ratio = rng.uniform(3.0, 5.0)
    slow = 3000.0
    plant = simple(SELF, log(rng, 0.015, 0.025) * slow, float(round(log(rng, 8.0, 12.0))), [slow, 20.0])
    law = Law(float(f"{rng.uniform(0.2, 0.3) * slow / (plant.slope * plant.theta):.3g}"), 300.0, 0.0, 0.0)
    factors = (1.0, ratio)
    if peak(plant, law, 1.0, ratio) > 15.0:  # a record that swings for ever shows no step
        law = replace(law, kp=float(f"{0.6 * law.kp:.3g}"))
    out = []
    for name, steps in (
        ("SPLIT", ((1200, 6.0), (4800, 0.0), (8400, -6.0), (12_000, 0.0))),
        ("SPLIT-heat", ((1200, 6.0),)),
    ):
        run = Run.of(rng, plant, law, 15_480 if len(steps) > 1 else 14_400, 0.1, 4, op0=50.0)
        run = replace(run, body=replace(run.body, valve=Valve("direction", 1.0, ratio)))
        run.setpoint(*steps)
        told = Claim(
            "names that the gain differs, or what it says holds on both sides",
            lambda v, row, _f: (
                any(w in row.reason.lower() for w in ("split", "differ", "direction"))
                or (row.verdict != GOOD or v.ms(v.law) <= 3.0)
            ),
        )
        loop = table(name, law, "auto", pv_low=0.0, pv_high=200.0)
        out.append(Variant(case, loop, run.samples(), plant, law, (SAFE, told, NOT_THE_VALVE), factors))
    return out


def low_select_override(rng: Rng, case: str) -> list[Variant]:
    """Another controller holds the valve, this one's output hovers nearby; a clean step comes before."""
    plant = level(rng, 0.006, 0.015, (4.0, 10.0))
    law = pi_of(plant, rng.uniform(3.0, 5.0), rng.uniform(0.15, 0.25))
    n, dead = 14_000, round(plant.dead_time)
    sp, load = np.zeros(n), np.zeros(n)
    size = rng.uniform(3.0, 5.0)
    sp[1500:] = size
    sp[10_000:] = 0.0
    limit = -rng.uniform(6.0, 9.0)
    held = np.zeros(n, bool)
    held[4000:9000] = held[12_000:] = True
    drift = 1 / (plant.slope * 5000.0)  # lets PV go by one in a window [OP/PV]
    load[4000:] = limit + drift * rng.uniform(3.0, 8.0)
    load[6000:] += drift * rng.uniform(2.0, 6.0)
    load[9000:] = limit + 3.0
    load[12_000:] = limit + drift * rng.uniform(5.0, 15.0)
    noise, pv, op = 0.03 * rng.standard_normal(n), np.zeros(n), np.zeros(n)
    y, reset, past = 0.0, 0.0, [0.0] * (dead + 1)
    for k in range(n):
        pv[k] = y + noise[k]
        e = sp[k] - pv[k]
        op[k] = min(max(law.kp * e + reset, -50.0), 50.0)
        valve = min(op[k], limit) if held[k] else op[k]
        reset += (valve - reset) / law.ti  # external reset follows the valve
        past.append(valve)
        y += plant.slope * (past[-dead - 1] - load[k])
    at = np.arange(0, n, 2)
    samples = samples_of(at * 1.0, sp[at] + 50.0, pv[at] + 50.0, op[at] + 50.0)
    inside = Claim(
        "no event inside the override carries a verdict on the tuning",
        lambda _v, _row, found: (
            not any(
                held[min(max(int(a.start * 1e-9 - START_S), 0), n - 1)] and a.verdict in {GOOD, RETUNE}
                for a in found
            )
        ),
    )
    step = Claim(
        "the step before is found, with its gain",
        lambda v, _row, found: any(
            abs(a.start * 1e-9 - START_S - 1500) <= 6
            and a.gain is not None
            and 0.8 < a.gain / v.plant.slope < 1.25
            for a in found
        ),
    )
    loop = table("LIC-override", law, pv_low=0.0, pv_high=100.0)
    return [Variant(case, loop, samples, plant, law, (step, inside, never("retuned on"), SAFE))]


def cascade_slave_in_local(rng: Rng, case: str) -> list[Variant]:
    """The slave is put to local for an hour and a half: the master's output winds up without an answer."""
    dead = float(round(log(rng, 12.0, 30.0)))
    plant = simple(SELF, log(rng, 0.3, 0.6), dead, [log(rng, 90.0, 150.0), 4.0])
    law = Law(
        float(f"{rng.uniform(0.06, 0.12) * plant.lag / (plant.slope * plant.theta):.3g}"),
        float(f"{plant.lag:.3g}"),
        0.0,
        0.0,
    )
    run = Run.of(rng, plant, law, 14_400, 0.03)
    run.what.shut[5400:10_800] = True
    size = rng.uniform(2.0, 4.0)
    run.setpoint((1800, size), (3600, 0.0), (7200, 0.6 * size), (9000, 0.0))
    local = Claim(
        "what happens in local carries no index",
        lambda _v, _row, found: all(
            a.ci is None and a.verdict not in {GOOD, RETUNE}
            for a in found
            if 5400 <= a.start * 1e-9 - START_S <= 10_800
        ),
    )
    loop = table("TIC-master", law, "auto", pv_low=0.0, pv_high=200.0)
    return [Variant(case, loop, run.samples(), plant, law, (local, gain_within(1.25), SAFE))]


def noisy_quantised_oven(rng: Rng, case: str) -> list[Variant]:
    """A slow oven, a coarse and noisy thermometer, an integral far faster than the oven."""
    lag = log(rng, 400.0, 800.0)
    plant = simple(SELF, log(rng, 0.2, 0.35), float(round(log(rng, 12.0, 25.0))), [lag])
    law = Law(
        float(f"{rng.uniform(1.6, 2.4) / plant.slope:.3g}"),
        float(f"{lag * rng.uniform(0.13, 0.2):.3g}"),
        0.0,
        0.0,
    )
    run = Run.of(rng, plant, law, 14_400, 0.4, 4, op0=200.0, op_high=2000.0, pv_quantum=0.25)
    run.setpoint((3000, 20.0), (9000, 10.0))
    calm = Claim(
        "no derivative on noise, little of it on OP",
        lambda _v, row, _f: not row.new_td and (row.new_op_noise is None or row.new_op_noise < 2.0),
    )
    loop = table("OVEN", law, "auto", op_high=2000.0, pv_low=0.0, pv_high=400.0)
    return [
        Variant(
            case, loop, run.samples(), plant, law, (gain_within(1.3), SAFE, calm, NOT_GOOD, NOT_THE_VALVE)
        )
    ]


def drum_inverse_response(rng: Rng, case: str) -> list[Variant]:
    """A drum that swells before it falls."""
    plant = simple(INTEGRATING, log(rng, 0.006, 0.015), 3.0, [log(rng, 7.0, 15.0)], log(rng, 18.0, 35.0))
    kp = float(f"{rng.uniform(0.4, 0.6) / (2 * plant.slope * plant.theta):.3g}")
    law = Law(kp, float(f"{rng.uniform(2.5, 4.0) / (plant.slope * kp):.3g}"), 0.0, 0.0)
    run = Run.of(rng, plant, law, 9360, 0.5).setpoint((1500, 25.0), (6000, 0.0))
    loop = table("DRUM", law, pv_low=-200.0, pv_high=200.0)
    return [Variant(case, loop, run.samples(), plant, law, (SAFE, gain_within(1.5), NOT_THE_VALVE))]


def intermittent_hunting(rng: Rng, case: str) -> list[Variant]:
    """An air handler: off at first, then a lower set point, and hours in which the coil's gain is too high."""
    plant = simple(
        SELF, log(rng, 0.02, 0.04), float(round(log(rng, 250.0, 450.0))), [log(rng, 600.0, 1500.0)]
    )
    kp = 0.15 * plant.lag / (plant.slope * plant.theta)
    law = Law(float(f"{kp:.3g}"), float(f"{plant.lag:.3g}"), 0.0, 0.0)
    days = 4
    run = Run.of(
        rng, plant, law, days * 86_400 + 30_000, 0.03, 60, op0=rng.uniform(60.0, 75.0), pv_quantum=0.1
    )
    on = int(rng.uniform(12.0, 18.0) * 3600)
    run.what.auto[:on] = False
    run.what.moved[1] = -100.0
    falls = np.arange(29) * 300 + on - 29 * 300  # the programme's steps, before it is switched on
    run.setpoint((0, 18.0), *((at, 18.0 * (1.0 - (k + 1) / 29)) for k, at in enumerate(falls)))
    run.load(*((at, rng.uniform(-15.0, 15.0)) for at in range(on, len(run.what.load), 7200)))  # the weather
    for day in range(days):
        first = on + day * 86_400 + int(rng.uniform(3.0, 8.0) * 3600)
        n = len(run.what.factor[first : first + int(rng.uniform(3.0, 9.0) * 3600)])
        run.what.factor[first : first + n] = np.linspace(*rng.uniform(12.0, 16.0, 2), n)
    claims = (
        names(flags=["oscillating"]),
        NOT_GOOD,
        never("no set-point"),
        NOT_THE_VALVE,
        unflagged("stuck_pv"),
    )
    loop = Loop(name="TIC-1", op_low=0.0, op_high=100.0)
    return [Variant(case, loop, run.samples(), plant, law, claims)]


MAKERS: dict[str, Maker] = {
    "drive-minimum-speed": drive_minimum_speed,
    "evaporator-cycle": evaporator_cycle,
    "fryer-level-cycle": fryer_level_cycle,
    "horizontal-drum": horizontal_drum,
    "intermittent-hunting": intermittent_hunting,
    "no-response": no_response,
    "slow-motor-valve": slow_motor_valve,
    "split-range": split_range,
    "low-select-override": low_select_override,
    "cascade-slave-in-local": cascade_slave_in_local,
    "noisy-quantised-oven": noisy_quantised_oven,
    "drum-inverse-response": drum_inverse_response,
}
