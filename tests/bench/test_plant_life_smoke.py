"""The benchmark of plant life: what is drawn is what is said, the judge knows right from wrong, a few loops of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE, LoopRow
from tests.bench.mismatch_plant import Law
from tests.bench.mismatch_shapes import simple
from tests.bench.mismatch_sim import Rig, Valve
from tests.bench.plant_life import HEAD, describe, table_line, totals, watch
from tests.bench.plant_life_days import swing
from tests.bench.plant_life_fleet import (
    BACKLASH,
    FROZEN,
    HEALTHY,
    HUNTING,
    INTEGRAL,
    MANUAL,
    MIX,
    NAMES,
    NO_RESPONSE,
    RELAY,
    SATURATED,
    SINE,
    SLOW,
    STICK,
    draw,
)  # fmt: skip
from tests.bench.plant_life_recording import drawn, held
from tests.bench.plant_life_sim import Body, Inputs, live
from tests.bench.plant_life_truth import ANSWERS, RIGHT, SILENT, WRONG, Facts, Said, judge
from tests.bench.plant_life_world import lead

SEED = 5
"""Not the benchmark's own."""
HOURS = 6 / 24
"""Length of a smoke test's life [days]."""


def test_the_simulator_is_that_of_mismatch_where_nothing_is_added() -> None:
    plant, law = simple("self-regulating", 1.5, 4.0, [20.0, 5.0]), Law(0.8, 25.0, 0.0, 0.0)
    rng = np.random.default_rng(1)
    what = Inputs.quiet(2000)
    what.sp[100:], what.load[900:], what.noise = 3.0, 2.0, 0.1 * rng.standard_normal(2000)
    for valve in (Valve(), Valve("backlash", 1.0), Valve("stiction", 2.0, 0.5), Valve("rate", 0.3)):
        mine = live(Body(plant, law, -50.0, 50.0, valve), what)
        pv, op = Rig(plant, law, 1.0, 1, valve, -50.0, 50.0).run(what.sp, what.load, what.noise)
        np.testing.assert_allclose(mine.pv, pv, atol=1e-9)
        np.testing.assert_allclose(mine.op, op, atol=1e-9)


def test_automatic_takes_over_without_a_bump_and_pulses_carry_the_demand() -> None:
    plant, law = simple("self-regulating", 1.0, 2.0, [30.0]), Law(1.0, 30.0, 0.0, 0.0)
    what = Inputs.quiet(3000)
    what.auto[500:1500] = False
    what.moved[600] = 5.0
    lived = live(Body(plant, law, -50.0, 50.0), what)
    assert lived.op[1499] == pytest.approx(5.0)
    assert abs(lived.op[1500] - lived.op[1499]) < 0.1 * law.kp * abs(lived.pv[1499]) + 1e-6
    pulsed = live(Body(plant, law, -50.0, 50.0, pulses=20), Inputs.quiet(3000))
    assert set(np.unique(pulsed.op)) == {-50.0, 50.0}
    assert np.mean(pulsed.op[-1000:]) == pytest.approx(0.0, abs=3.0)
    assert abs(np.mean(pulsed.true[-1000:])) < 3.0


@pytest.mark.parametrize("kind", NAMES)
def test_every_kind_lives_as_it_says(kind: str) -> None:
    life = lead(kind, 3, SEED, HOURS)
    facts = life.facts
    assert np.isfinite(life.samples.pv).all()
    assert (np.diff(life.samples.time) > 0).all()
    assert np.isfinite(facts.ms)
    true = {
        HEALTHY: facts.ms <= 1.9 and min(facts.ci.values(), default=0.0) >= 0.7,
        SLOW: max(facts.ci.values(), default=1.0) <= 0.4,
        INTEGRAL: 3.0 <= facts.ms <= 12.0,
        SATURATED: facts.saturation > 0.2,
        MANUAL: facts.manual > 0.5,
        FROZEN: facts.frozen > 0.3,
        NO_RESPONSE: facts.shut > 0.3,
        SINE: facts.cycles > 2.0,
        HUNTING: facts.cycles > 2.0,
        STICK: facts.band_sd > 0.0,
        BACKLASH: facts.band_sd > 0.0,
        RELAY: len(np.unique(life.samples.op)) == 2 or facts.how != "raw",
    }
    assert true.get(kind, True)
    again = lead(kind, 3, SEED, HOURS)
    np.testing.assert_array_equal(again.samples.pv, life.samples.pv)
    assert again.table == life.table


