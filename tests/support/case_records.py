"""Makers of `case_variants`: cases whose cause lies in the block, the loop table, the tags or the export."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from monitor.contract.samples import Samples
from tests.bench.mismatch_plant import INTEGRATING, SELF, Law
from tests.bench.mismatch_shapes import Rng, log, simple
from tests.support.case_makers import level, pi_of, table
from tests.support.case_variants import (
    NO_ADVICE,
    NOT_GOOD,
    NOT_THE_VALVE,
    SAFE,
    Claim,
    Maker,
    Run,
    Variant,
    gain_within,
    names,
    unflagged,
)  # fmt: skip


def _stepped(rng: Rng, noise: float = 0.06) -> tuple[Run, Variant]:
    """A level loop with a step of the set point and back, and its variant without claims."""
    plant = level(rng, 0.01, 0.03, (4.0, 8.0))
    law = pi_of(plant, rng.uniform(1.5, 3.0), rng.uniform(0.15, 0.3))
    size = rng.uniform(4.0, 7.0)
    run = Run.of(rng, plant, law, 5040, noise).setpoint((1200, size), (3000, 0.0))
    loop = table("x", law, pv_low=0.0, pv_high=100.0)
    return run, Variant("", loop, run.samples(), plant, law, ())


def relay_as_output(rng: Rng, case: str) -> list[Variant]:
    """The relay is recorded in place of the demand that switches it."""
    cycle = int(rng.choice([600, 900, 1200]))
    plant = simple(SELF, log(rng, 0.2, 0.3), 300.0, [log(rng, 7000.0, 14_000.0), 600.0])
    law = Law(float(f"{rng.uniform(15.0, 25.0):.3g}"), 6000.0, 0.0, 0.0)
    run = Run.of(
        rng, plant, law, 108_000, 0.02, 60, op0=rng.uniform(10.0, 25.0), pulses=cycle, pv_quantum=0.1
    )
    run.pv0 = 19.0
    run.setpoint((14_400, 2.0), (64_800, 0.0))
    claims = (names("two values", "relay", "pulse", flags=["two_valued_op"]), NO_ADVICE, NOT_THE_VALVE)
    return [
        Variant(case, table("ROOM", law, "auto", pv_low=0.0, pv_high=50.0), run.samples(), plant, law, claims)
    ]


def sign_or_output_inverted(rng: Rng, case: str) -> list[Variant]:
    """A reverse process; the sign wrong in the table, or the valve's closure logged."""
    plant = simple(INTEGRATING, -log(rng, 0.006, 0.015), float(round(log(rng, 5.0, 12.0))), [])
    law = pi_of(plant, rng.uniform(3.0, 5.0), rng.uniform(0.15, 0.3))
    size = rng.uniform(2.0, 4.0)
    run = Run.of(rng, plant, law, 5760, 0.03).setpoint((900, size), (3500, 0.0))
    samples = run.samples()
    claims = (names("sign", "invert"), NO_ADVICE, NOT_GOOD)
    return [
        Variant(case, table("SIGN-typed", law, "auto", kp=-law.kp), samples, plant, law, claims),
        Variant(
            case,
            table("OP-inverted", law, "auto"),
            replace(samples, op=100.0 - samples.op),
            plant,
            law,
            claims,
        ),
    ]


def output_logged_as_fraction(rng: Rng, case: str) -> list[Variant]:
    """OP recorded from 0 to 1, or from 0 to 255, of a loop whose table says per cent."""
    _, known = _stepped(rng)
    out = []
    for name, factor, words in (
        ("OP-fraction", 0.01, ("fraction", "0.01", "100 times", "percent", "per cent")),
        ("OP-8bit", 2.55, ("2.55", "255", "2.5", "2.6")),
    ):
        samples = replace(known.samples, op=np.round(known.samples.op * factor, 5))
        loop = table(name, known.law, pv_low=0.0, pv_high=100.0)
        claims = (names(*words), NO_ADVICE, NOT_GOOD)
        out.append(replace(known, case=case, loop=loop, samples=samples, claims=claims))
    return out


def error_squared_and_gap(rng: Rng, case: str) -> list[Variant]:
    """A gain that grows with the error, and one that is small near the set point; the table shows a plain PI."""
    plant = level(rng, 0.003, 0.006, (4.0, 8.0))
    base = pi_of(plant, rng.uniform(8.0, 11.0), rng.uniform(0.12, 0.2))
    size = rng.uniform(5.0, 8.0)
    out = []
    for name, law in (
        ("LIC-err2", replace(base, kind="squared", width=20.0)),
        ("LIC-gap", replace(base, kind="gap", width=rng.uniform(2.0, 4.0), inside=0.1)),
    ):
        run = Run.of(rng, plant, law, 10_800, 0.12, 4).setpoint((1800, size), (7200, 0.0))
        claims = (
            names("linear", "squared", "gap", "explain", flags=["settings_mismatch"]),
            NO_ADVICE,
            NOT_GOOD,
            NOT_THE_VALVE,
        )
        loop = table(name, law, pv_low=0.0, pv_high=100.0)
        out.append(Variant(case, loop, run.samples(), plant, law, claims))
    return out


