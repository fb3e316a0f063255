"""What a loop's section says: settings today, now and later, model, health figures, events. Rows to plain tables."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from monitor.contract.figures import GAIN_UNITS, MEANINGS
from monitor.contract.records import Assessment, LoopRow
from monitor.contract.summary import Job

from .words import number, percent

UNITS = {"kp": "OP/PV", "ti": "s", "td": "s", "tf": "s", "ki": "OP/(PV s)", "kd": "OP s/PV"}
NOTES = ("note", "unavailable")
"""Keys of a faceplate that are remarks, not fields."""
MODEL_WORDS = (
    ("gain", "gain"),
    ("dead_time", "dead time"),
    ("lag", "lag"),
    ("t0", "lags and dead time together"),
)


def section_of(row: LoopRow, events: Sequence[Assessment], job: Job | None) -> dict[str, Any]:
    """Return what the template of a section needs.

    Parameters
    ----------
    row
        The loop's.
    events
        Those that are shown, the newest first.
    job
        What is to be done with it, if anything.
    """
    return {
        "row": row,
        "job": job,
        "reasons": _clauses(row.reason),
        "actions": _clauses(row.action),
        "settings": _settings(row),
        "model": _model(row),
        "promises": _promises(row),
        "events": events,
    }


def _clauses(text: str) -> list[str]:
    return [clause for clause in text.split("; ") if clause]


def _settings(row: LoopRow) -> dict[str, Any] | None:
    """Return the table of settings: heads, the faceplate's lines, canonical lines, remarks; None without any."""
    today = None if row.kp is None else {n: getattr(row, n) for n in ("kp", "ti", "td", "tf")}
    stages = _loaded(row.stages) or []
    if today is None and not stages:
        return None
    heads = ["today"] * (today is not None) + ["type in now"] * bool(stages)
    heads += [
        f"later, part {k + 2}" if k + 2 < len(stages) else "later, the aim" for k in range(len(stages) - 1)
    ]
    canonical = ([_parallel(today, stages)] if today is not None else []) + stages
    plates = [_loaded(row.fields)] * (today is not None) + _plates(row, len(stages))
    remarks = dict.fromkeys(str(p[n]) for p in plates if p for n in NOTES if p.get(n))
    return {
        "heads": heads,
        "faceplate": _lines([{k: v for k, v in (p or {}).items() if k not in NOTES} for p in plates]),
        "form": row.form or "",
        "canonical": [(name, UNITS.get(name, ""), values) for name, values in _lines(canonical, ending=True)],
        "remarks": list(remarks),
        "rollback": today is not None and bool(stages),
        "source": row.settings_source,
        "explained": row.settings_explained,
    }


def _plates(row: LoopRow, count: int) -> list[Any]:
    """Return the faceplates of the stages; nothing where the form's own names are all there is."""
    if row.fields is None and row.stage_fields is None:
        return [None] * count
    each = _loaded(row.stage_fields) or [_loaded(row.new_fields)]
    return [*each, *[None] * count][:count]


def _parallel(today: dict[str, Any], stages: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return today's settings under the names that the stages have."""
    if not stages or "ki" not in stages[0]:
        return today
    kp, ti = today["kp"], today["ti"]
    ki = kp / ti if ti else None
    return {"kp": kp, "ki": ki, "kd": kp * (today["td"] or 0.0), "tf": today["tf"]}


def _lines(columns: Sequence[dict[str, Any]], *, ending: bool = False) -> list[tuple[str, list[str]]]:
    """Turn settings, one a column, into lines of the table; "none" is the integral time of no integral action."""
    names = list(dict.fromkeys(name for column in columns for name in column))
    lines = []
    for name in names:
        values = [column.get(name) for column in columns]
        none = "none" if ending and name == "ti" else "–"
        lines.append((name, [none if v is None or v == math.inf else _shown(v) for v in values]))
    return lines


def _shown(value: Any) -> str:
    """Return a field's value: a choice as it is, yes or no, or a number as finely as one types it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number(value, 4)


def _loaded(text: str | None) -> Any:
    return None if not text else json.loads(text)


def _model(row: LoopRow) -> list[tuple[str, str, str, str]]:
    """Return the model's lines: name, unit, value, interval."""
    if row.gain is None:
        return []
    gain = GAIN_UNITS.get(row.process or "", "")
    lines = []
    for name, words in MODEL_WORDS:
        value = getattr(row, name)
        if value is not None:
            ends = f"{number(getattr(row, f'{name}_lo'))} … {number(getattr(row, f'{name}_hi'))}"
            lines.append((words, gain if name == "gain" else "s", number(value), ends))
    return lines


def _promises(row: LoopRow) -> list[tuple[str, str, str]]:
    """Return what is predicted of today's settings and of the new ones: name, today, new."""
    lines = [
        ("Ms, on the model", row.ms, row.new_ms),
        ("Ms, worst model that the data allow", None, row.new_ms_worst),
        ("error after a set-point step, IAE of a unit step [s]", row.iae_setpoint, row.new_iae_setpoint),
        ("error after a load step, IAE of a unit step [PV s/OP]", row.iae_load, row.new_iae_load),
        ("noise that the controller puts on OP [% of span]", None, row.new_op_noise),
        ("the same [OP]", None, row.new_op_noise_abs),
        ("closed-loop index CI, predicted", None, row.new_ci),
        ("CI after set-point steps, measured", row.ci_setpoint, None),
        ("CI after load steps, measured", row.ci_load, None),
    ]
    told = [(name, number(now), number(new)) for name, now, new in lines]
    told.insert(2, ("overshoot after a set-point step", percent(row.overshoot), percent(row.new_overshoot)))
    return [(name, now, new) for name, now, new in told if now or new]


def health_of(row: LoopRow) -> list[tuple[str, str]]:
    """Return the health figures that the data carry: name, value; what they mean stands once in the page."""
    return [(name, number(getattr(row, name))) for name in MEANINGS if getattr(row, name) is not None]
