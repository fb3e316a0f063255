"""Samples in, records out: the same however they are batched; verdicts and suggestions against the truth."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from monitor.contract.loops import OBJECTIVES, Loop, LoopTable
from monitor.contract.records import GOOD, NOT_ASSESSED, RETUNE, LoopRow, Record, Window
from monitor.contract.samples import Samples
from monitor.engine import Engine
from sim_plants.fleet import random_fleet
from sim_plants.loops import Simulation
from sim_plants.margins import margin
from tests.support.plants import samples_of, stepped, table_of, times
from tests.support.runs import run


def plain(records: list[Record]) -> list[Any]:
    """Records in a form that compares, to the last bit."""
    out: list[Any] = []
    for r in records:
        if isinstance(r, Window):
            out.append(
                (r.id, r.onset, *(getattr(r, n).tobytes() for n in ("time", "sp", "pv", "op", "model")))
            )
        else:
            out.append(repr(r))
    return out


def of_loop(records: list[Record], name: str) -> list[Any]:
    return plain([r for r in records if (getattr(r, "row", None) or r).loop == name])


FLAGGED = {"sluggish", "rolling", "aggressive"}


def test_verdicts_are_the_truth(watched):
    """Sluggish, rolling and aggressive loops are flagged; good and published ones never; manual is said."""
    specs, engine, _ = watched
    for k, spec in enumerate(specs):
        row = engine.row(k)
        expected = RETUNE if spec.tuning in FLAGGED else GOOD
        if spec.tuning == "manual":
            expected = NOT_ASSESSED
            assert "manual" in row.reason
            assert "manual" in row.flags
        assert row.verdict == expected, (spec.name, spec.tuning, row.reason)


def test_reasons_name_the_trouble(watched):
    """Slow is called slow, rolling is told the trap, near instability is said with its Ms."""
    specs, engine, _ = watched
    words = {
        "sluggish": "slow to follow",
        "rolling": "a lower gain makes it worse",
        "aggressive": "instability",
    }
    for k, spec in enumerate(specs):
        if spec.tuning in words:
            assert words[spec.tuning] in engine.row(k).reason


def test_models_are_the_true_ones(watched):
    """Kind of process and gain within 5 %; the sum of lags and dead time within 15 %."""
    specs, engine, _ = watched
    for k, spec in enumerate(specs):
        row = engine.row(k)
        if spec.tuning == "manual":
            continue
        assert row.process == spec.plant.process
        assert row.gain == pytest.approx(spec.plant.gain, rel=0.05)
        assert row.t0 == pytest.approx(spec.plant.t0, rel=0.15)


def test_suggestions_are_safe_on_the_true_plant(watched):
    """Every suggestion, and every stage on the way, is stable with Ms below 2.5 on the true, sampled loop."""
    specs, engine, seen = watched
    assert {s.row.loop for s in seen.suggestions} == {s.name for s in specs if s.tuning in FLAGGED}
    for k, spec in enumerate(specs):
        row = engine.row(k)
        if row.new_kp is None:
            continue
        assert row.new_ti is not None
        assert row.new_kp * spec.controller.kp > 0
        assert math.isfinite(row.new_ti) == math.isfinite(spec.controller.ti)
        new = replace(
            spec.controller, kp=row.new_kp, ti=row.new_ti, td=row.new_td or 0.0, tf=row.new_tf or 0.0
        )
        after = margin(spec.plant, new, spec.true_period)
        assert after.stable
        assert after.ms < 2.5
        assert row.new_ms_worst is not None
        assert row.new_ms_worst <= 2.2
        for stage in json.loads(row.stages or "[]"):
            way = replace(spec.controller, kp=stage["kp"], ti=stage["ti"], td=stage["td"], tf=stage["tf"])
            assert margin(spec.plant, way, spec.true_period).stable


def test_evidence_is_named(watched):
    """A suggestion lists the events that it rests on, all of that loop."""
    _, _, seen = watched
    ids = {a.id: a.loop for a in seen.assessments}
    for suggestion in seen.suggestions:
        assert suggestion.evidence
        assert {ids[i] for i in suggestion.evidence} == {suggestion.row.loop}


def test_records_carry_no_nan(watched):
    """What the data cannot carry is None: no NaN in any figure of any record but a window's model."""
    _, engine, seen = watched
    for record in [*seen.assessments, *engine.rows()]:
        for name in record.__struct_fields__:
            value = getattr(record, name)
            assert not (isinstance(value, float) and math.isnan(value)), (record.loop, name)
    for assessment in seen.assessments:
        assert assessment.reason or assessment.verdict == GOOD


