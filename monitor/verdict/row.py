"""A loop's row: how a verdict, advice and health are written into its columns."""

from __future__ import annotations

import json
import math
from typing import Any

from monitor.advise.suggestion import Advice, Withheld
from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, WORST_FIRST, LoopRow
from tuners.blocks import BLOCKS
from tuners.faceplate import fields_of
from tuners.settings import FORMS, Settings


def worst_first(row: LoopRow) -> tuple[int, float, str]:
    """Sort key of loop rows: verdict, then the less of CI and what is left to the Ms limit, then the name."""
    worth = [
        1.0 if row.ci_setpoint is None else row.ci_setpoint,
        1.0 if row.ci_load is None else row.ci_load,
        1.0 if row.ms is None else 2.0 / max(row.ms, 1.0),
    ]
    return WORST_FIRST.index(row.verdict), min(worth), row.loop


def inconclusive(row: LoopRow, reason: str) -> LoopRow:
    """Say that a loop's events do not agree; return the row."""
    row.verdict, row.reason = INCONCLUSIVE, reason
    row.action = "look at the events side by side: did the plant, the range or the valve change between them?"
    return row


def withhold(row: LoopRow, withheld: Withheld) -> LoopRow:
    """Say why there is no suggestion, or that none is needed; return the row."""
    if withheld.fine_as_it_is:
        row.verdict, row.reason, row.action = GOOD, withheld.reason, "none"
        return row
    row.reason = f"{row.reason}; no suggestion: {withheld.reason}"
    row.action = "retune by hand with care, or make a larger set-point step for a sharper model"
    return row


def with_settings(row: LoopRow, loop: Loop, advice: Advice) -> LoopRow:
    """Fill in the columns of a suggestion; return the row."""
    new = advice.settings
    row.rule, row.form = advice.rule, loop.form
    row.new_kp, row.new_ti, row.new_td, row.new_tf = (float(v) for v in (new.kp, new.ti, new.td, new.tf))
    if new.form == "parallel":
        row.new_ki, row.new_kd = float(new.ki), float(new.kd)
    row.new_ms, row.new_ms_worst, row.new_ci = advice.ms, advice.ms_worst, advice.ci
    after, before = advice.after, advice.before
    row.new_overshoot, row.new_iae_setpoint, row.new_iae_load = after.overshoot, *after.iae.values()
    if before is not None:
        row.overshoot, row.iae_setpoint, row.iae_load = before.overshoot, *before.iae.values()
    row.new_op_noise_abs = advice.op_noise
    if loop.op_span is not None:
        row.new_op_noise = 100.0 * advice.op_noise / loop.op_span
    row.stages = json.dumps([_plain(s) for s in advice.stages])
    steps = f", in {len(advice.stages)} stages" if len(advice.stages) > 1 else ""
    row.action = f"set {_words(new)}{steps}"
    try:
        row.new_fields = json.dumps(_fields(loop, new))
    except ValueError as error:  # a faceplate in % without the loop's spans, or a form that cannot hold them
        row.action += f"; the fields of {loop.form} cannot be given: {error}"
    return row


def _fields(loop: Loop, settings: Settings) -> dict[str, Any]:
    """Return the fields of the loop's block, or the form's own names."""
    if loop.form not in FORMS:
        return dict(fields_of(BLOCKS[loop.form], settings, loop))
    return _plain(settings)


def _plain(settings: Settings) -> dict[str, float | None]:
    """Return settings for JSON: no integral action is null."""
    names = ("kp", "ki", "kd", "tf") if settings.form == "parallel" else ("kp", "ti", "td", "tf")
    values = {n: float(getattr(settings, n)) for n in names}
    return {n: v if math.isfinite(v) else None for n, v in values.items()}


def _words(settings: Settings) -> str:
    """Say settings with their units."""
    if settings.form == "parallel":
        return f"kp = {settings.kp:.4g}, ki = {settings.ki:.4g} /s, kd = {settings.kd:.4g} s"
    integral = f"ti = {settings.ti:.4g} s" if math.isfinite(float(settings.ti)) else "no integral action"
    lead = f", td = {settings.td:.4g} s, tf = {settings.tf:.3g} s" if float(settings.td) > 0 else ""
    return f"kp = {settings.kp:.4g}, {integral}{lead}"
