"""Words of the branches that blocks feed: each with another cause of the same symptom beside it."""

from __future__ import annotations

from typing import Any

import pytest

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED, RETUNE, LoopRow
from monitor.health.cycle_gain import CycleGain
from monitor.health.diagnosis import Signs
from monitor.health.episodes import LoopSpan
from monitor.health.loop_health import Health
from monitor.health.response import NoResponse
from monitor.verdict.in_force import InForce
from monitor.verdict.parts import Tuning
from monitor.verdict.row import loop_row

LOOP = Loop(name="LIC-1", kp=2.0, ti=82.0, op_low=0.0, op_high=100.0, process="integrating")
NS = 10**9
DAY = 1_772_409_600  # 2026-03-02


def concluded(signs: Signs, tuning: Tuning | None = None, loop: Loop = LOOP, **health: Any) -> LoopRow:
    facts = {"coverage": 1.0, "manual": 0.0, "saturation": 0.0} | health
    return loop_row(InForce(loop), tuning or Tuning(), Health(signs=signs, **facts))


def silent(kind: str = "no_answer", error: float = 5.0, way: float = 40.0) -> Signs:
    stretch = NoResponse(kind, 0, 700, error, way, None, False)  # type: ignore[arg-type]
    return Signs(silent=stretch, silent_time=7200.0)


def test_an_output_that_ramps_at_a_shut_valve_is_no_matter_of_integral_action():
    """PV below its set point for two hours while OP goes up; nothing is said of adding integral action."""
    row = concluded(silent(), offset=5.0, settled_offset=True)
    assert (row.verdict, row.flags) == (INCONCLUSIVE, ("no_response",))
    assert "PV does not answer OP: OP went by +40 [OP] in 2 h, and PV stayed -5 [PV]" in row.reason
    assert "valve" in row.action
    assert "add integral" not in f"{row.reason} {row.action}"


def test_an_output_that_goes_the_wrong_way_and_one_that_hardly_moves_are_told_apart():
    """With the sign of kp; and an integral far too slow."""
    assert "wrong way" in concluded(silent(way=-40.0)).reason
    assert "integral action is far too slow" in concluded(silent("slow_integral", way=0.5)).reason
    held = concluded(silent("held", way=0.0), offset=5.0, settled_offset=True)
    assert held.flags == ("offset",) or "offset" not in held.flags


@pytest.mark.parametrize("verdict", [GOOD, RETUNE])
def test_a_loop_whose_events_show_how_pv_answers_is_not_said_to_be_silent(verdict):
    """A slow one may stay away from its set point for the length of a block."""
    assert concluded(silent(), Tuning(verdict=verdict, reason="slow to follow")).verdict == verdict


def cycling(share: float = 1.0, **facts: Any) -> Signs:
    span = LoopSpan(DAY * NS, (DAY + 28_800) * NS, 1800.0, 0.8, True)
    return Signs(oscillating=True, oscillating_share=share, cycle_period=1800.0, spans=(span,), **facts)


def test_hunting_by_the_hour_is_said_with_its_hours():
    """A third of the time; a loop that cycles all the time needs no times."""
    row = concluded(cycling(0.33))
    assert (
        "it oscillates with a period of 30 min, 33% of the time (2026-03-02T00:00:00 to 2026-03-02T08:00:00)"
        in row.reason
    )
    assert (row.oscillation_period, row.oscillating_share) == (1800.0, 0.33)
    assert "of the time" not in concluded(cycling()).reason


def gain(value: float, integrating: bool = True) -> CycleGain:
    return CycleGain(1800.0, 8, 0.8, 5.0, -1.6, value, 0.9 * value, 1.1 * value, 70.0, integrating)


def test_the_integral_trap_is_named_from_a_cycle_alone():
    """Kc K Ti = 0.08, and the period that follows from it: 2 pi sqrt(Ti/(Kc K)) = 1,790 s. No settings are advised."""
    row = concluded(cycling(gain=gain(0.0005)))
    assert "integral action is too strong for the gain: Kc K Ti = 0.082" in row.reason
    assert "lengthen the integral time" in row.action
    assert (row.verdict, row.new_kp) == (INCONCLUSIVE, None)


@pytest.mark.parametrize("other", [gain(0.05), gain(0.0005, integrating=False), None])
def test_another_cycle_has_another_source(other):
    """A gain at which this loop would swing twenty times as fast; a phase that no integrator has; nothing known."""
    row = concluded(cycling(gain=other))
    assert "integral action" not in row.reason
    assert "find the source" in row.action


def test_a_quick_loop_that_follows_its_set_point_is_good():
    """Its dead time cannot be seen; what rings or creeps is said, and is not good; a retune stands."""
    signs = Signs(tracks="tracks", follows_within=30.0, period=10.0)
    for verdict in (NOT_ASSESSED, INCONCLUSIVE):
        row = concluded(signs, Tuning(verdict=verdict, reason="the gain is known only to lie in ..."))
        assert (row.verdict, row.action) == (GOOD, "none")
        assert "follows the set point within 30 s" in row.reason
        assert "samples of 10 s" in row.reason
    assert concluded(signs, Tuning(verdict=RETUNE, reason="slow")).verdict == RETUNE
    rings = concluded(Signs(tracks="rings"), Tuning(verdict=INCONCLUSIVE, reason="wide"))
    assert (rings.verdict, "rings" in rings.reason) == (INCONCLUSIVE, True)


def test_a_pv_that_never_moved_is_frozen_and_not_one_that_is_reported_on_change():
    """Held values between rows are the gateway's."""
    assert concluded(Signs(rests=True)).flags == ("stuck_pv",)
    assert "stuck_pv" not in concluded(Signs(rests=True), dead_band=0.5).flags


def test_a_loop_near_instability_is_marked_from_a_quarter_above_its_limit():
    """The loop table's own limit counts; the verdict is the tuning's."""
    tuning = Tuning(verdict=RETUNE, reason="too close to instability", ms=2.76)
    assert concluded(Signs(), tuning).flags == ("near_instability",)
    assert concluded(Signs(), tuning).verdict == RETUNE
    assert concluded(Signs(), Tuning(verdict=GOOD, ms=2.74)).flags == ()
    assert concluded(Signs(), tuning, Loop(name="LIC-1", kp=2.0, ti=82.0, ms_max=3.0)).flags == ()


@pytest.mark.parametrize(("of_events", "doubted"), [(0.0013, True), (0.0006, False)])
def test_a_gain_that_the_cycle_contradicts_carries_no_settings(of_events, doubted):
    """The loop rolls by itself: its amplitudes show 0.0005. Settings for 0.0013 would make it roll more."""
    model = {"gain": of_events, "dead_time": 20.0, "lag": 0.0}
    tuning = Tuning(RETUNE, "too close to instability", ms=6.0, process="integrating", model=model)
    row = concluded(cycling(gain=gain(0.0005)), tuning)
    assert ("by its amplitudes the gain is 0.0005 [PV/(OP s)], by the events 0.0013" in row.reason) is doubted
    assert row.verdict == (INCONCLUSIVE if doubted else RETUNE)
