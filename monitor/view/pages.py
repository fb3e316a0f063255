"""The words of the view: rows and events as markdown and log lines. Pure functions of plain dicts.

Whatever comes from outside (names, reasons) is data: it can neither format the page, nor link, nor turn the
direction of the text. Figures are shown with their unit, and with their interval where they have one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeGuard

import msgspec

from monitor.contract.danger import danger, kind_of
from monitor.contract.evidence import Scale
from monitor.contract.figures import GAIN_UNITS, MEANINGS, in_units
from monitor.contract.looks import LOOKS
from monitor.contract.records import LoopRow
from monitor.contract.text import escape, plain

Row = Mapping[str, object]
"""A record as it came over the wire: nothing is known of its values."""

_REMARKS = ("note", "unavailable")
"""Keys of a faceplate that are no fields."""
TABLE_ROWS = 30
"""Rows of the overview's table: more do not help a reader, and the page is sent anew at each change."""

_MODEL = (("gain", "gain μ"), ("t0", "T0"), ("dead_time", "dead time θ"), ("lag", "lag τ₁"))
_SETTINGS = (("kp", "Kp", "OP/PV"), ("ti", "Ti", "s"), ("td", "Td", "s"), ("tf", "Tf", "s"))
_PARALLEL = (("kp", "Kp", "OP/PV"), ("ki", "Ki", "OP/(PV s)"), ("kd", "Kd", "OP s/PV"))
_KINDS = {"setpoint": "set-point step", "load": "load step", "disturbance": "upset that is no clean step"}


def number(value: object, digits: int = 3) -> str:
    """Write a figure with ``digits`` significant digits; ``–`` where there is none.

    Examples
    --------
    >>> number(0.023456), number(None)
    ('0.0235', '–')
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value and not 1e-4 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}e}"
    decimals = max(0, digits - 1 - (math.floor(math.log10(abs(value))) if value else 0))
    return f"{value:.{min(decimals, 8)}f}"


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether a value is a finite number."""
    return isinstance(value, (int, float)) and math.isfinite(value)


def clock(iso: object) -> str:
    """ISO time as ``2026-03-02 08:10:05`` [UTC]; ``–`` where there is none."""
    return plain(str(iso)[:19].replace("T", " ")) if isinstance(iso, str) else "–"


def moment(iso: object) -> str:
    """Say an ISO time with its zone; one that counts from a start, not from 1970, as such.

    Examples
    --------
    >>> moment("2026-03-02T08:10:05Z"), moment("1970-01-01T00:25:00Z")
    ('2026-03-02 08:10:05 UTC', '00:25:00 from the start')
    """
    text = clock(iso)
    return f"{text[11:]} from the start" if text.startswith("1970-01-01") else f"{text} UTC"


def indices(row: Row) -> list[float]:
    """List the row's CI figures: set point, load."""
    found = (row.get("ci_setpoint"), row.get("ci_load"))
    return [float(ci) for ci in found if isinstance(ci, (int, float)) and math.isfinite(ci)]


def scale_of(row: Row) -> Scale:
    """Return the units of a loop's row, and its noise, as far as they are known."""
    unit, op_unit = (text if isinstance(text := row.get(k), str) else "" for k in ("unit", "op_unit"))
    noise = row.get("noise")
    return Scale(unit, op_unit, float(noise) if is_number(noise) else None)


def overview(rows: Sequence[Row], counts: Mapping[str, int], closing: Iterable[str]) -> str:
    """Build the first page: how many loops there are of each kind, and those that need somebody, in the order given.

    Parameters
    ----------
    rows
        Loops that need somebody, worst first.
    counts
        Loops by kind, of `monitor.contract.summary.KINDS`.
    closing
        Lines at the end: who watches, and what is not shown.
    """
    known = [f"**{counts.get(kind, 0)}** {look.words}" for kind, look in LOOKS.items() if counts]
    lines = ["# Control loops", "", " · ".join(known), ""]
    if rows:
        lines += ["| loop | | CI | Ms | new Ms |", "|---|---|--:|--:|--:|"]
        lines += [_overview_row(row) for row in rows[:TABLE_ROWS]]
        lines += ["", f"and {len(rows) - TABLE_ROWS} more.", ""] if len(rows) > TABLE_ROWS else [""]
        lines += ["**Why**", ""]
        lines += [f"- **{escape(row.get('loop', ''), 40)}**: {escape(_why(row), 160)}" for row in rows[:8]]
    else:
        lines += ["No loop is flagged."]
    lines += ["", *(f"*{escape(line, 300)}*\n" for line in closing)]
    return "\n".join(lines) + "\n"


