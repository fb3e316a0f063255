"""Settings by a tuning rule, with robustness and predicted responses: rows of a table."""

from __future__ import annotations

import math
from typing import Any

from tuners.blocks import find_block
from tuners.faceplate import to_block
from tuners.models import IntegratingModel, Model, SelfRegulatingModel
from tuners.responses import Response, closed_loop_response
from tuners.robustness import margins
from tuners.rules import RULES, Rule
from tuners.settings import FORMS, Settings

COLUMNS = {
    "kp": "Kp [OP/PV]",
    "ti": "Ti [s]",
    "td": "Td [s]",
    "tf": "Tf [s]",
    "ms": "Ms",
    "gain_margin": "GM",
    "phase_margin": "PM [deg]",
    "delay_margin": "DM [s]",
    "iae_setpoint": "IAE sp [PV s]",
    "iae_load": "IAE load [PV s]",
    "overshoot": "overshoot",
}
SORTABLE = ("rule", *COLUMNS, "mt", "settling_time")


def suggest(
    *,
    rule: str | None,
    gain: float | None,
    dead_time: float | None,
    lag: float = 0.0,
    lag2: float = 0.0,
    process: str = "integrating",
    form: str | None = None,
    block: str | None = None,
    pv_span: float = 100.0,
    op_span: float = 100.0,
    sort: str = "iae_load",
    **parameters: float | None,
) -> tuple[list[dict[str, Any]], dict[str, str], dict[str, tuple[Response, Response]]]:
    """Rows of the table, the rules that were skipped with the reason, and the responses of each row.

    Parameters
    ----------
    rule
        Name of a rule, or 'all'.
    gain, dead_time, lag, lag2, process
        Process model: [PV/(OP s)] or [PV/OP], times [s].
    form, block
        Form, or id of a vendor block; None: the rule's own form.
    pv_span, op_span
        Ranges for blocks that count in % [PV], [OP].
    sort
        Column to sort by, None last.
    **parameters
        Extra parameters of the rules; None: not given.

    Raises
    ------
    ValueError
        For any wrong input, saying what is accepted.
    """
    model = _model(process, gain, dead_time, lag, lag2)
    if rule != "all" and rule not in RULES:
        raise ValueError(f"rule = {rule!r}: must be all or one of {', '.join(RULES)}")
    if sort not in SORTABLE:
        raise ValueError(f"sort = {sort!r}: must be one of {', '.join(SORTABLE)}")
    if form is not None and form not in FORMS:
        raise ValueError(f"form = {form!r}: must be one of {', '.join(FORMS)}")
    if form is not None and block is not None:
        raise ValueError("form, block: give one of them, a block has its own form")
    given = {name: _finite(name, value) for name, value in parameters.items() if value is not None}
    faceplate = find_block(block) if block is not None else None
    rows, skipped, curves = [], {}, {}
    for name in RULES if rule == "all" else (str(rule),):
        try:
            settings, plate = _settings(RULES[name], model, given, form, faceplate, (pv_span, op_span))
            rows.append(_row(name, RULES[name], model, settings))
            curves[name] = _responses(model, settings)
        except ValueError as reason:
            if rule != "all":
                raise
            skipped[name] = str(reason)
            continue
        rows[-1] |= _predicted(*curves[name]) | _shown(plate)
    rows.sort(key=lambda row: (row[sort] is None, row[sort] if row[sort] is not None else 0))
    return rows, skipped, curves


def _finite(name: str, value: float | None) -> float:
    if value is None or not math.isfinite(value):
        wanted = "must be given" if value is None else "must be a finite number"
        raise ValueError(f"{name.replace('_', '-')} = {value}: {wanted}")
    return value


def _model(process: str, gain: float | None, dead_time: float | None, lag: float, lag2: float) -> Model:

    gain, dead_time = _finite("gain", gain), _finite("dead_time", dead_time)
    lag, lag2 = _finite("lag", lag), _finite("lag2", lag2)
    if process == "self-regulating":
        return SelfRegulatingModel(gain, dead_time, lag, lag2)
    if process != "integrating":
        raise ValueError(f"process = {process!r}: must be integrating or self-regulating")
    if lag2 != 0:
        raise ValueError(f"lag2 = {lag2:g}: is for self-regulating processes, must be 0")
    return IntegratingModel(gain, dead_time, lag)


def _settings(
    rule: Rule,
    model: Model,
    given: dict[str, float],
    form: str | None,
    block: Any,
    spans: tuple[float, float],
) -> tuple[Settings, Any]:
    """Return the settings in the form that was asked for, and the faceplate where a block was."""
    if model.process not in rule.processes:
        raise ValueError(
            f"process = {model.process}: this rule is for {' and '.join(rule.processes)} processes"
        )
    missing = [name for name in rule.required if name not in given]
    if missing:
        raise ValueError(f"{', '.join(missing).replace('_', '-')}: must be given for this rule")
    settings = rule.function(model, **{name: given[name] for name in rule.parameters if name in given})
    if block is not None:
        plate = to_block(settings, block, pv_span=spans[0], op_span=spans[1])
        return plate.settings, plate
    return settings.to(form or settings.form), None


def _row(name: str, rule: Rule, model: Model, settings: Settings) -> dict[str, Any]:
    found = margins(model, settings)
    return {
        "rule": name,
        "form": settings.form,
        "structure": rule.structure,
        **{key: _json(getattr(settings, key)) for key in ("kp", "ti", "td", "tf", "b", "c")},
        **({"ki": _json(settings.ki), "kd": _json(settings.kd)} if settings.form == "parallel" else {}),
        **{
            key: _json(getattr(found, key))
            for key in ("ms", "mt", "gain_margin", "phase_margin", "delay_margin")
        },
        "stable": bool(found.stable),
        "source": rule.source,
    }


def _responses(model: Model, settings: Settings) -> tuple[Response, Response]:
    return closed_loop_response(model, settings, "setpoint"), closed_loop_response(model, settings, "load")


def _predicted(setpoint: Response, load: Response) -> dict[str, Any]:
    return {
        "iae_setpoint": _json(setpoint.iae),
        "iae_load": _json(load.iae),
        "overshoot": _json(setpoint.overshoot),
        "settling_time": _json(setpoint.settling_time),
    }


def _shown(plate: Any) -> dict[str, Any]:
    """Return the fields of the block as its faceplate shows them."""
    if plate is None:
        return {}
    fields = {key: _json(value) if isinstance(value, float) else value for key, value in plate.fields.items()}
    return {
        "block": plate.block.id,
        "block_name": plate.block.name,
        "block_verified": plate.block.verified,
        "fields": fields,
        "units": plate.units,
        "notes": list(plate.notes),
    }


def _json(value: Any) -> float | None:
    """Return a float, or None for what JSON cannot hold."""
    number = float(value)
    return number if math.isfinite(number) else None
