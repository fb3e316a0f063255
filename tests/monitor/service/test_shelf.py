"""A flag that is put aside: with a reason and an end, over restarts, by a query, where that is allowed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from monitor.contract.loops import Loop, LoopTable
from monitor.service.shelf import MOST_REASON, Shelf
from tests.monitor.service.tools import Bench, one_loop
from tests.support.bus import Question
from tests.support.stores import quick

KEY = "loopsight/@/monitor/command"
UNTIL = "2026-02-01T00:00:00.000000Z"


def asked(b: Bench, command: Any) -> Question:
    """A query with a payload, answered."""
    question = Question(KEY)
    question.payload = json.dumps(command).encode()
    b.bus.questions.append(question)
    b.tick()
    return question


def asks(b: Bench, **command: Any) -> Any:
    """What the monitor answers; a text where it refuses."""
    question = asked(b, command)
    return question.error or json.loads((question.replies or [])[0][1])


def test_a_flag_is_put_aside_and_back_and_kept(tmp_path: Path) -> None:
    """It goes from the flagged, stands among the shelved; after a restart too; and comes back."""
    b = Bench(tmp_path, one_loop(), commands=True)
    b.service.trends.flag(0, True)
    answer = asks(b, command="shelve", loop="L", reason="valve ordered", until=UNTIL)
    assert (answer["loop"], answer["until"], answer["reason"]) == ("L", UNTIL, "valve ordered")
    assert b.status()["flagged"] == []
    assert b.status()["shelved"] == {"L": f"until {UNTIL}: valve ordered"}
    b.store.close()
    again = Bench(tmp_path, one_loop(), commands=True)
    again.service.trends.flag(0, True)
    assert again.status()["flagged"] == []
    assert asks(again, command="unshelve", loop="L")["until"] is None
    assert again.status()["flagged"] == ["L"]
    assert again.status()["shelved"] == {}
    assert again.store.shelved() == []
    again.store.close()


def test_its_time_comes(tmp_path: Path) -> None:
    """At the end it is back by itself; while the store fails, later."""
    now = [0]
    loops, store = LoopTable([Loop(name="L")]), quick(tmp_path)
    shelf = Shelf(loops, store, lambda: now[0])
    shelf.obey(b'{"command":"shelve","loop":"L","reason":"x","until":"1970-01-01T00:01:00Z"}')
    now[0] = 59 * 10**9
    shelf.look()
    assert shelf.rows == {0}
    now[0] = 60 * 10**9
    shelf.look()
    assert shelf.rows == set()
    assert store.shelved() == []
    store.close()


def test_commands_are_off_unless_asked_for(tmp_path: Path) -> None:
    b = Bench(tmp_path, one_loop())
    assert "commands = true" in asks(b, command="shelve", loop="L", reason="x", until=UNTIL)
    b.store.close()


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (
            {"command": "shelve", "loop": "X", "reason": "x", "until": UNTIL},
            "loop: 'X', expected one that is watched",
        ),
        ({"command": "shelve", "loop": "L", "until": UNTIL}, "reason: 0 characters"),
        (
            {"command": "shelve", "loop": "L", "reason": "x" * (MOST_REASON + 1), "until": UNTIL},
            "at most 200",
        ),
        ({"command": "shelve", "loop": "L", "reason": "x"}, "until: '', expected ISO time"),
        (
            {"command": "shelve", "loop": "L", "reason": "x", "until": "2001-01-01T00:00:00Z"},
            "a time to come",
        ),
        ({"command": "open", "loop": "L"}, "expected shelve or unshelve"),
        ({"command": "shelve", "loop": "L", "kp": 2}, "unknown field"),
        ([1], "command:"),
    ],
)
def test_what_is_no_command_is_refused_in_a_line(tmp_path: Path, command: Any, said: str) -> None:
    """With what would be accepted; nothing has changed."""
    b = Bench(tmp_path, one_loop(), commands=True)
    question = asked(b, command)
    assert question.error is not None
    assert said in question.error
    assert "\n" not in question.error
    assert b.service.shelf.rows == set()
    b.store.close()