def loop_page(row: Row, assessment: Row | None = None) -> str:
    """Build the page of one loop: verdict, reason, what to type in, model with intervals, before and after.

    Parameters
    ----------
    row
        The loop's row (a suggestion, or its current row). ``kp, ti, td, tf`` are today's settings, if given.
    assessment
        The event that the charts show, if known.
    """
    lines = [f"# {escape(row.get('loop', ''), 60)}", "", f"**{escape(_verdict(row))}**"]
    if row.get("reason"):
        lines += ["", escape(row["reason"], 400)]
    if row.get("action"):
        lines += ["", f"**What to do:** {escape(row['action'], 400)}"]
    flags = row.get("flags")
    if isinstance(flags, Sequence) and not isinstance(flags, str) and flags:
        lines += ["", f"**Flags:** {escape(', '.join(plain(f, 30) for f in flags).replace('_', ' '), 300)}"]
    lines += ["", *_settings(row), "", *_before_after(row), "", *_model(row)]
    lines += ["", *_event(assessment, scale_of(row))] if assessment else []
    lines += ["", *_condition(row)]
    return "\n".join(lines) + "\n"


def log_line(record: Row) -> tuple[str, str]:
    """Build text and level (``INFO``, ``WARN``) of an event or an assessment for the log."""
    name, kind = plain(record.get("loop", "?"), 60), _kind(record)
    when = clock(record.get("start"))[5:16]
    if "verdict" not in record:
        return f"{when} {name}: {kind} {plain(record.get('state', ''), 30)}", "INFO"
    index = "" if record.get("kind") == "disturbance" else f", CI {number(record.get('ci'), 2)}"
    text = f"{when} {name}: {_verdict(record)}, {kind}{index}"
    if record.get("reason"):
        text += f" ({plain(record['reason'], 160)})"
    return text, "WARN" if record.get("verdict") == "retune" else "INFO"


def _verdict(row: Row) -> str:
    verdict = plain(row.get("verdict", ""), 40)
    if verdict == "retune" and "new_kp" in row and row.get("new_kp") is None:
        return "retune, no safe settings to suggest"
    return verdict.replace("_", " ")


def _kind(record: Row) -> str:
    return _KINDS.get(str(record.get("kind")), "event")


def _why(row: Row) -> str:
    return str(row.get("reason") or row.get("action") or "badly tuned")


def _overview_row(row: Row) -> str:
    worst = min(indices(row), default=None)
    cells = (
        escape(row.get("loop", ""), 28),
        _what(row),
        number(worst, 2),
        number(row.get("ms"), 2),
        number(row.get("new_ms"), 2),
    )
    return "| " + " | ".join(cells) + " |"


def _what(row: Row) -> str:
    """Say in a word or two what is to be done with a loop."""
    record = as_record(row)
    return "**near instability**" if danger(record) == 0 else LOOKS[kind_of(record)].words


def as_record(row: Row) -> LoopRow:
    """Return a loop's row as it came over the wire as the record that it is.

    Raises
    ------
    msgspec.ValidationError
        It is none.
    """
    return msgspec.convert({n: v for n, v in row.items() if v is not None}, LoopRow)


def health_line(health: Row | None) -> str:
    """Say who watches, and how much."""
    if not health:
        return "Waiting for the monitor's health record."
    shown = ("samples_ok", "dropped", "backlog", "queue")
    facts = [f"{key.replace('_', ' ')} {health[key]:,.0f}" for key in shown if is_number(health.get(key))]
    rates = health.get("rates")
    if isinstance(rates, Mapping) and is_number(rates.get("samples")):
        facts.insert(0, f"{rates['samples']:,.0f} samples/s")
    return f"Monitor {plain(health.get('id', ''), 60)} alive. {', '.join(facts)}".strip()


def _settings(row: Row) -> list[str]:
    if row.get("new_kp") is None:
        return ["## Settings", "", "No new settings are suggested."]
    fields = _PARALLEL if row.get("form") == "parallel" else _SETTINGS
    lines = ["## Settings", "", *_faceplate(row), "| | today | new |", "|---|--:|--:|"]
    for key, words, unit in fields:
        today, new = _setting(row, key), _setting(row, f"new_{key}")
        if any(text not in ("–", "0.00", "none") for text in (today, new)):
            lines.append(f"| {words} \\[{_unit(unit, row)}\\] | {today} | **{new}** |")
    rule, form = escape(row.get("rule") or "–", 60), escape(row.get("form") or "–", 60)
    return [*lines, "", f"Rule {rule}, form {form}.", *_stages(row)]


def _faceplate(row: Row) -> list[str]:
    """Return the table of what is typed in, by the fields of the loop's block."""
    today, new = (_json(row.get(key)) for key in ("fields", "new_fields"))
    if not isinstance(new, Mapping) or not set(new) - {key for key, *_ in (*_SETTINGS, *_PARALLEL)}:
        return []
    today = today if isinstance(today, Mapping) else {}
    lines = ["| on the faceplate | today | type in |", "|---|--:|--:|"]
    for key in [k for k in new if k not in _REMARKS][:12]:
        old = escape(_value(today[key]), 40) if key in today else "–"
        lines.append(f"| {escape(key, 40)} | {old} | **{escape(_value(new[key]), 40)}** |")
    return [*lines, ""]


