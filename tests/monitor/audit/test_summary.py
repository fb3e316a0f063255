"""What an audit comes to: each loop of one kind, jobs in the order of danger, remedies for what was not judged."""

from __future__ import annotations

import math

from monitor.audit.summary import benefit_of, risk_of, summary_of
from monitor.contract.records import LoopRow
from monitor.contract.summary import KINDS
from tests.monitor.report.tools import fleet, retune


def test_each_loop_is_counted_once() -> None:
    rows = fleet()
    summary = summary_of(rows)
    assert sum(summary.counts.values()) == len(rows)
    assert tuple(summary.counts) == KINDS
    assert summary.near_instability == 1


def test_jobs_come_by_danger_and_retunes_by_what_they_bring() -> None:
    rows = fleet()
    rows[4:4] = [retune("LIC-9", new_iae_load=3.0), retune("LIC-10", new_iae_load=200.0)]
    jobs = summary_of(rows).jobs
    assert [j.loops[0] for j in jobs[:3]] == ["PIC-7", "FIC-2", "TIC-3"]
    retuned = [j.loops[0] for j in jobs if j.kind == "retune"]
    assert retuned == ["PIC-7", "LIC-9", "LIC-101", "LIC-10"]
    last_fault = max(k for k, j in enumerate(jobs) if j.kind in {"valve", "oscillating"})
    assert last_fault < [j.loops[0] for j in jobs].index("LIC-9")


def test_who_does_a_job() -> None:
    who = {name: j.who for j in summary_of(fleet()).jobs for name in j.loops}
    expected = {"PIC-7": "tuner", "LIC-101": "tuner", "FIC-2": "valve shop", "TIC-3": "operator"}
    assert who == expected | {"AIC-5": "historian", "LIC-6": "operator"}


def test_no_retune_is_cut_from_the_jobs() -> None:
    rows = [retune(f"LIC-{k}") for k in range(50)]
    assert sorted(n for j in summary_of(rows).jobs for n in j.loops) == sorted(r.loop for r in rows)


def test_one_remedy_for_many_loops_is_one_job() -> None:
    coarse = [
        LoopRow(
            loop=f"A-{k}",
            verdict="inconclusive",
            flags=("undersampled",),
            reason=f"{k} s",
            action="sample faster",
        )
        for k in range(5)
    ]
    (job,) = summary_of(coarse).jobs
    assert job.loops == tuple(f"A-{k}" for k in range(5))
    (remedy,) = summary_of(coarse).remedies
    assert remedy.loops == job.loops


def test_benefit_and_risk_say_both_sides() -> None:
    assert (
        benefit_of(retune())
        == "error after a load step −90% (300 → 30); error after a set-point step −50% (120 → 60)"
    )
    assert "part of the way" in risk_of(retune())
    close = retune(ms=math.inf, flags=("near_instability",), new_iae_load=900.0, new_iae_setpoint=math.inf)
    assert benefit_of(close) == "safe again: Ms unstable → 1.50"
    assert risk_of(close).startswith("costs speed: error after a load step 3 times (300 → 900)")


def test_a_retune_without_safe_settings_is_a_job_all_the_same() -> None:
    (job,) = summary_of([LoopRow(loop="x", verdict="retune", reason="slow", action="by hand")]).jobs
    assert (job.title, job.benefit) == ("Retune, by hand", "not known: no safe settings were found")


def test_an_overshoot_that_goes_is_a_benefit_and_nothing_to_do_is_no_job() -> None:
    assert benefit_of(retune(overshoot=0.4, new_overshoot=0.05)).startswith("overshoot 40% → 5%; error after")
    row = LoopRow(
        loop="x", verdict="inconclusive", flags=("stale",), reason="66 %", action="none on this evidence"
    )
    assert summary_of([row]).jobs == ()
    assert summary_of([row]).remedies[0].loops == ("x",)
