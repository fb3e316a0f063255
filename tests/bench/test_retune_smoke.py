"""A few loops of each case of the benchmark `retune`: it runs, repeats itself, and nothing is destabilised."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_plants.controllers import Controller
from sim_plants.plants import Plant
from sim_plants.specs import LoopSpec
from tests.bench.retune import HEAD, cause, describe, half_width, table_line, worst
from tests.bench.retune_fleet import CASES, SETPOINT, draw, record, table_row
from tests.bench.retune_judge import Outcome, judge, judge_many, turns_pi_into_pid
from tests.bench.retune_truth import index, sensitivity, stable

SEED = 11
"""Not the benchmark's own."""


@pytest.mark.parametrize("name", CASES)
def test_suggestions_are_safe_and_the_table_has_a_row(name: str) -> None:
    outcomes = [judge(CASES[name], k, SEED) for k in range(2)]
    assert len(table_line(name, outcomes).split()[0]) > 0
    for outcome in outcomes:
        assert not turns_pi_into_pid(outcome)
        assert outcome.ms_after is None or outcome.ms_after < 3.0
        assert outcome.row["new_ms_worst"] is None or outcome.row["new_ms_worst"] <= 2.2
        assert str(outcome.number) in describe(outcome)
        assert outcome.cured or not outcome.needs or cause(outcome)
        if CASES[name].kind == SETPOINT:
            assert outcome.events == 1
            assert outcome.others == 0
            assert half_width(outcome) < 1.0
    assert len(worst(outcomes)) <= 2
    assert "cured" in HEAD


def test_the_same_loop_whatever_the_chunk() -> None:
    whole, part = judge_many("noise1-sp", range(2), SEED), judge_many("noise1-sp", range(1, 2), SEED)
    alike = [replace(o, cost=0.0) for o in (whole[1], part[0])]
    assert repr(alike[0]) == repr(alike[1])
    assert isinstance(whole[0], Outcome)


def test_cases_of_a_fleet_show_the_same_plants() -> None:
    one, other = (draw(CASES[name], 4, SEED, stable) for name in ("clean-sp", "noise3-ld"))
    assert one.plant == other.plant
    assert one.controller == other.controller
    assert one.noise == 0 < other.noise


def test_bad_data_lose_repeat_and_spoil() -> None:
    case = CASES["bad-sp"]
    spec = draw(case, 1, SEED, stable)
    good, bad = record(spec, bad_data=False), record(spec, bad_data=True)
    steps = np.diff(bad.time)
    assert (steps == 0).any()
    assert (steps > 1.5 * spec.period_ns).any()
    assert len(np.unique(bad.time)) < len(good)
    spoilt = np.isnan(bad.pv) | np.isnan(bad.op) | np.isnan(bad.sp)
    assert 0 < spoilt.mean() < 0.03
    assert table_row(spec, case).op_span is None


@pytest.mark.parametrize(
    ("process", "lag", "kp", "ti", "kind"),
    [("integrating", (), 0.5, 8.0, "load"), ("integrating", (), 0.5, 8.0, "setpoint")],
)
def test_the_reference_scores_one(
    process: str, lag: tuple[float, ...], kp: float, ti: float, kind: str
) -> None:
    """e^-s/s under SIMC PI, sampled finely: CI is 1 and Ms 1.70 (Skogestad 2003)."""
    spec = LoopSpec("x", Plant(process, 1.0, 1.0, lag), Controller(kp, ti), period=0.01)  # type: ignore[arg-type]
    loop = table_row(spec, CASES["pi-sp"])
    assert index(spec, loop, spec.controller, kind) == pytest.approx(1.0, abs=0.01)
    assert sensitivity(spec, spec.controller) == pytest.approx(1.704, abs=0.01)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_the_limit_of_stability_is_found(factor: float) -> None:
    """The gain at which e^-s/s with an integral action next to none begins to swing is pi/2."""
    spec = LoopSpec("x", Plant("integrating", 1.0, 1.0), Controller(factor * math.pi / 2, 1e6), period=0.001)
    assert math.isfinite(sensitivity(spec, spec.controller)) == (factor < 1)
