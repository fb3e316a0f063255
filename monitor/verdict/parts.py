"""What a loop's events say of its tuning, and the settings that follow: the frozen parts of its row."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from monitor.advise.prediction import Predicted
from monitor.advise.suggestion import Advice
from monitor.assess.reference import settings_of
from monitor.contract.loops import Loop
from monitor.contract.records import NOT_ASSESSED
from monitor.contract.text import duration
from tuners.blocks import BLOCKS
from tuners.faceplate import fields_of
from tuners.settings import FORMS, Settings

WATCHED_INTEGRAL_TIMES = 3.0
"""Integral times after a step within which a loop shows whether it comes to rest."""
Figures = Mapping[str, float | None]
"""By column of the loop's row."""


@dataclass(frozen=True, slots=True)
class Suggested:
    """Settings that are suggested, as columns of the row."""

    action: str
    """What to set, in words."""
    rule: str
    form: str
    figures: Figures
    """The settings, what robustness and errors are predicted of them: ``new_*``."""
    stages: str
    """JSON."""
    fields: str | None
    """The block's own fields, JSON; None where they cannot be given."""
    today: Figures
    """What is predicted of the settings of today: stays where the suggestion is withheld."""
    stage_fields: str | None = None
    """The block's fields for each stage, JSON; None where they are the form's own."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """What the events say; as it is here where there were none."""

    verdict: str = NOT_ASSESSED
    reason: str = ""
    action: str = ""
    events: int = 0
    ci_setpoint: float | None = None
    ci_load: float | None = None
    ms: float | None = None
    """Of the settings of today on the model."""
    process: str | None = None
    model: Figures = field(default_factory=dict)
    """Gain, times and their intervals, of all usable events; empty where they do not agree."""
    suggested: Suggested | None = None
    moves: str = ""
    """What became of the set point's moves, in words."""
    led: bool = False
    """The set point moves all the time."""
    ramps: tuple[int, int] = (0, 0)
    """Moves of the set point with an event of their own: by ramps, and all."""
    disturbances: int = 0
    """Upsets that are no clean step."""
    upsets: str = ""
    """What they were like, in words; empty where there were none."""
    contradiction: str = ""
    """In what the data contradict the settings of the table, or any linear controller; empty where they do not."""


def suggested(loop: Loop, advice: Advice) -> Suggested:
    """Return a suggestion as columns of the loop's row."""
    new = advice.settings
    figures: dict[str, float | None] = {f"new_{n}": float(getattr(new, n)) for n in ("kp", "ti", "td", "tf")}
    if new.form == "parallel":
        figures |= {"new_ki": float(new.ki), "new_kd": float(new.kd)}
    figures |= {"new_ms": advice.ms, "new_ms_worst": advice.ms_worst, "new_ci": advice.ci}
    figures |= {f"new_{name}": value for name, value in _predicted(advice.after).items()}
    figures["new_op_noise_abs"] = advice.op_noise
    if loop.op_span is not None:
        figures["new_op_noise"] = 100.0 * advice.op_noise / loop.op_span
    action = "; ".join(filter(None, [f"set {_words(new)}", _rest_of_the_way(advice), _watch(loop, new)]))
    fields = None
    try:
        fields = json.dumps(_fields(loop, new))
    except ValueError as error:  # a faceplate in % without the loop's spans, or a form that cannot hold them
        action += f"; the fields of {loop.form} cannot be given: {error}"
    stages = json.dumps([_plain(s) for s in advice.stages])
    today = {} if advice.before is None else _predicted(advice.before)
    shown = [faceplate_of(loop, s) for s in advice.stages]
    each = None if None in shown else f"[{', '.join(map(str, shown))}]"
    return Suggested(action, advice.rule, loop.form, figures, stages, fields, today, each)


def faceplate_of(loop: Loop, settings: Settings | None) -> str | None:
    """Return settings as the faceplate of the loop's block shows them, JSON.

    None where they are not known, cannot be given, or where the loop's form shows them as they are.
    """
    if settings is None or loop.form in FORMS:
        return None
    try:
        return json.dumps(_fields(loop, settings))
    except ValueError:  # a form that cannot hold them
        return None


def _rest_of_the_way(advice: Advice) -> str:
    """Say where the settings lead, and why not all the way at once; empty where they are the aim."""
    if advice.aim == advice.settings:
        return ""
    why = f" ({advice.limited_by})" if advice.limited_by else ""
    return (
        f"this is part of the way to {_words(advice.aim)}{why}: the next part follows when a set-point or load step "
        "under it has confirmed the model"
    )


def _watch(loop: Loop, new: Settings) -> str:
    """Say what to watch, when to stop, and what to go back to; empty where the settings of today are not known."""
    today = settings_of(loop)
    if today is None:
        return ""
    ti = float(new.ti)
    time = f" for {duration(WATCHED_INTEGRAL_TIMES * ti)}" if math.isfinite(ti) else ""
    return f"watch PV and OP{time} after the next step: if they go on swinging, go back to {_words(today)}"


def _predicted(of: Predicted) -> dict[str, float | None]:
    """Return what settings make of unit steps, by column."""
    setpoint, load = of.iae.values()
    return {"overshoot": of.overshoot, "iae_setpoint": setpoint, "iae_load": load}


def _fields(loop: Loop, settings: Settings) -> Mapping[str, object]:
    """Return the fields of the loop's block, or the form's own names."""
    if loop.form not in FORMS:
        return fields_of(BLOCKS[loop.form], settings, loop)
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
