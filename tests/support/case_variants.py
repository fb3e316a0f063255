"""Simulated variants of the situations in ``../shared/cases``: the same kind, other numbers for each seed.

``draw(case, seed)`` returns one `Variant` for each loop of a case: samples, the row of the loop table, the true plant,
and claims: what must hold of the loop's row, and what must not be said. ``faults(variant, row, found)`` names the
claims that an answer breaks. The makers stand in `case_makers` (process, valve, tuning) and `case_records` (table,
tags, export).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, RETUNE, Assessment, LoopRow
from monitor.contract.samples import Samples
from tests.bench.mismatch_plant import Floats, Law, Plant, peak
from tests.bench.plant_life_sim import STEP_S, Body, Inputs, Lived, live

if TYPE_CHECKING:
    from tests.bench.mismatch_shapes import Rng

HARMFUL_MS = 3.0
"""True Ms above which settings do harm."""
START_S = 1_772_431_200
"""First sample [s since 1970]."""


@dataclass(frozen=True)
class Claim:
    """What an answer has to fulfil, in words, and how that is seen."""

    words: str
    holds: Callable[[Variant, LoopRow, Sequence[Assessment]], bool]


@dataclass(frozen=True)
class Variant:
    """A loop of the kind of a case, and what is true of it."""

    case: str
    loop: Loop
    samples: Samples
    plant: Plant
    law: Law
    """The controller as it runs."""
    claims: tuple[Claim, ...]
    factors: tuple[float, ...] = (1.0,)
    """On the plant's gain where the loop may stand."""
    facts: dict[str, float] = field(default_factory=dict)

    def ms(self, law: Law) -> float:
        """Worst true Ms under a law, wherever the loop may stand."""
        return max(peak(self.plant, law, STEP_S, factor) for factor in self.factors)

    def suggested(self, row: LoopRow) -> Law | None:
        """Return the law that a row suggests; None without one."""
        if row.new_kp is None:
            return None
        ti = math.inf if row.new_ti is None else row.new_ti
        return replace(
            self.law, kp=row.new_kp, ti=ti, td=row.new_td or 0.0, tf=row.new_tf or 0.0, kind="linear"
        )


def faults(variant: Variant, row: LoopRow, found: Sequence[Assessment] = ()) -> list[str]:
    """Return the words of the claims that an answer breaks."""
    return [claim.words for claim in variant.claims if not claim.holds(variant, row, found)]


def draw(case: str, seed: int) -> list[Variant]:
    """Draw a variant of each loop of a case."""
    rng = np.random.default_rng([seed, *map(ord, case)])
    return makers()[case](rng, case)


Maker = Callable[["Rng", str], list[Variant]]


def makers() -> dict[str, Maker]:
    """Return the makers by the name of their case."""
    from tests.support import case_makers, case_records  # noqa: PLC0415 (they are made of what stands here)

    return case_makers.MAKERS | case_records.MAKERS


# ---------------------------------------------------------------------------------------------------
# claims that several kinds share


def said(row: LoopRow, *words: str) -> bool:
    """Whether reason or action holds one of the words."""
    text = f"{row.reason} {row.action}".lower()
    return any(word in text for word in words)


def names(*words: str, flags: Sequence[str] = ()) -> Claim:
    """Claim that the cause is named by one of the words, or by a flag."""
    what = " or ".join([*words, *flags])
    return Claim(
        f"names the cause: {what}", lambda _v, row, _f: said(row, *words) or bool({*flags} & {*row.flags})
    )


def never(*words: str) -> Claim:
    """Claim that none of the words is said."""
    return Claim(f"does not say: {' or '.join(words)}", lambda _v, row, _f: not said(row, *words))


def unflagged(*flags: str) -> Claim:
    """Claim that none of the flags is set."""
    return Claim(f"does not flag {' or '.join(flags)}", lambda _v, row, _f: not {*flags} & {*row.flags})


