"""The tree of verdicts: what comes before the tuning, and what a loop is told."""

from __future__ import annotations

from typing import Any

import pytest

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED, RETUNE, LoopRow
from monitor.health.diagnosis import Signs
from monitor.health.loop_health import Health
from monitor.health.valve import Valve
from monitor.verdict.in_force import InForce
from monitor.verdict.parts import Suggested, Tuning
from monitor.verdict.row import loop_row
from monitor.verdict.tree import TREE, WITHHOLDS

FLAGS = {
    "manual", "saturated", "stuck_pv", "idle", "stale", "oscillating", "stiction", "offset", "compressed",
    "undersampled", "mapping_suspect", "config_change", "cascade_slave", "noisy_op", "no_integral",
    "permanent_upset", "settings_mismatch", "exception_reported", "no_response", "two_valued_op",
    "near_instability",
}  # fmt: skip

LOOP = Loop(name="LIC-1", kp=2.0, ti=100.0, op_low=0.0, op_high=100.0)


def healthy(**facts: Any) -> Health:
    return Health(**{"coverage": 1.0, "manual": 0.0, "saturation": 0.0} | facts)


NEW = Suggested(
    action="set kp = 2.5, ti = 32 s",
    rule="simc-pi",
    form="standard",
    figures={"new_kp": 2.5, "new_ti": 32.0},
    stages="[]",
    fields="{}",
    today={"iae_setpoint": 30.0},
)


def tuned(verdict: str, ms: float = 1.6) -> Tuning:
    """Return what the events left."""
    return Tuning(
        verdict=verdict,
        reason="slow to follow: CI_sp = 0.3" if verdict == RETUNE else "",
        ms=ms,
        process="integrating",
        model={"gain": 0.05, "dead_time": 4.0, "lag": 0.0},
        suggested=NEW if verdict == RETUNE else None,
    )


def conclude(tuning: Tuning, loop: Loop, health: Health) -> LoopRow:
    """Return the row, which walks the tree."""
    return loop_row(InForce(loop), tuning, health)


SICK = {
    "stuck_pv": {"stuck": True},
    "mapping_suspect": {"mapping": True},
    "undersampled": {"undersampled": True},
    "saturated": {"saturation": 0.6},
    "stiction": {
        "signs": Signs(valve=Valve(2.1, "play", 0.8, 1)),
        "oscillation_period": 100.0,
        "oscillation_regularity": 0.9,
        "oscillating": True,
    },
    "oscillating": {"oscillation_period": 100.0, "oscillation_regularity": 0.9, "oscillating": True},
    "offset": {"settled_offset": True, "offset": 3.0},
}


@pytest.mark.parametrize("flag", SICK)
@pytest.mark.parametrize("verdict", [GOOD, RETUNE, NOT_ASSESSED])
def test_what_comes_before_the_tuning_withholds_it(flag, verdict):
    """Flagged, inconclusive, said in words and with an action; no figure of a suggestion is left."""
    row = conclude(tuned(verdict), Loop(name="LIC-1", op_low=0.0, op_high=100.0), healthy(**SICK[flag]))
    assert flag in row.flags
    assert row.verdict == INCONCLUSIVE
    assert row.reason
    assert row.action
    left = [n for n in row.__struct_fields__ if n.startswith("new_") and getattr(row, n) is not None]
    assert left + [n for n in ("rule", "form", "stages") if getattr(row, n) is not None] == []
    if verdict == RETUNE:
        assert row.iae_setpoint == 30.0  # what is predicted of today's settings stays
        assert "slow to follow" in row.reason
        assert "withheld" in row.reason


