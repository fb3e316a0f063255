"""On which scale an export's qualities are, told by their numbers: OPC's, a per cent, AVEVA's, or a yes and no."""

from __future__ import annotations

from collections.abc import Iterable

from monitor.contract.quality import BOOL, OPC, PERCENT, WONDERWARE

from .layout import heading_key

_BOOL_HEADINGS = frozenset("good isgood valid ok gut".split())
_PERCENT_HEADINGS = frozenset("confidence percentgood pctgood".split())
_AVEVA_HEADINGS = frozenset(("datetime", "tagname"))
"""Two headings by which a table of AVEVA Historian is known."""
_AVEVA_CODES = frozenset((0.0, 1.0, 10.0, 16.0, 24.0, 64.0, 65.0, 133.0, 248.0, 249.0, 250.0, 252.0))
LEAST_OPC_GOOD = 192.0


def quality_scale(heading: str, cells: Iterable[str], headings: Iterable[str]) -> str:
    """Return the scale of a column of qualities; empty where they are words.

    Parameters
    ----------
    cells
        Some of its cells.
    headings
        Of the whole table.

    Raises
    ------
    ValueError
        The numbers may be good on one scale and bad on another.

    Examples
    --------
    >>> quality_scale("Quality", ["100", "0"], []), quality_scale("quality", ["192", "0"], [])
    ('percent', 'opc')
    """
    key = heading_key(heading)
    codes = _numbers(cells)
    if not codes:
        return ""
    aveva = {heading_key(h) for h in headings} >= _AVEVA_HEADINGS and not key.startswith("opc")
    most = max(codes)
    signs = (
        (BOOL, key in _BOOL_HEADINGS),
        (PERCENT, key in _PERCENT_HEADINGS and most <= 100),
        (WONDERWARE, aveva and codes <= _AVEVA_CODES | {LEAST_OPC_GOOD}),
        (OPC, most >= LEAST_OPC_GOOD),
        (PERCENT, most == 100),
        (WONDERWARE, 0.0 in codes and bool(codes & {16.0, 133.0}) and codes <= {0.0, 1.0, 16.0, 133.0}),
        (OPC, most > 1),
    )
    found = next((scale for scale, told in signs if told), "")
    if found:
        return found
    shown = ", ".join(f"{c:g}" for c in sorted(codes))
    raise ValueError(
        f"{heading}: qualities {shown} may be good or bad; say what they are by quality_scale = opc, percent, "
        f"wonderware or bool in a mapping (--map)"
    )


def _numbers(cells: Iterable[str]) -> set[float]:
    codes = set()
    for cell in cells:
        try:
            codes.add(float(cell.strip().replace(",", ".")))
        except ValueError:
            continue
    return codes
