"""A loop's row, built once from its parts: tuning, health, and what the tree of verdicts concludes of both."""

from __future__ import annotations

import math

from monitor.contract.loops import Loop
from monitor.contract.records import LoopRow
from monitor.health.loop_health import Health
from monitor.identify.controller_seen import Controller

from .in_force import InForce
from .parts import Figures, Tuning, faceplate_of
from .tree import conclude


def loop_row(in_force: InForce, tuning: Tuning, health: Health) -> LoopRow:
    """Return a loop's row: its verdict, the evidence, and a suggestion where none of the tree's branches withholds it.

    Parameters
    ----------
    in_force
        The loop's settings of today, and where they are known from.
    tuning
        What its events say.
    health
        What its samples say, of the same moment.
    """
    loop = in_force.loop
    found = conclude(tuning, loop, health)
    suggested = tuning.suggested
    shown = None if found.withheld else suggested
    return LoopRow(
        loop=loop.name,
        verdict=found.verdict,
        reason=found.reason,
        action=found.action,
        flags=found.flags,
        events=tuning.events,
        setpoint_moves=tuning.moves,
        disturbances=tuning.disturbances,
        ci_setpoint=tuning.ci_setpoint,
        ci_load=tuning.ci_load,
        ms=tuning.ms,
        process=tuning.process,
        rule=None if shown is None else shown.rule,
        form=None if shown is None else shown.form,
        stages=None if shown is None else shown.stages,
        new_fields=None if shown is None else shown.fields,
        stage_fields=None if shown is None else shown.stage_fields,
        fields=faceplate_of(loop, loop.settings),
        settings_source=in_force.source,
        unit=loop.unit,
        op_unit=loop.op_unit,
        **tuning.model,
        **({} if shown is None else shown.figures),
        **({} if suggested is None else suggested.today),
        **_of_health(health, loop.op_span),
        **_of_today(loop),
        **_seen(in_force.seen or in_force.guess, loop.canonical_form),
    )


def _of_health(health: Health, op_span: float | None) -> Figures:
    """Return the columns that are figures of health."""
    return {
        "coverage": health.coverage,
        "manual": health.manual,
        "saturation": health.saturation,
        "offset": health.offset,
        "noise": health.noise,
        "quantum": health.quantum,
        "travel_per_hour": health.travel_per_hour,
        "reversals_per_hour": health.reversals_per_hour,
        "oscillation_period": health.oscillation_period,
        "oscillation_regularity": health.oscillation_regularity,
        "oscillating_share": health.signs.oscillating_share,
        **_of_episodes(health),
        **_of_valve(health, op_span),
        "harris": health.harris,
        "compression": health.compression,
    }


def _of_valve(health: Health, op_span: float | None) -> Figures:
    """Return how surely the valve sticks, and its band [% of OP's span, OP where that is not known]."""
    valve = health.signs.valve
    if valve is None:
        return {"stiction": health.stiction}
    return {
        "stiction": max(valve.strength, health.stiction or 0.0),
        "dead_band": valve.band / (op_span or 100.0) * 100.0,
    }


def _of_episodes(health: Health) -> Figures:
    """Return the columns of a loop's episodes of oscillation, where it is said to oscillate."""
    spans = health.signs.spans
    if not spans or not (health.oscillating or health.signs.oscillating):
        return {}
    longest = max(spans, key=lambda span: span.duration)
    ends: Figures = {
        "oscillation_start": spans[0].start * 1e-9,
        "oscillation_end": max(s.end for s in spans) * 1e-9,
    }
    own = {"oscillation_period": longest.period} if health.oscillation_period is None else {}
    return {**ends, **own, "oscillation_amplitude": longest.amplitude}


def _of_today(loop: Loop) -> Figures:
    """Return the columns that are the settings of today."""
    if loop.kp is None:
        return {}
    return {"kp": loop.kp, "ti": loop.ti, "td": loop.td, "tf": loop.filter_time}


def _seen(controller: Controller | None, form: str) -> Figures:
    """Return the columns of the controller as the data show it, in the loop's form where that can hold it."""
    if controller is None:
        return {}
    figures: dict[str, float | None] = {"settings_explained": controller.explained}
    own = controller.settings_in(form)
    for name in ("kp", "ti", "td"):
        part = getattr(controller, name)
        if math.isnan(part.value):
            continue
        standard = 0.0 if controller.settings is None else float(getattr(controller.settings, name))
        turned = own is not None and 0.0 < abs(standard) < math.inf
        ratio = float(getattr(own, name)) / standard if turned else 1.0
        ends = {"": part.value, "_lo": part.low, "_hi": part.high}
        figures |= {f"{name}_seen{end}": ratio * value for end, value in ends.items()}
    figures |= {f"{name}_seen": getattr(controller, name) for name in ("pv_filter", "op_delay")}
    return figures | {"scan_seen": controller.scan or None}


def says_new(old: LoopRow, new: LoopRow) -> bool:
    """Whether a row suggests something else than one before."""
    names = ("rule", "new_kp", "new_ti", "new_td", "new_tf")
    return any(getattr(old, name) != getattr(new, name) for name in names)
