"""What is to be done with a loop, and which loop comes first: the most dangerous, wherever loops are listed."""

from __future__ import annotations

from .records import GOOD, INCONCLUSIVE, RETUNE, WORST_FIRST, LoopRow

FAULTS = {
    *(
        "stiction",
        "no_response",
        "stuck_pv",
        "mapping_suspect",
        "oscillating",
        "saturated",
        "settings_mismatch",
    ),
    *("offset", "no_integral"),
}
"""Flags that say what is wrong in the plant beside the tuning: a valve, a transmitter, a cycle from outside."""
VALVE_FLAGS, MANUAL_FLAGS = {"stiction", "no_response"}, {"manual"}
TO_RETUNE = 2
"""Place of a loop that is to be retuned and no danger; those before it need somebody sooner."""


def danger(row: LoopRow) -> int:
    """Return what a loop's place rests on: 0 near instability, 1 valve and other faults, 2 to retune, and the rest."""
    if "near_instability" in row.flags and row.verdict in (RETUNE, INCONCLUSIVE):
        return 0
    if row.verdict == INCONCLUSIVE and FAULTS & set(row.flags):
        return 1
    return TO_RETUNE + WORST_FIRST.index(row.verdict)


def worst_first(row: LoopRow) -> tuple[int, float, str]:
    """Sort key of loop rows: danger, then the less of CI and what is left to the Ms limit, then the name."""
    worth = [
        1.0 if row.ci_setpoint is None else row.ci_setpoint,
        1.0 if row.ci_load is None else row.ci_load,
        1.0 if row.ms is None else 2.0 / max(row.ms, 1.0),
    ]
    return danger(row), min(worth), row.loop


def kind_of(row: LoopRow) -> str:
    """Return what is to be done with a loop, one of `monitor.contract.summary.KINDS`."""
    if row.verdict in (RETUNE, GOOD):
        return row.verdict
    for kind, flags in (("valve", VALVE_FLAGS), ("oscillating", {"oscillating"}), ("manual", MANUAL_FLAGS)):
        if flags & set(row.flags):
            return kind
    return "unclear"