@pytest.mark.parametrize(
    ("flag", "found"), [("compressed", {"compression": 0.9}), ("exception_reported", {"dead_band": 0.25})]
)
@pytest.mark.parametrize("verdict", [GOOD, RETUNE, NOT_ASSESSED, INCONCLUSIVE])
def test_what_a_historian_did_is_said_beside_the_verdict(flag, found, verdict):
    """The model's intervals are wider there, and carry the suggestion or not; without events it is why."""
    row = conclude(tuned(verdict), LOOP, healthy(**found))
    assert row.flags == (flag,)
    assert row.verdict == verdict
    assert (
        "intervals are wider" in row.reason if flag == "compressed" else "dead band about 0.25" in row.reason
    )
    assert (row.new_kp == 2.5) == (verdict == RETUNE)
    if verdict in {NOT_ASSESSED, INCONCLUSIVE}:
        assert "switch" in row.action


def test_a_healthy_loop_keeps_its_verdict():
    """Nothing found: verdict, reason and suggestion stay as the events left them."""
    for verdict in (GOOD, RETUNE, INCONCLUSIVE):
        before, new_kp = tuned(verdict), 2.5 if verdict == RETUNE else None
        row = conclude(tuned(verdict), LOOP, healthy())
        assert (row.verdict, row.reason, row.new_kp, row.flags) == (verdict, before.reason, new_kp, ())


def test_an_oscillation_that_the_settings_explain_is_theirs():
    """Too close to instability, and a period that is the loop's own: the retune stands, flagged."""
    loop = Loop(name="LIC-1", kp=8.0, ti=100.0)  # gain 0.05, dead time 4 s: Ms 6, rolls with about 20 s
    row = conclude(
        tuned(RETUNE, ms=6.0),
        loop,
        healthy(oscillation_period=20.0, oscillation_regularity=0.9, oscillating=True),
    )
    assert (row.verdict, row.new_kp, row.flags) == (RETUNE, 2.5, ("oscillating", "near_instability"))


def test_an_oscillation_of_another_period_is_not_the_tuning():
    """The same nervous loop, but the cycle is twenty times slower than its own: it comes from outside."""
    loop = Loop(name="LIC-1", kp=8.0, ti=100.0)
    row = conclude(
        tuned(RETUNE, ms=6.0),
        loop,
        healthy(oscillation_period=400.0, oscillation_regularity=0.9, oscillating=True),
    )
    assert (row.verdict, row.new_kp) == (INCONCLUSIVE, None)
    assert "its settings do not explain" in row.reason


def test_too_much_integral_action_explains_a_slow_roll():
    """Kc K Ti = 0.5 at Ms within its limit: the trap, not the neighbour."""
    loop = Loop(name="LIC-1", kp=0.5, ti=20.0)  # natural frequency sqrt(0.05 * 0.5 / 20): a period of 178 s
    row = conclude(
        tuned(RETUNE, ms=1.9),
        loop,
        healthy(oscillation_period=170.0, oscillation_regularity=0.9, oscillating=True),
    )
    assert (row.verdict, row.flags) == (RETUNE, ("oscillating",))


def test_the_data_come_before_the_valve_and_the_valve_before_the_rest():
    """All at once: the first branch speaks, every flag is set."""
    everything: dict[str, Any] = {}
    for facts in SICK.values():
        everything |= facts
    row = conclude(tuned(RETUNE), Loop(name="LIC-1", op_high=100.0), healthy(**everything))
    assert row.reason.startswith("PV is frozen")
    assert set(SICK) <= set(row.flags)
    no_data_trouble = {
        k: v
        for k, v in everything.items()
        if k not in {"stuck", "mapping", "compression", "undersampled", "saturation"}
    }
    assert "valve sticks" in conclude(tuned(GOOD), LOOP, healthy(**no_data_trouble)).reason


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"manual": 0.9}, "in manual"),
        ({"held": 0.9}, "in manual"),
        ({"idle": True}, "idle"),
        ({"sp_moving": 0.9}, "cascade"),
        ({"coverage": 0.2}, "covered"),
    ],
)
def test_a_loop_without_events_is_told_why(facts, said):
    """Not assessed, with the reason that its health gives; with events the same is no reason to doubt them."""
    row = conclude(Tuning(), LOOP, healthy(**facts))
    assert row.verdict == NOT_ASSESSED
    assert said in row.reason
    assert conclude(tuned(RETUNE), LOOP, healthy(**facts)).verdict == RETUNE


