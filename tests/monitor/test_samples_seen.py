"""Samples are counted once, whoever's row they came in."""

from __future__ import annotations

from monitor.contract.loops import Loop, LoopTable
from monitor.engine import Engine
from tests.support.plants import stepped


def test_samples_of_another_process_are_not_ours_and_those_of_retired_loops_stay() -> None:
    samples = stepped(1000, kp=1.0, ti=40.0)
    engine = Engine(LoopTable([Loop(name="L")]))
    engine.step(samples)
    n = engine.seen.counts()["ok"]
    assert n == len(samples)
    assert engine.seen.last(0).time == samples.time[-1]
    other = Engine(LoopTable([Loop(name="L")]))
    other.recall(0, engine.declared(0), engine.loops[0], engine.remember(0))
    assert other.seen.counts()["ok"] == 0
    engine.retire(0)
    assert engine.seen.counts()["ok"] == n