def test_windows_show_the_evidence(watched):
    """A window for each assessment, times in order, the model where there is a fit."""
    _, _, seen = watched
    windows = {w.id: w for w in seen.windows}
    assert set(windows) == {a.id for a in seen.assessments}
    for a in seen.assessments:
        window = windows[a.id]
        assert np.all(np.diff(window.time) > 0)
        if a.kind == "setpoint":
            assert window.time[0] <= a.start <= window.time[-1]
        if a.fit is not None and a.fit > 0.99:
            assert np.std(window.pv - window.model) < 0.2 * np.std(window.pv)


# ---------------------------------------------------------------------------------------------------
# batching


@pytest.fixture(scope="module")
def small() -> tuple[list[Loop], Samples, list[Any]]:
    specs = random_fleet(5, 11, noise=(0.0, 0.01))
    loops, samples = table_of(specs), samples_of(Simulation(specs).advance(1200.0))
    engine = Engine(LoopTable(loops))
    return loops, samples, plain(engine.step(samples) + engine.flush())


@settings(max_examples=6)
@given(cuts=st.lists(st.integers(0, 5000), max_size=12))
def test_any_batching_gives_the_same_records(small, cuts):
    """Bit-equal records in the same order for any chunking, assessed at once or later."""
    loops, samples, whole = small
    assert len(whole) > 10
    engine, records = Engine(LoopTable(loops)), []
    bounds = [0, *sorted(min(c, len(samples)) for c in cuts), len(samples)]
    for a, b in pairwise(bounds):
        records += engine.step(samples.take(slice(a, b)))
    records += engine.flush()
    for loop in loops:
        mine = [r for r in plain(records) if loop.name in str(r)]
        assert sorted(map(str, mine)) == sorted(str(r) for r in whole if loop.name in str(r))
    assert sorted(map(str, plain(records))) == sorted(map(str, whole))


def test_assessing_later_gives_the_same(small):
    """Detection now, assessment one by one afterwards: the same assessments, and a backlog in between."""
    loops, samples, whole = small
    engine = Engine(LoopTable(loops))
    records = engine.detect(samples)
    assert engine.backlog > 0
    while engine.backlog:
        records += engine.assess(1)
    records += engine.flush()
    assert sorted(map(str, plain(records))) == sorted(map(str, whole))


def test_loops_do_not_see_each_other(small):
    """Each loop alone gives its own records, to the bit."""
    loops, samples, _ = small
    together = Engine(LoopTable(loops))
    records = together.step(samples) + together.flush()
    for k, loop in enumerate(loops):
        rows = samples.take(samples.loop == k)
        alone = Engine(LoopTable([loop]))
        mine = alone.step(replace(rows, loop=np.zeros(len(rows), np.int32))) + alone.flush()
        assert of_loop(mine, loop.name) == of_loop(records, loop.name)
        assert repr(alone.row(0)) == repr(together.row(k))


def test_an_id_is_of_loop_and_time():
    """Another time or name, another id; the opening, the closing and the assessment share theirs."""
    samples = stepped()
    ids = set()
    for name, shift in (("L", 0), ("M", 0), ("L", 1_000_000_000)):
        _, seen = run(Loop(name=name), replace(samples, time=samples.time + shift))
        (assessment,) = seen.assessments
        assert {e.id for e in seen.events} == {assessment.id}
        ids.add(assessment.id)
    assert len(ids) == 3


# ---------------------------------------------------------------------------------------------------
# noise and loads


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_noise_alone_makes_no_record(colour):
    """Fifty loops, a million samples of white or coloured noise: nothing is reported."""
    loops, n = 50, 20_000
    white = np.random.default_rng(17).normal(size=(n, loops))
    e = white.copy()
    for k in range(1, n):
        e[k] = colour * e[k - 1] + math.sqrt(1 - colour**2) * white[k]
    engine = Engine(LoopTable([Loop(name=str(k)) for k in range(loops)]))
    loop, time = np.tile(np.arange(loops, dtype=np.int32), n), np.repeat(times(n), loops)
    assert engine.step(Samples.of(loop, time, 50.0, 50.0 + e.ravel(), 30.0 - e.ravel())) == []
    assert {r.verdict for r in engine.rows()} == {NOT_ASSESSED}


def test_op_noise_is_that_of_the_loop():
    """Noise of PV times the new gain, for a PI."""
    engine, _ = run(Loop(name="L", kp=0.4, ti=300.0), stepped(4000, kp=0.4, ti=300.0, noise=0.05))
    row = engine.row(0)
    assert row.new_kp is not None
    assert row.new_op_noise_abs == pytest.approx(row.new_kp * 0.05, rel=0.2)