def test_a_loop_without_integral_action_is_told_so():
    """P-only by its settings: the flag names the cause, not only the offset."""
    row = conclude(tuned(GOOD), Loop(name="LIC-1", kp=2.0), healthy(settled_offset=True, offset=3.0))
    assert row.flags == ("no_integral", "offset")
    assert "no integral action" in row.reason
    assert "+3" in row.reason


FAINT = Signs(valve=Valve(2.1, "play", 0.3, 1))
"""Something speaks for a valve, but not enough by itself."""


@pytest.mark.parametrize("shape", [0.0, 0.9])
def test_a_cycle_of_the_set_point_is_not_the_loop_s(shape):
    """Where the set point itself moves much of the time, neither valve nor loop is blamed for the error's cycle."""
    facts = SICK["oscillating"] | {"stiction": shape, "signs": FAINT}
    row = conclude(tuned(RETUNE), LOOP, healthy(**facts, sp_moving=0.3))
    assert (row.verdict, row.flags) == (RETUNE, ())


def test_the_shape_of_a_cycle_names_the_valve_only_where_op_speaks_for_it():
    """A load that is no sine gives a cycle that shape, too; with the band in OP it is said."""
    shaped = SICK["oscillating"] | {"stiction": 0.9}
    assert "stiction" not in conclude(tuned(GOOD), LOOP, healthy(**shaped)).flags
    assert "stiction" in conclude(tuned(GOOD), LOOP, healthy(**shaped, signs=FAINT)).flags
    banded = conclude(tuned(GOOD), LOOP, healthy(signs=SICK["stiction"]["signs"]))
    assert "OP travels 2.1 % after a reversal before PV answers" in banded.reason
    assert (banded.stiction, banded.dead_band) == (0.8, 2.1)


def test_rest_at_its_own_extreme_is_no_known_limit():
    """Without limits in the table the share is flagged, and withholds nothing."""
    row = conclude(tuned(RETUNE), Loop(name="LIC-1"), healthy(saturation=0.9))
    assert (row.verdict, row.flags, row.new_kp) == (RETUNE, ("saturated",), 2.5)


@pytest.mark.parametrize("facts", [{"controller": "p"}, {"controller": "pd"}, {"objective": "averaging"}])
def test_an_offset_that_is_meant_is_no_finding(facts):
    """A surge vessel, or a controller declared without integral action, may rest away from its set point."""
    loop = Loop(name="LIC-1", kp=2.0, **facts)
    row = conclude(tuned(GOOD), loop, healthy(settled_offset=True, offset=3.0))
    assert (row.verdict, row.flags, row.offset) == (GOOD, (), 3.0)


def test_a_slow_integral_is_no_missing_one():
    """Integral action is there, and the loop is to be retuned: its lasting error is what the retune cures."""
    off = healthy(settled_offset=True, offset=3.0)
    assert conclude(tuned(RETUNE), LOOP, off).verdict == RETUNE
    assert conclude(tuned(RETUNE), Loop(name="LIC-1"), off).verdict == INCONCLUSIVE
    assert conclude(tuned(GOOD), LOOP, off).flags == ("offset",)


def test_nothing_seen():
    """No sample at all."""
    assert conclude(Tuning(), LOOP, Health()).reason == "no good sample was seen"


def test_what_is_worth_a_word_is_said_where_nothing_else_is():
    """A loop without a step, its output at the limit for a fifth of the time: the reason holds both."""
    loop = Loop(name="TIC-1", op_low=0.0, op_high=100.0)
    row = conclude(tuned(NOT_ASSESSED), loop, healthy(saturation=0.2))
    assert row.reason == "no set-point move and no upset was seen; OP is at its limit for 20% of the time"
    assert row.flags == ("saturated",)


def test_every_branch_has_a_known_flag_and_an_action():
    """Flags are those of the contract; what withholds says what to do."""
    assert {b.flag for b in TREE if b.flag} <= FLAGS
    assert all(b.action for b in TREE if b.effect == WITHHOLDS)