def proportional_on_measurement(rng: Rng, case: str) -> list[Variant]:
    """No kick at a step: told by the table, or not."""
    plant = level(rng, 0.012, 0.03, (4.0, 8.0))
    law = replace(pi_of(plant, rng.uniform(1.6, 2.5), rng.uniform(0.25, 0.4)), b=0.0, c=0.0)
    run = Run.of(rng, plant, law, 5760, 0.05).setpoint((1200, 6.0), (3600, 0.0))
    samples = run.samples()
    named = names("weight", "measurement", "kick", "set point", "set-point", flags=["settings_mismatch"])
    return [
        Variant(case, table("PONM-asPID", law), samples, plant, law, (named, SAFE, NOT_THE_VALVE)),
        Variant(
            case, table("PONM-told", law, b=0.0, c=0.0), samples, plant, law,
            (SAFE, gain_within(1.3), unflagged("settings_mismatch"), NOT_THE_VALVE),
        ),
    ]  # fmt: skip


def feedforward_in_output(rng: Rng, case: str) -> list[Variant]:
    """Three elements: most of a load is taken away by a feed-forward that goes into OP."""
    plant = level(rng, 0.006, 0.015, (4.0, 8.0))
    law = pi_of(plant, rng.uniform(2.5, 4.0), rng.uniform(0.06, 0.1))
    share, size = rng.uniform(0.6, 0.8), rng.uniform(12.0, 18.0)
    run = Run.of(rng, plant, law, 12_240, 0.25)
    run.load((1500, -size), (5100, 0.7 * size), (8700, -0.3 * size))
    run.what.added = -share * run.what.load
    wrong = Claim(
        "no gain of the wrong sign, none off by three",
        lambda v, row, _f: row.gain is None or 1 / 3 < row.gain / v.plant.slope < 3,
    )
    loop = table("LIC-3el", law, pv_low=-200.0, pv_high=200.0)
    return [Variant(case, loop, run.samples(), plant, law, (wrong, SAFE, NOT_THE_VALVE))]


def mixed_units(rng: Rng, case: str) -> list[Variant]:
    """The set point in another unit than PV."""
    _, known = _stepped(rng)
    factor = float(rng.choice([10.0, 25.0, 30.0, 60.0]))
    samples = replace(known.samples, sp=known.samples.sp * factor)
    claims = (
        names("unit"),
        NO_ADVICE,
        NOT_GOOD,
        Claim("no index of such data", lambda _v, row, _f: row.ci_setpoint is None and row.ci_load is None),
        unflagged("offset", "no_response"),
    )
    loop = table("SP-mm", known.law, pv_low=0.0, pv_high=100.0)
    return [replace(known, case=case, loop=loop, samples=samples, claims=claims, facts={"factor": factor})]


def narrow_export(rng: Rng, case: str) -> list[Variant]:
    """One row a tag and sample, or an export named as DeltaV does: `narrow_rows`, `deltav_rows`."""
    _, known = _stepped(rng)
    loop = table("LIC-1", known.law, pv_low=0.0, pv_high=100.0)
    return [replace(known, case=case, loop=loop, claims=(gain_within(1.3), SAFE, NOT_THE_VALVE))]


def narrow_rows(variant: Variant) -> str:
    """Return the samples of a variant as a narrow CSV: timestamp, tag, value."""
    lines = ["timestamp,tag,value"]
    for stamp, row in _rows(variant.samples):
        named = zip(("SP", "PV", "OP"), row, strict=True)
        lines += [f"{stamp},{variant.loop.name}.{what},{value!r}" for what, value in named]
    return "\n".join(lines) + "\n"


def deltav_rows(variant: Variant) -> str:
    """Return the samples of a variant as a wide CSV with DeltaV's paths."""
    head = ",".join(f"{variant.loop.name}/{what}.CV" for what in ("SP", "PV", "OUT"))
    lines = [f"{stamp},{','.join(map(repr, row))}" for stamp, row in _rows(variant.samples)]
    return "\n".join([f"Time,{head}", *lines]) + "\n"


def _rows(samples: Samples) -> list[tuple[str, list[float]]]:
    """Return each sample's time as text, and its set point, PV and OP."""
    values = np.column_stack([samples.sp, samples.pv, samples.op]).tolist()
    stamps = [datetime.fromtimestamp(t * 1e-9, UTC).strftime("%Y-%m-%dT%H:%M:%S.00") for t in samples.time]
    return list(zip(stamps, values, strict=True))


MAKERS: dict[str, Maker] = {
    "relay-as-output": relay_as_output,
    "sign-or-output-inverted": sign_or_output_inverted,
    "output-logged-as-fraction": output_logged_as_fraction,
    "error-squared-and-gap": error_squared_and_gap,
    "proportional-on-measurement": proportional_on_measurement,
    "feedforward-in-output": feedforward_in_output,
    "mixed-units": mixed_units,
    "narrow-export": narrow_export,
}
