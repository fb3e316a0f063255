"""What the monitor says: codes that stay and are explained, a line a minute for each cause, all of it printable."""

from __future__ import annotations

import json
import logging
import re
import string
from pathlib import Path

import pytest

from monitor.contract.records import RETUNE
from monitor.service import journal
from monitor.service.journal import AGAIN_AFTER_S, MESSAGES, JsonLines, Lines, OnceAMinute, note
from tests.monitor.service.tools import a_step, feed, one_loop
from tests.support.places import ROOT

SOURCES = sorted((ROOT / "monitor" / "service").glob("*.py"))
RESERVED = {"time", "level", "code", "message", "left_out"}


def documented() -> list[str]:
    """Codes of the page's table, with their levels."""
    page = (ROOT / "docs" / "operation.md").read_text(encoding="utf-8")
    return re.findall(r"^\| `(\w+)` \| (\w+) \| [^|]+ \| [^|]+ \|$", page, re.MULTILINE)


def said(caplog: pytest.LogCaptureFixture) -> logging.LogRecord:
    return caplog.records[-1]


def test_every_code_is_explained_with_its_level():
    """docs/operation.md has each of them once, and none that there is not."""
    levels = {code: logging.getLevelName(level).lower() for code, (level, _) in MESSAGES.items()}
    assert dict(documented()) == levels | {journal.WITHOUT_CODE: "any"}
    assert len(documented()) == len(levels) + 1


@pytest.mark.parametrize("code", MESSAGES)
def test_a_message_has_its_fields(code):
    """None of them hides what every line has."""
    fields = {name for _, name, _, _ in string.Formatter().parse(MESSAGES[code][1]) if name}
    assert not fields & RESERVED


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_nothing_is_said_without_a_code(path: Path):
    """The service says everything by `note`, under a code of the table, with the fields of its text."""
    text = path.read_text(encoding="utf-8")
    assert path.name == "journal.py" or "import logging" not in text
    for code, rest in re.findall(r"\bnote\(\s*\"(\w+)\"(.*)", text):
        assert code in MESSAGES, rest


def test_a_message_as_a_line_and_as_json(caplog):
    """Time in UTC, level, code, text; the fields by name."""
    note("store_failing", why="disk full")
    line = Lines().format(said(caplog))
    assert re.fullmatch(
        r"\S+Z ERROR store_failing: store: disk full; nothing is published until it is back", line
    )
    facts = json.loads(JsonLines().format(said(caplog)))
    assert list(facts) == ["time", "level", "code", "message", "why"]
    assert (facts["level"], facts["code"], facts["why"]) == ("error", "store_failing", "disk full")
    note("events_taken_up", count=3, seconds=7.4)
    facts = json.loads(JsonLines().format(said(caplog)))
    assert (facts["count"], facts["seconds"], facts["message"][:1]) == (3, 7.4, "3")


@pytest.mark.parametrize("form", [Lines(), JsonLines()])
@pytest.mark.parametrize("name", ["a\nWARNING b", "a\x1b[31mred", "a\u202eb", "a\ud800", "%s {0}"])
def test_a_name_is_data(caplog, form, name):
    """No line of its own, no colour, no turned text: whatever a loop is called, it is one line that prints."""
    note("loop_given_up", loop=name)
    line = form.format(said(caplog))
    assert line.isprintable()
    assert len(line.splitlines()) == 1


def test_a_line_a_minute_however_many_loops(caplog):
    """A day of 300 loops that flap every minute: 1,440 lines of each kind, and the count of all."""
    now = 0.0
    limit = OnceAMinute(lambda: now)
    through = [0, 0]
    for minute in range(1440):
        now = minute * AGAIN_AFTER_S
        for loop in range(300):
            note("loops_stale", count=1, loops=f"L{loop}")
            if limit.filter(said(caplog)):
                through[0] += 1
                through[1] += said(caplog).left_out
            caplog.clear()
    assert through == [1440, 1439 * 299]
    note("store_back", count=1)
    assert limit.filter(said(caplog)), "another cause has its own minute"


def test_what_was_left_out_stands_in_the_next_line(caplog):
    times = iter((0.0, 1.0, 59.0, 60.0))
    limit = OnceAMinute(lambda: next(times))
    for _ in range(4):
        note("loops_back", count=1, loops="L")
        through = limit.filter(said(caplog))
    assert through
    assert Lines().format(said(caplog)).endswith("heard again: L (2 more since the last such line)")
    assert json.loads(JsonLines().format(said(caplog)))["left_out"] == 2


def test_results_are_always_said(caplog):
    """They are no trouble."""
    caplog.set_level(logging.INFO, "loopsight")
    limit = OnceAMinute(lambda: 0.0)
    for _ in range(3):
        note("retune", loop="L", verdict=RETUNE, kind="load", reason="slow")
        assert limit.filter(said(caplog))
    assert "left_out" not in json.loads(JsonLines().format(said(caplog)))


def test_what_a_library_says(caplog):
    """It has no code of ours, and no lines beyond one either."""
    logging.getLogger("other").warning("it %s", "failed\n", exc_info=OSError("a\x1b"))
    facts = json.loads(JsonLines().format(said(caplog)))
    assert facts["code"] == "other"
    assert facts["message"] == r"it failed\n: OSError('a\x1b')"


def test_an_assessment_is_said_when_asked_for(bench, caplog):
    """Quiet ones with --verbose only."""
    caplog.set_level(logging.DEBUG, "loopsight")
    b = bench(one_loop())
    feed(b, a_step())
    b.tick()
    assert [r.code for r in caplog.records if r.code == "assessment"] == ["assessment"]
