"""Text from outside is safe to show."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.contract.text import short, visible


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
