"""Text from outside, made safe for a terminal, a log and a page; long text, cut."""

from __future__ import annotations


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


def short(line: str) -> str:
    """Return a line with its middle left out where it is longer than 120 characters.

    Examples
    --------
    >>> short("LIC-101: " + 200 * "x").count("x")
    101
    """
    return line if len(line) <= 120 else f"{line[:60]}...{line[-50:]}"
