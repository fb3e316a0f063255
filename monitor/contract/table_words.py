"""Columns of a loop table that are none, and the known ones that were probably meant. Words in, a line out."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from .loop_fields import TABLE_COLUMNS

COMMENT = "#"
"""A column whose heading begins so is a remark, and not read."""
_MEANT: dict[str, str] = {
    **dict.fromkeys(
        ("gain", "k", "kc", "kpgain", "controllergain", "proportional", "p"), "kp, in OP/PV and signed"
    ),
    **dict.fromkeys(
        ("pb", "pband", "proportionalband", "propband"),
        "kp = 100/PB, in OP/PV and signed; or settings_in = faceplate",
    ),
    **dict.fromkeys(
        ("reset", "integral", "tn", "i", "timin", "titime", "timinutes", "resettime"), "ti, in seconds"
    ),
    **dict.fromkeys(("rate", "derivative", "tv", "d", "deriv", "tdmin", "ratetime"), "td, in seconds"),
    **dict.fromkeys(("repeats", "repeatsperminute", "rpm", "resetrate"), "ti = 60 s/(repeats per minute)"),
    **dict.fromkeys(
        ("ophi", "outhi", "opmax", "outmax", "ophighlimit", "opupper", "mvhi", "cvhi"), "op_high"
    ),
    **dict.fromkeys(("oplo", "outlo", "opmin", "outmin", "oplowlimit", "oplower", "mvlo", "cvlo"), "op_low"),
    **dict.fromkeys(
        ("pvhi", "pvmax", "euhi", "high", "rangehi", "rangehigh", "pvupper", "sphi", "eu100"), "pv_high"
    ),
    **dict.fromkeys(
        ("pvlo", "pvmin", "eulo", "low", "rangelo", "rangelow", "pvlower", "splo", "eu0"), "pv_low"
    ),
    **dict.fromkeys(("tag", "loop", "tagname", "loopname", "loopid"), "name"),
    **dict.fromkeys(("eu", "pvunit", "pvunits", "engunits", "uom"), "unit"),
    **dict.fromkeys(("opunits", "outunit", "mvunit"), "op_unit"),
    **dict.fromkeys(("type", "processtype", "kind"), "process"),
    **dict.fromkeys(
        ("action", "direction", "acting", "controlaction"), "the sign of kp: below 0 for a direct-acting loop"
    ),
    **dict.fromkeys(("block", "vendor", "algorithm", "structure"), "form"),
    **dict.fromkeys(("tc", "lambda", "tcl"), "closed_loop_time, in seconds"),
    **dict.fromkeys(("filter", "filtertime", "pvfiltertime", "pvf"), "pv_filter, in seconds"),
    **dict.fromkeys(("scantime", "execution", "cycle", "sampletime"), "scan or period, in seconds"),
    **dict.fromkeys(("parent", "cascade", "masterloop", "primary"), "master"),
    **dict.fromkeys(("timeunits", "timeunit", "tiunits"), "no column: ti and td are in seconds"),
}
"""Words of vendors and habits, lower case, without separators, and what they are here."""
_TIME_UNITS = frozenset(
    "s sec second seconds min mins minute minutes h hour hours ms repeats/min rpm".split()
)


def unknown_column(column: str, values: Iterable[object] = ()) -> str:
    """Say of a column that a loop table has not which known one may be meant; empty where it is known, or a remark.

    Parameters
    ----------
    values
        What stands in it.

    Examples
    --------
    >>> unknown_column("gain"), unknown_column("kp")
    ('gain: do you mean kp, in OP/PV and signed?', '')
    >>> unknown_column("units", ["minutes"])
    "units: 'minutes': ti and td are in seconds here, whatever the unit is called; convert them"
    """
    name = column.strip()
    if not name or name in TABLE_COLUMNS or name.startswith(COMMENT):
        return ""
    key = "".join(c for c in name.lower() if c.isalnum())
    times = [str(v).strip() for v in values if str(v).strip().lower() in _TIME_UNITS]
    if key in {"units", "timeunits", "timeunit", "tiunits", "unit"} and times:
        return (
            f"{name}: {times[0]!r}: ti and td are in seconds here, whatever the unit is called; convert them"
        )
    known = {c.replace("_", ""): c for c in TABLE_COLUMNS}
    meant = known.get(key) or _MEANT.get(key)
    if meant is None and key == "units":
        meant = "unit (of PV)"
    if meant is None:
        near = get_close_matches(key, list(known), 1, 0.75)
        meant = known[near[0]] if near else None
    return f"{name}: do you mean {meant}?" if meant else f"{name}: not a column of a loop table, and not read"


def is_mistaken(said: str) -> bool:
    """Whether what is said of a column names another that may be meant: it was put there to be read."""
    return bool(said) and "and not read" not in said