def test_a_rule_named_in_the_loop_table_is_used():
    """The suggestion says which rule it is; one that is not for a PI leaves the reference rule, and that is said."""
    samples = stepped(4000, kp=0.4, ti=300.0, noise=0.01)
    rows = [
        run(Loop(name="L", kp=0.4, ti=300.0, rule=rule), samples)[0].row(0)
        for rule in ("", "tyreus-luyben", "luyben-pid")
    ]
    assert [row.rule for row in rows] == ["simc-pi", "tyreus-luyben", "simc-pi"]
    assert rows[1].new_kp != rows[0].new_kp
    assert ["not used" in row.action for row in rows] == [False, False, True]
    assert rows[2].action.endswith("; the rule luyben-pid is not used: it is for PID, this loop is a PI")
    assert all(row.new_ms_worst is not None and row.new_ms_worst <= 2.2 for row in rows)


@settings(max_examples=15)
@given(
    wrong=st.sampled_from([1.0, 3.0, 30.0]),
    ti=st.sampled_from([3.0, 300.0, math.inf]),
    td=st.sampled_from([0.0, 50.0]),
    objective=st.sampled_from(OBJECTIVES),
    noise=st.sampled_from([0.0, 0.05]),
)
@example(wrong=30.0, ti=3.0, td=0.0, objective="both", noise=0.05)  # unstable, were the table right
def test_no_figure_is_nan(wrong, ti, td, objective, noise):
    """Whatever the table says of the settings: a figure that cannot be told is None in every record and row."""
    loop = Loop(name="L", kp=0.4 * wrong, ti=ti, td=td, objective=objective)
    engine, seen = run(loop, stepped(1500, kp=0.4, ti=300.0, noise=noise))
    assert seen.assessments
    for said in (*seen.assessments, *(s.row for s in seen.suggestions), engine.row(0)):
        figures = {n: getattr(said, n) for n in said.__struct_fields__}
        assert not [n for n, value in figures.items() if isinstance(value, float) and math.isnan(value)]


def test_a_loop_of_which_nothing_is_known():
    """No sample, no step: not assessed, and why; no health figure out of nothing."""
    engine = Engine(LoopTable([Loop(name="A"), Loop(name="B"), Loop(name="C")]))
    n = 400
    engine.step(Samples.of(1, times(n), 50.0, 50.0, 20.0))
    engine.step(Samples.of(2, times(n), 50.0, 50.0, 20.0, auto=False))
    assert [engine.row(k).verdict for k in range(3)] == [NOT_ASSESSED] * 3
    assert [engine.row(k).reason for k in range(3)] == [
        "no good sample was seen", "idle: set point, PV and output do not move", "in manual for 100% of the time",
    ]  # fmt: skip
    assert engine.row(0).coverage is None
    assert engine.row(1).coverage == pytest.approx(1.0)
    assert engine.row(2).manual == pytest.approx(1.0)


def test_counts_add_up():
    """Every sample that came in is counted under one cause."""
    samples = stepped(noise=0.02)
    pv = samples.pv.copy()
    pv[10:20] = np.nan
    quality = samples.quality.copy()
    quality[30:35] = 0
    engine = Engine(LoopTable([Loop(name="L")]))
    engine.step(replace(samples, pv=pv, quality=quality))
    engine.step(samples)
    counts = engine.seen.counts()
    assert sum(counts[n] for n in ("ok", "bad_value", "bad_quality", "duplicate", "late")) == 1800
    assert counts["bad_value"] == 10
    assert counts["bad_quality"] == 5


def test_a_loop_may_join_later():
    """It leaves the others alone."""
    table = LoopTable([Loop(name="A")])
    engine = Engine(table)
    engine.step(stepped().take(slice(0, 300)))
    assert list(engine.open_rows()) == [0]
    assert table.add(Loop(name="B")) == 1
    engine.follow()
    assert list(engine.open_rows()) == [0]
    engine.step(replace(stepped(), loop=np.ones(900, np.int32)))
    engine.flush()
    assert [r.events for r in (engine.row(0), engine.row(1))] == [1, 1]
    assert isinstance(engine.row(1), LoopRow)


def test_stretches_do_not_pile_up():
    """Where nobody has time for the controllers of so many loops, those of others are let go; events are not."""
    loops = [Loop(name=f"L{k}") for k in range(5)]
    samples = stepped(900, noise=0.02)
    many = [replace(samples, loop=np.full(len(samples), k, np.int32)) for k in range(5)]
    engine = Engine(LoopTable(loops), most_stretches=2)
    for own in many:
        engine.detect(own)
    events = 5
    assert engine.backlog == events + 2
    engine.assess()
    assert [engine.row(k).events for k in range(5)] == [1] * 5