def gain_within(factor: float) -> Claim:
    """Claim that the gain is right within a factor, sign included, or not given."""
    return Claim(
        f"gain right within a factor of {factor:g}, or none",
        lambda v, row, _f: row.gain is None or 1 / factor <= row.gain / v.plant.slope <= factor,
    )


def _is_safe(variant: Variant, row: LoopRow, _found: Sequence[Assessment]) -> bool:
    law = variant.suggested(row)
    return law is None or variant.ms(law) <= HARMFUL_MS


SAFE = Claim(f"nothing is suggested with which the true Ms is above {HARMFUL_MS:g}", _is_safe)
NO_ADVICE = Claim("nothing to type in", lambda _v, row, _f: row.new_kp is None)
NOT_GOOD = Claim("not called good", lambda _v, row, _f: row.verdict != GOOD)
NO_RETUNE = Claim("tuning not blamed", lambda _v, row, _f: row.verdict != RETUNE)
NOT_THE_VALVE = unflagged("stiction")


def integral_weaker(factor: float) -> Claim:
    """Claim that a suggestion makes kp ti so much larger, and the gain no smaller."""

    def holds(variant: Variant, row: LoopRow, _found: Sequence[Assessment]) -> bool:
        law, today = variant.suggested(row), variant.law
        if law is None:
            return True
        return abs(law.kp * law.ti) >= factor * abs(today.kp * today.ti) and abs(law.kp) >= 0.8 * abs(
            today.kp
        )

    return Claim(f"kp ti {factor:g} times as large or more, the gain not lower", holds)


# ---------------------------------------------------------------------------------------------------
# how a variant is simulated


@dataclass
class Run:
    """A simulated record in the making: a body, its inputs, and how it is sampled."""

    body: Body
    what: Inputs
    period: int
    """Steps in a sample."""
    pv0: float
    op0: float
    digits: int = 5
    """Significant digits of the export."""

    @classmethod
    def of(
        cls, rng: Rng, plant: Plant, law: Law, seconds: float, noise: float, period: int = 2, **body: object
    ) -> Run:
        """Begin at rest, OP between 0 and 100 and PV somewhere."""
        op0 = float(body.pop("op0", rng.uniform(40.0, 60.0)))  # type: ignore[arg-type]
        high = float(body.pop("op_high", 100.0))  # type: ignore[arg-type]
        what = Inputs.quiet(int(seconds))
        what.noise = noise * rng.standard_normal(int(seconds))
        pv0 = float(np.round(rng.uniform(30.0, 80.0)))
        whole = Body(plant, law, -op0, high - op0, **body)  # type: ignore[arg-type]
        return cls(whole, what, period, pv0, op0)

    def setpoint(self, *steps: tuple[float, float]) -> Run:
        """Let the set point stand off by so much [PV] from a time on [s]."""
        for at, value in steps:
            self.what.sp[int(at) :] = value
        return self

    def load(self, *steps: tuple[float, float]) -> Run:
        """Let the load at the process input be so much [OP] from a time on [s]."""
        for at, value in steps:
            self.what.load[int(at) :] = value
        return self

    def live(self) -> Lived:
        return live(self.body, self.what)

    def samples(self, lived: Lived | None = None) -> Samples:
        """Return what is recorded."""
        lived = self.live() if lived is None else lived
        at = np.arange(0, len(lived.pv), self.period)
        return samples_of(
            at * STEP_S,
            lived.sp[at] + self.pv0,
            lived.pv[at] + self.pv0,
            lived.op[at] + self.op0,
            self.digits,
        )


def samples_of(seconds: Floats, sp: Floats, pv: Floats, op: Floats, digits: int = 5) -> Samples:
    """Return columns as a historian's samples of one loop, PV and OP to so many significant digits."""
    time = np.round((START_S + seconds) * 1e9).astype(np.int64)
    return Samples.of(0, time, np.round(sp, 9), _rounded(pv, digits), _rounded(op, digits))


def _rounded(values: Floats, digits: int) -> Floats:
    top = float(np.abs(values).max()) or 1.0
    return np.round(values, digits - 1 - math.floor(math.log10(top)))
