"""A loop's events together: one sharper model, contradictions, new settings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from monitor.contract.loops import Loop, LoopTable
from monitor.contract.records import GOOD, INCONCLUSIVE, RETUNE, Suggestion
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.verdict.history import MOST_FINDINGS
from tests.support.plants import START, pi_loop, stepped, times
from tests.support.runs import run


def treads(sizes: list[float], apart: int = 500, **facts: Any) -> Samples:
    """Set-point steps one after the other, each with time to settle."""
    sp = np.full(apart * (len(sizes) + 1), 50.0)
    for k, size in enumerate(sizes):
        sp[apart * (k + 1) :] += size
    pv, op = pi_loop(sp, **facts)
    return Samples.of(0, times(len(sp)), sp, pv, op)


def test_several_events_are_one_sharper_model():
    """Three agreeing events: all count, the gain's interval is no wider than the first's."""
    engine, seen = run(Loop(name="L", kp=2.0, ti=40.0), treads([4.0, -4.0, 4.0], noise=0.05))
    row, first = engine.row(0), seen.assessments[0]
    assert row.events == len(seen.assessments) == 3
    assert row.gain_lo is not None
    assert row.gain_hi is not None
    assert first.gain_lo is not None
    assert first.gain_hi is not None
    assert row.gain_hi / row.gain_lo <= 1.01 * first.gain_hi / first.gain_lo
    assert row.gain_lo < 0.05 < row.gain_hi


def test_contradicting_events_are_no_evidence():
    """A plant whose gain has doubled between two events: said, and nothing suggested."""
    one = treads([4.0], apart=900, kp=0.5, ti=150.0, noise=0.02)
    two = treads([4.0], apart=900, kp=0.5, ti=150.0, noise=0.02, gain=0.1)
    samples = Samples.of(
        0,
        np.concatenate([one.time, two.time + (one.time[-1] - START) + 1_000_000_000]),
        np.concatenate([one.sp, two.sp]),
        np.concatenate([one.pv, two.pv]),
        np.concatenate([one.op, two.op]),
        auto=np.concatenate([np.arange(len(one)) < len(one) - 5, np.ones(len(two), bool)]),
    )
    engine, seen = run(Loop(name="L", kp=0.5, ti=150.0, process="integrating"), samples)
    assert [a.verdict for a in seen.assessments] == [RETUNE, RETUNE]
    row = engine.row(0)
    assert row.verdict == INCONCLUSIVE
    assert "contradict" in row.reason
    assert row.new_kp is None


def test_new_settings_begin_anew():
    """After a re-tune the past indices and suggestions no longer speak for the loop; the next event does."""
    engine = Engine(LoopTable([Loop(name="L", kp=0.4, ti=300.0)]))
    engine.step(stepped(4000, kp=0.4, ti=300.0, noise=0.02))
    engine.flush()
    assert engine.verdict(0) == RETUNE
    engine.retuned(0, Loop(name="other", kp=2.0, ti=40.0))
    assert engine.verdict(0) != RETUNE
    assert engine.row(0).new_kp is None
    assert engine.loops[0].name == "L"
    later = stepped(noise=0.02)
    engine.step(replace(later, time=later.time + 10_000 * 1_000_000_000))
    engine.flush()
    assert engine.row(0).verdict == GOOD
    assert engine.row(0).kp == 2.0


def test_history_does_not_grow():
    """However many events, so many findings are kept."""
    engine, seen = run(Loop(name="L", kp=2.0, ti=40.0), treads([2.0, -2.0] * 15, apart=250, noise=0.02))
    assert len(seen.assessments) == 30
    assert engine.row(0).events == 30
    assert len(engine._histories[0].findings) == MOST_FINDINGS


def test_events_that_contradict_take_the_suggestion_back():
    """A loop that was to be retuned, then shows four times the gain: no suggestion is said with that verdict."""
    loop = Loop(name="L", kp=0.05, ti=200.0, process="integrating")
    engine = Engine(LoopTable([loop]))
    first = stepped(2500, kp=0.05, ti=200.0, noise=0.005)
    later = stepped(2500, kp=0.05, ti=200.0, gain=0.2, noise=0.005)
    later = replace(later, time=later.time + 10**14)
    said = engine.step(first) + engine.assess() + engine.flush()
    assert any(isinstance(r, Suggestion) for r in said)
    said = engine.step(later) + engine.flush()
    assert engine.row(0).verdict == INCONCLUSIVE
    assert "contradict" in engine.row(0).reason
    assert not any(isinstance(r, Suggestion) for r in said)


def test_the_suggestion_comes_to_rest():
    """What each step leaves open is noise, small steps leave more of it: events add up, they do not take turns.

    Of the steps that show no error of the model the first one was taken: gain 2.3, 1.12, 2.3, 1.61, 2.3 ...
    """
    sizes = [4.0, -4.0, -2.3, 2.3] * 3
    samples = treads(sizes, apart=700, kp=0.6, ti=45.0, gain=0.03, noise=0.05)
    engine, kps = Engine(LoopTable([Loop(name="L", kp=0.6, ti=45.0, process="integrating")])), []
    for part in np.array_split(np.arange(len(samples)), len(sizes) + 1):
        engine.step(Samples(*(getattr(samples, name)[part] for name in samples.__slots__)))
        kps.append(engine.row(0).new_kp)
    last = [kp for kp in kps[-5:] if kp is not None]
    assert len(last) == 5
    assert max(last) < 1.05 * min(last)
    assert min(last) >= max(kp for kp in kps if kp is not None)