def test_an_archive_keeps_within_its_band() -> None:
    values = np.cumsum(np.random.default_rng(2).standard_normal(3000))
    assert np.abs(held(values, 1.5) - values).max() <= 1.5
    assert np.abs(drawn(values, 1.5) - values).max() <= 3.0
    assert len(np.unique(held(values, 1.5))) < 2000
    assert np.abs(np.diff(drawn(values, 1.5), 2)).astype(bool).mean() < 0.99


@pytest.mark.parametrize("shape", ["sine", "square", "triangle"])
def test_waves_have_unit_amplitude(shape: str) -> None:
    wave = swing(shape, np.arange(1000) / 100)
    assert (wave.min(), wave.max()) == (pytest.approx(-1.0), pytest.approx(1.0))
    assert wave.mean() == pytest.approx(0.0, abs=0.02)


def _judged(kind: str, row: LoopRow, facts: Facts, ms_after: float = float("nan")) -> tuple[str, str]:
    return judge(Said(row, draw(kind, 0, SEED), facts, ms_after))


def test_the_judge_knows_right_silent_and_wrong() -> None:
    clean = Facts(noise=0.1, clean=3, samples_in_natural=10.0, how="raw")
    good, retune = LoopRow(loop="x", verdict=GOOD), LoopRow(loop="x", verdict=RETUNE, new_kp=1.0, new_ti=50.0)
    assert _judged(HEALTHY, good, clean)[0] == RIGHT
    assert _judged(HEALTHY, LoopRow(loop="x"), clean)[0] == SILENT
    assert _judged(HEALTHY, retune, clean, 1.5)[0] == WRONG
    assert _judged(SLOW, retune, clean, 1.5)[0] == RIGHT
    assert _judged(SLOW, retune, clean, 3.5) == (WRONG, "settings that do harm: Ms above 3")
    assert _judged(SLOW, retune, clean, float("inf")) == (WRONG, "settings that do harm: unstable")
    assert _judged(SLOW, good, clean)[0] == WRONG
    valve = replace(clean, band_sd=5.0)
    named = LoopRow(
        loop="x", verdict=INCONCLUSIVE, flags=("stiction", "oscillating"), reason="the valve sticks"
    )
    assert _judged(STICK, named, valve)[0] == RIGHT
    assert _judged(STICK, good, valve)[0] == WRONG
    assert _judged(STICK, good, replace(valve, band_sd=1.0))[0] == SILENT
    assert _judged(SINE, named, replace(clean, cycles=20.0, wave_sd=5.0))[0] == WRONG
    sign = LoopRow(
        loop="x", verdict=INCONCLUSIVE, reason="gain and kp have opposite signs: check the loop table"
    )
    assert _judged(HEALTHY, sign, clean)[0] == WRONG
    stuck = LoopRow(loop="x", flags=("stuck_pv",))
    assert _judged(HEALTHY, stuck, clean) == (WRONG, "flag stuck_pv")
    assert _judged(FROZEN, stuck, replace(clean, frozen=0.9))[0] == RIGHT


def test_every_kind_has_an_answer_and_the_mix_has_enough_healthy_ones() -> None:
    assert set(ANSWERS) == set(NAMES)
    assert 0.2 < MIX.count(HEALTHY) / len(MIX) < 0.4


def test_a_few_loops_are_judged_and_written_of() -> None:
    outcomes = [watch(kind, 1, SEED, HOURS) for kind in (HEALTHY, SINE)]
    assert not any(o.why == "crash" for o in outcomes)
    assert all(o.outcome in {RIGHT, SILENT, WRONG} for o in outcomes)
    assert table_line("all", outcomes).startswith("all")
    assert "deserve" in HEAD
    assert any("valve precision" in line for line in totals(outcomes))
    assert len(describe(outcomes).splitlines()) == sum(o.outcome == WRONG for o in outcomes)
