"""Settings by a tuning rule, with robustness and predicted responses: rows of a table."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from tuners.blocks import Block, find_block
from tuners.faceplate import Faceplate, to_block
from tuners.models import INTEGRATING, SELF_REGULATING, IntegratingModel, Model, SelfRegulatingModel
from tuners.relay import relay_ifopdt, relay_ipdt
from tuners.responses import Response, closed_loop_response
from tuners.robustness import margins
from tuners.rules import RULES, Rule
from tuners.settings import FORMS, Settings

SUGGESTED_COLUMNS = {
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
SORTABLE = ("rule", *SUGGESTED_COLUMNS, "mt", "settling_time")


class Suggested(NamedTuple):
    """Answers to one question, as rows of a table."""

    rows: list[dict[str, Any]]
    """A row per rule, the best in the column asked for first."""
    skipped: dict[str, str]
    """Rules that do not serve, and why."""
    responses: dict[str, tuple[Response, Response]]
    """By rule: after a set-point step, and after a load step."""


def suggest(
    rule: str | None,
    model: Model,
    *,
    form: str | None = None,
    block: str | None = None,
    pv_span: float = 100.0,
    op_span: float = 100.0,
    sort: str = "iae_load",
    **parameters: float | None,
) -> Suggested:
    """Return settings by one rule or all, with robustness and predicted responses.

    Parameters
    ----------
    rule
        Name of a rule, or 'all'.
    model
        Process model; see `model_of` and `model_of_relay`.
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

    Examples
    --------
    >>> found = suggest("simc-pi", IntegratingModel(gain=0.05, dead_time=4.0))
    >>> found.rows[0]["kp"], found.rows[0]["ti"], round(found.rows[0]["ms"], 2)
    (2.5, 32.0, 1.7)
    """
    _check(rule, sort, form, block)
    given = {name: _finite(name, value) for name, value in parameters.items() if value is not None}
    faceplate = find_block(block) if block is not None else None
    out = Suggested([], {}, {})
    for name in RULES if rule == "all" else (str(rule),):
        try:
            settings, plate = _settings(RULES[name], model, given, form, faceplate, (pv_span, op_span))
            row = _row(name, RULES[name], model, settings)
            out.responses[name] = _responses(model, settings)
        except ValueError as reason:
            if rule != "all":
                raise
            out.skipped[name] = str(reason)
            continue
        out.rows.append(row | _predicted(*out.responses[name]) | _shown(plate))
    out.rows.sort(key=lambda row: (row[sort] is None, row[sort] if row[sort] is not None else 0))
    return out


def _check(rule: str | None, sort: str, form: str | None, block: str | None) -> None:
    """Raise ValueError for words that are none, saying what is accepted."""
    if rule != "all" and rule not in RULES:
        raise ValueError(f"rule = {rule!r}: must be all or one of {', '.join(RULES)}")
    if sort not in SORTABLE:
        raise ValueError(f"sort = {sort!r}: must be one of {', '.join(SORTABLE)}")
    if form is not None and form not in FORMS:
        raise ValueError(f"form = {form!r}: must be one of {', '.join(FORMS)}")
    if form is not None and block is not None:
        raise ValueError("form, block: give one of them, a block has its own form")


def model_of(
    process: str, gain: float | None, dead_time: float | None, lag: float = 0.0, lag2: float = 0.0
) -> Model:
    """Return a model of numbers as a user gives them.

    Parameters
    ----------
    process
        'integrating' or 'self-regulating'.
    gain
        Signed [PV/(OP s)] or [PV/OP].
    dead_time, lag, lag2
        Times; a second lag for self-regulating processes only [s].

    Raises
    ------
    ValueError
        A number is missing or not acceptable.
    """
    gain, dead_time = _finite("gain", gain), _finite("dead_time", dead_time)
    lag, lag2 = _finite("lag", lag), _finite("lag2", lag2)
    if process == SELF_REGULATING:
        return SelfRegulatingModel(gain, dead_time, lag, lag2)
    if process != INTEGRATING:
        raise ValueError(f"process = {process!r}: must be integrating or self-regulating")
    if lag2 != 0:
        raise ValueError(f"lag2 = {lag2:g}: is for self-regulating processes, must be 0")
    return IntegratingModel(gain, dead_time, lag)


def model_of_relay(
    output: float | None, period: float | None, amplitude: float | None, gain: float | None = None
) -> IntegratingModel:
    """Return the integrating model that a relay test shows, as a user gives its numbers.

    Parameters
    ----------
    output
        Height of the relay: OP went up and down by as much [OP].
    period, amplitude
        Of the limit cycle; the amplitude is half of peak to peak [s], [PV].
    gain
        Known gain, signed, which shows the lag too; None: no lag, and a positive gain [PV/(OP s)].

    Raises
    ------
    ValueError
        A number is missing or not acceptable.

    Examples
    --------
    >>> model_of_relay(output=1.0, period=16.0, amplitude=0.2)
    IntegratingModel(gain=0.05, dead_time=4.0, lag=0.0)
    """
    named = {"relay_output": output, "relay_period": period, "relay_amplitude": amplitude}
    for name, value in named.items():
        if _finite(name, value) <= 0:
            raise ValueError(f"{name.replace('_', '-')} = {value}: must be above 0")
    relay, period, amplitude = (_finite(name, value) for name, value in named.items())
    if gain is None:
        return relay_ipdt(relay, period, amplitude)
    if _finite("gain", gain) == 0:
        raise ValueError("gain = 0: must be a number other than 0")
    return relay_ifopdt(gain, relay, period, amplitude)


def _finite(name: str, value: float | None) -> float:
    if value is None or not math.isfinite(value):
        wanted = "must be given" if value is None else "must be a finite number"
        raise ValueError(f"{name.replace('_', '-')} = {value}: {wanted}")
    return value


def _settings(
    rule: Rule,
    model: Model,
    given: dict[str, float],
    form: str | None,
    block: Block | None,
    spans: tuple[float, float],
) -> tuple[Settings, Faceplate | None]:
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


def _shown(plate: Faceplate | None) -> dict[str, Any]:
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