def _unit(unit: str, row: Row) -> str:
    """Return a figure's unit by the loop's own."""
    scale = scale_of(row)
    return escape(in_units(unit, plain(scale.unit, 20), plain(scale.op_unit, 20)), 60)


def _setting(row: Row, key: str) -> str:
    if key.endswith("ti") and key in row and row[key] is None and row.get(key[:-2] + "kp") is not None:
        return "none"  # no integral action is null in JSON
    return number(row.get(key))


def _stages(row: Row) -> list[str]:
    stages = _json(row.get("stages"))
    if not isinstance(stages, list) or len(stages) < 2:
        return []
    lines = ["", "Type in the first one now; each other one when a step has confirmed the one before:", ""]
    for i, stage in enumerate(stages[:10], 1):
        facts = stage.items() if isinstance(stage, Mapping) else ()
        told = (f"{escape(k, 20).capitalize()} {escape(_value(v), 20)}" for k, v in facts if _tells(k, v))
        lines.append(f"{i}. {', '.join(told)}")
    return lines


def _tells(key: str, value: object) -> bool:
    """Whether a stage's field is worth its place: a derivative that is not there is not."""
    return key in ("kp", "ti", "ki") or (key in ("td", "tf", "kd") and bool(value))


def _before_after(row: Row) -> list[str]:
    figures = (
        ("CI set point", number(row.get("ci_setpoint"), 2), _new_ci(row, "ci_setpoint")),
        ("CI load", number(row.get("ci_load"), 2), _new_ci(row, "ci_load")),
        ("peak sensitivity Ms", number(row.get("ms")), number(row.get("new_ms"))),
        ("Ms at the model's worst", "–", number(row.get("new_ms_worst"))),
        ("noise on OP \\[% of span\\]", "–", number(row.get("new_op_noise"), 2)),
    )
    known = [f"| {name} | {today} | {new} |" for name, today, new in figures if (today, new) != ("–", "–")]
    return ["## Before and after", "", "| | today | new |", "|---|--:|--:|", *known] if known else []


def _new_ci(row: Row, key: str) -> str:
    return number(row.get("new_ci"), 2) if row.get(key) is not None else "–"


def _model(row: Row) -> list[str]:
    process = plain(row.get("process") or "undecided", 40)
    unit = GAIN_UNITS.get(process, "–")
    lines = [f"## Model: {escape(process)}", "", "| | value | 95 % interval |", "|---|--:|---|"]
    for key, words in _MODEL:
        if row.get(key) is None:
            continue
        low, high = number(row.get(f"{key}_lo")), number(row.get(f"{key}_hi"))
        lines.append(
            f"| {words} \\[{_unit(unit, row) if key == 'gain' else 's'}\\] | {number(row[key])} | {low} … {high} |"
        )
    return lines if len(lines) > 4 else [*lines[:1], "", "The data cannot carry a model."]


def event_title(record: Row, scale: Scale) -> str:
    """Say in a line what an event was, and when."""
    return f"{step_words(str(record.get('kind')), record.get('amplitude'), scale)}, {moment(record.get('start'))}"


def step_words(kind: str, size: object, scale: Scale) -> str:
    """Say what kind of step it is, and how large."""
    unit = {"load": scale.op_unit or "OP"}.get(kind, scale.unit or "PV")
    return f"{_KINDS.get(kind, 'event')} of {number(size)} {plain(unit, 20)}"


def _event(record: Row, scale: Scale) -> list[str]:
    title = event_title(record, scale)
    said = f"{title[:1].upper()}{escape(title[1:])}"
    figures = (
        ("CI {}", number(record.get("ci"), 2)),
        ("model explains {} % of PV", number(_percent(record.get("fit")))),
        ("back within {} s", number(record.get("recovery"))),
        ("overshoot {} %", number(_percent(record.get("overshoot")))),
        ("damping {}", number(record.get("damping"), 2)),
    )
    known = [words.format(figure) for words, figure in figures if figure != "–"]
    return ["## Event shown", "", f"{', '.join([said, *known])}."]


def _condition(row: Row) -> list[str]:
    """Show the loop's health figures, those that the data carry."""
    known = [(name, meaning) for name, meaning in MEANINGS.items() if is_number(row.get(name))]
    if not known:
        return []
    return ["## Health", ""] + [
        f"- **{name.replace('_', ' ')}** {number(row[name])} \\[{_unit(meaning.unit, row)}\\]: {meaning.says}"
        for name, meaning in known
    ]


def _percent(share: object) -> float | None:
    return 100 * float(share) if isinstance(share, (int, float)) else None


def _value(value: object) -> str:
    if value is None:
        return "none"
    return number(value) if is_number(value) else plain(value, 40)


def _json(value: object) -> object:
    """Fields that are JSON in a table's cell may come as text or as what the text holds."""
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value)
    except ValueError:
        return None
