"""Text from outside is safe to show."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.contract.text import escape, plain, short, visible
from tests.support.hostile import HOSTILE


@given(st.text())
def test_what_is_shown_prints(text):
    """No control character, no change of direction, no line end; what prints stays as it is."""
    shown = visible(text)
    assert shown.isprintable()
    assert (shown == text) == text.isprintable()


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\nb", r"a\nb"),
        ("a\x1b[31m", r"a\x1b[31m"),
        ("\u202eLIC", r"\u202eLIC"),
        ("\ud800", r"\ud800"),
        (7, "7"),
    ],
)
def test_what_does_not_print_is_an_escape(text, shown):
    assert visible(text) == shown


def test_long_text_is_cut():
    assert visible("x" * 100, 9) == "x" * 9
    line = "a" * 100 + "b" * 100
    assert short(line) == "a" * 60 + "..." + "b" * 50
    assert short("a" * 120) == "a" * 120


@pytest.mark.parametrize("name", HOSTILE)
def test_escape_shows_text_as_it_is(name):
    """Taking the backslashes away again gives the text; unescaped marks do not remain."""
    shown = escape(name)
    line = plain(name)
    assert "".join(c for i, c in enumerate(shown) if c != "\\" or shown[i - 1 : i] == "\\") == line
    assert "\n" not in shown
    assert len(line) <= 200


def test_a_line_is_cut():
    """With a mark where something is left out."""
    assert plain("x" * 7, 7) == "x" * 7
    assert plain("x" * 8, 7) == "x" * 6 + "…"
    assert plain(" a\n\tb ") == "a b"
    assert plain("a\x00b\u202e") == r"a\x00b\u202e"
