"""What the demo shows: verdicts once, suggestions, how things stand, the loops at the end."""

from __future__ import annotations

import msgspec
import pytest

from monitor.cli.demo_show import DemoConsole
from monitor.contract.records import Assessment, LoopRow, Suggestion
from monitor.contract.status import LoopCounts, Rates, Status


@pytest.fixture
def show(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    return DemoConsole()


def assessment(loop: str = "LIC-[bold]1", verdict: str = "retune") -> Assessment:
    facts = {"kind": "setpoint", "start": 0, "end": 1, "state": "settled", "amplitude": 1.0, "event": 1}
    return Assessment(loop=loop, id="1f", verdict=verdict, reason="slow to follow", ci=0.31, ms=1.2, **facts)


def test_a_verdict_once_until_it_changes(show, capsys):
    """Names are text, no markup."""
    for verdict in ("retune", "retune", "good"):
        show.heard(assessment(verdict=verdict))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert all(
        word in lines[0] for word in ("LIC-[bold]1", "retune", "CI_sp 0.31", "Ms 1.20", "slow to follow")
    )
    assert "good" in lines[1]


def test_an_event_that_says_nothing_takes_no_verdict_back(show, capsys):
    """It is said of a loop once, where nothing else is known."""
    for verdict in ("inconclusive", "retune", "inconclusive", "retune", "inconclusive"):
        show.heard(assessment(verdict=verdict))
    assert [("retune" in line) for line in capsys.readouterr().out.splitlines()] == [False, True]


def test_a_suggestion_with_its_margin(show, capsys):
    row = LoopRow(loop="L", verdict="retune", action="set kp = 2", new_ms=1.7, new_ms_worst=1.9)
    show.heard(Suggestion(row=row, evidence=("1f",)))
    assert "set kp = 2  (Ms 1.70, at worst 1.90)" in capsys.readouterr().out


def test_how_things_stand(show, capsys):
    counts = LoopCounts(total=9, retune=2, inconclusive=1, good=5, not_assessed=1, open=3, stale=0)
    zeros = {f.name: 0 for f in msgspec.structs.fields(Status)}
    named = {"loops": counts, "rates": Rates(10.0, 123.4), "samples_ok": 12345}
    show.progress(Status(**{**zeros, **named}), 5.2, 60.0)
    show.progress(Status(**{**zeros, **named}), 10.2, None)
    first, second = capsys.readouterr().out.splitlines()
    assert (
        first.split()
        == (
            "5 of 60 s 12,345 samples, 123/s 9 loops: 2 retune, 5 good, 1 inconclusive, 1 not assessed, 3 events open"
        ).split()
    )
    assert second.startswith("  10 s")


def test_where_to_look(show, capsys):
    show.view("http://127.0.0.1:9090/?x=1")
    show.ready(13, "tcp/127.0.0.1:7447")
    with show.preparing():
        pass
    assert capsys.readouterr().out.splitlines()[:2] == [
        "view   open http://127.0.0.1:9090/?x=1",
        "ready  13 loops at tcp/127.0.0.1:7447   (Ctrl-C ends)",
    ]


def test_the_loops_at_the_end(show, capsys):
    """What to do where it is to be re-tuned, else why not."""
    rows = [
        LoopRow(loop="A", verdict="retune", action="set kp = 2", reason="slow", ms=1.23, t0=4.56),
        LoopRow(loop="B", reason="in manual"),
    ]
    show.summary(rows)
    said = capsys.readouterr().out
    assert "Loops, worst first" in said
    assert all(word in said for word in ("set kp = 2", "1.23", "4.56", "in manual"))
    assert "slow" not in said
