"""Text from outside, made safe for a terminal, a log and a page; long text, cut; a time in words."""

from __future__ import annotations

import re

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
_PUNCTUATION = re.compile(r"([!#$&*+.:<>@\[-`{-~-])")


def visible(text: object, most: int | None = None) -> str:
    r"""Return text for a terminal or a log: what does not print, or would turn the line around, as an escape.

    Parameters
    ----------
    most
        Characters after which it is cut; None: never.

    Examples
    --------
    >>> visible("LIC-101")
    'LIC-101'
    >>> print(visible("a\x1b[31mred"))
    a\x1b[31mred
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))[:most]


def inert(text: str) -> str:
    """Return text for a CSV: with an apostrophe before what a spreadsheet would run as a formula.

    Examples
    --------
    >>> inert("=cmd()"), inert("LIC-101")
    ("'=cmd()", 'LIC-101')
    """
    return "'" + text if text.startswith(_FORMULA) else text


def as_named(text: str) -> str:
    """Return text as it was before `inert`.

    Examples
    --------
    >>> as_named("'=A1+LIC"), as_named("'LIC'")
    ('=A1+LIC', "'LIC'")
    """
    return text[1:] if text.startswith("'") and text[1:].startswith(_FORMULA) else text


def short(line: str) -> str:
    """Return a line with its middle left out where it is longer than 120 characters.

    Examples
    --------
    >>> short("LIC-101: " + 200 * "x").count("x")
    101
    """
    return line if len(line) <= 120 else f"{line[:60]}...{line[-50:]}"


def plain(text: object, most: int = 200) -> str:
    r"""Return text as `visible` does, in one line and at most ``most`` characters.

    Examples
    --------
    >>> plain("LIC-101:\n  too slow", most=12)
    'LIC-101: to…'
    """
    line = visible(" ".join(str(text).split())[: most + 1])
    return line if len(line) <= most else line[: most - 1] + "…"


def escape(text: object, most: int = 200) -> str:
    r"""Return text as markdown that shows it as it is, in one line: every mark with a meaning is escaped.

    Examples
    --------
    >>> print(escape("LIC-101 <b>"))
    LIC\-101 \<b\>
    """
    return _PUNCTUATION.sub(r"\\\1", plain(text, most))


def duration(seconds: float) -> str:
    """Say a time as one reads it off a clock.

    Examples
    --------
    >>> duration(45.0), duration(600.0), duration(6600.0), duration(9000.0)
    ('45 s', '10 min', '110 min', '2.5 h')
    """
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            count = seconds / size
            return f"{count:.0f} {unit}" if count >= 100.0 else f"{count:.2g} {unit}"
    return f"{seconds:.2g} s" if seconds < 10.0 else f"{seconds:.0f} s"
