"""What is known of a loop goes through bytes unchanged; what is damaged or another version's is refused."""

from __future__ import annotations

import math
from typing import Any, get_args, get_type_hints

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor import memory
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import Assessment
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.memory import LoopMemory, WaitingEvent, decode, encode
from sim_plants.loops import Simulation
from sim_plants.scenarios import SCENARIOS
from sim_plants.truth import loop_table
from tests.support.plants import stepped

SECONDS, HALF = 3000, 1900


@pytest.fixture(scope="module")
def plant():
    """The demo's loops and their samples."""
    loops = SCENARIOS["demo"](3)
    block = Simulation(loops, 1_767_225_600).advance(SECONDS)
    return [parse_row(row)[0] for row in loop_table(loops)], Samples.of(
        block.loop, block.time_ns, block.sp, block.pv, block.op, block.auto
    )


def taken_over(engine: Engine, table: list[Loop]) -> Engine:
    """Another engine that goes on with what this one knows."""
    other = Engine(LoopTable(table))
    for row in range(len(table)):
        known = decode(encode(engine.remember(row)))
        assert isinstance(known, LoopMemory)
        other.recall(row, engine.declared(row), engine.loops[row], known)
    for waiting in engine.waiting:
        known = decode(encode(waiting))
        assert isinstance(known, WaitingEvent)
        other.waiting.append(known)
    return other


def test_all_rows_are_as_they_were_and_events_that_wait_are_assessed(plant):
    """Verdicts, settings, health and flags; nothing of it counts as a sample of the new engine."""
    table, samples = plant
    engine = Engine(LoopTable(table))
    engine.step(samples.take(slice(0, len(samples) // 2)))
    engine.detect(samples.take(slice(len(samples) // 2, None)))
    other = taken_over(engine, table)
    assert other.waiting
    assert [other.row(k) for k in range(len(table))] == [engine.row(k) for k in range(len(table))]
    assert other.seen.counts()["ok"] == 0
    said, again = engine.assess(), other.assess()
    found = [r for r in said if isinstance(r, Assessment)]
    assert found
    assert found == [r for r in again if isinstance(r, Assessment)]
    # samples in which the controller was still to be looked at are not kept: what they would have shown comes again
    told = ("verdict", "action", "events", "new_kp", "new_ti", "flags")
    for k in range(len(table)):
        assert [getattr(other.row(k), n) for n in told] == [getattr(engine.row(k), n) for n in told]


def test_after_a_restart_events_are_found_and_judged_with_what_was_known(plant):
    """Samples go on as after a gap: each loop's next events are numbered on, and its model rests on all of them."""
    table, samples = plant
    first = samples.time < samples.time[0] + HALF * 10**9
    engine = Engine(LoopTable(table))
    before = [r for r in engine.step(samples.take(first)) if isinstance(r, Assessment)]
    other = taken_over(engine, table)
    after = [r for r in other.step(samples.take(~first)) if isinstance(r, Assessment)]
    assert before
    assert after
    for name in {r.loop for r in before} & {r.loop for r in after}:
        numbers = [r.event for r in [*before, *after] if r.loop == name]
        assert numbers == list(range(1, len(numbers) + 1))
    assert other.seen.counts()["ok"] == int(np.sum(~first))


def test_settings_that_were_said_hold_unless_the_table_is_another_one():
    """A restart with the same table keeps them; a row that was edited meanwhile is the news."""
    table = Loop(name="L", key="plant/L", kp=1.0, ti=40.0, process="integrating")
    engine = Engine(LoopTable([table]))
    engine.step(stepped(3000, kp=1.0, ti=40.0))
    said = msgspec.structs.replace(table, kp=2.5)
    engine.retuned(0, said)
    same = taken_over(engine, [table])
    assert same.loops[0].kp == 2.5
    assert same.declared(0) == table
    assert taken_over(same, [table]).loops[0].kp == 2.5
    edited = msgspec.structs.replace(table, kp=0.7, ti=math.inf)
    other = taken_over(engine, [edited])
    assert other.loops[0] == edited == other.declared(0)
    assert other.row(0).events == engine.row(0).events
    settings_only = Engine(LoopTable([table]))
    settings_only.recall(0, table, said, None)
    assert settings_only.loops[0].kp == 2.5


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=200))
def test_rubbish_is_refused(payload):
    with pytest.raises(ValueError, match="not what was remembered"):
        decode(payload)


def test_torn_and_altered_bytes_are_refused_or_read(plant):
    """Nothing but ValueError comes of bytes that were altered anywhere."""
    table, samples = plant
    engine = Engine(LoopTable(table))
    engine.step(samples.take(samples.time < samples.time[0] + HALF * 10**9))
    whole = encode(engine.remember(0))
    rng = np.random.default_rng(5)
    refused = 0
    for _ in range(300):
        altered = bytearray(whole)
        altered[rng.integers(len(whole))] = rng.integers(256)
        for payload in (bytes(altered), whole[: rng.integers(len(whole))]):
            try:
                decode(payload)
            except ValueError:
                refused += 1
    assert refused > 300


def kinds_within(kind: Any, found: set[type]) -> set[type]:
    """Add our records of which values of a kind may be made, as their annotations have them."""
    for part in get_args(kind):
        kinds_within(part, found)
    ours = isinstance(kind, type) and kind.__module__.split(".")[0] in {"monitor", "tuners"}
    if ours and kind not in found:
        found.add(kind)
        hints = get_type_hints(kind)
        for name in memory._names(kind):
            kinds_within(hints[name], found)
    return found


@pytest.mark.parametrize("whole", [LoopMemory, WaitingEvent])
def test_every_record_within_is_of_a_known_kind(whole):
    """One that a station adds to what it knows is added here, too: else the first such value would end the monitor."""
    assert kinds_within(whole, set()) <= set(memory._KINDS.values())


def test_what_is_no_fact_is_not_written():
    engine = Engine(LoopTable([Loop(name="L")]))
    known = engine.remember(0)
    known.numbers["x"] = object()  # type: ignore[assignment]
    with pytest.raises(TypeError, match="object is no kind of fact"):
        encode(known)
