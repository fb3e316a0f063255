"""A retune in parts: what is in force, what follows, and that a restart goes on with it."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import msgspec

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE, LoopRow, Plan
from monitor.engine import Engine
from monitor.memory import LoopMemory, decode, encode
from monitor.verdict.plan import at_aim, part_of
from tests.support.plants import stepped
from tuners.settings import Settings

SLOW = Loop(name="L", kp=0.15, ti=700.0, process="integrating")
PLAN = Plan(
    loop="L",
    form="standard",
    stages=(
        {"kp": 2.0, "ti": 80.0, "td": 0.0, "tf": 0.0},
        {"kp": 3.0, "ti": 60.0, "td": 0.0, "tf": 0.0},
    ),
)


def test_a_part_is_known_by_gain_and_integral_time():
    """What was typed in is a stage to some digits; the last one is the aim, of which nothing is to come."""
    assert part_of(PLAN, Settings(2.1, 78.0))
    assert not part_of(PLAN, Settings(2.5, 80.0))
    assert not part_of(PLAN, Settings(2.0, math.inf))
    assert part_of(PLAN, Settings(3.0, 60.0))
    assert not part_of(PLAN, None)
    assert at_aim(PLAN, Settings(3.0, 60.0))
    assert not at_aim(PLAN, Settings(2.0, 80.0))
    assert not at_aim(PLAN, None)


def after(engine: Engine, loop: Loop, part: int) -> LoopRow:
    """Step the set point of a loop that runs under these settings; return its row."""
    samples = stepped(4000, kp=loop.kp or 0.0, ti=loop.ti, noise=0.02, seed=part)
    engine.step(replace(samples, time=samples.time + part * 4000 * 10**9))
    engine.flush()
    return engine.row(0)


def typed_in(loop: Loop, row: LoopRow) -> Loop:
    assert row.new_kp is not None
    return msgspec.structs.replace(loop, kp=row.new_kp, ti=row.new_ti or math.inf)


def test_a_retune_goes_on_part_by_part_over_a_restart():
    """What is typed in now is the first of the stages; the next part follows a step under it, whoever has forgotten."""
    engine, loop = Engine(LoopTable([SLOW])), SLOW
    rows = [after(engine, loop, 0)]
    for part in range(1, 8):
        row = rows[-1]
        if row.verdict != RETUNE:
            break
        stages = json.loads(row.stages or "")
        assert stages[0]["kp"] == row.new_kp
        loop = typed_in(loop, row)
        engine.retuned(0, loop)
        if len(stages) > 1:
            assert engine.row(0).verdict == INCONCLUSIVE
            known = decode(encode(engine.remember(0)))
            assert isinstance(known, LoopMemory)
            assert known.history is not None
            assert known.history.under_way
            engine, before = Engine(LoopTable([SLOW])), engine
            engine.recall(0, before.declared(0), before.loops[0], known)
            assert engine.row(0) == before.row(0)
        rows.append(after(engine, loop, part))
    assert len(rows) > 2
    assert rows[-1].verdict == GOOD
    assert rows[-1].ci_setpoint is not None
    assert rows[-1].ci_setpoint > 0.6
    said = " ".join(r.action for r in rows)
    assert "part of the way" in said
    assert "go back to kp = 0.15" in said


def test_another_hand_ends_a_plan():
    """Settings that nobody suggested: nothing is under way."""
    engine = Engine(LoopTable([SLOW]))
    after(engine, SLOW, 0)
    history = engine.remember(0).history
    assert history is not None
    assert history.plan is not None
    engine.retuned(0, msgspec.structs.replace(SLOW, kp=0.2))
    assert history.plan is None
