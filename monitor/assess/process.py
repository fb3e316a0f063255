"""Which process an event shows: the kinds that the loop may be, the one that the data leave, and its rivals."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from monitor.contract.loops import Loop
from monitor.detect.event import LOAD_STEP, SETPOINT_RAMP, ClosedEvent
from monitor.identify.direct import fit_kinds, fit_window
from monitor.identify.fit import Fit, contradictory, decide, rivals_of
from monitor.identify.indirect import LEAST_OP_EXPLAINED, indirect_fit, op_explained
from tuners.models import INTEGRATING, SELF_REGULATING

from .evidence import NOISY_RANGE_SHARE, is_explained, is_wide
from .reference import settings_of

LIKELY_LOAD_RATIO = 2.0
"""Of the residuals in those of the model believed, up to which the other kind of process may be right after a load."""


class Shown(NamedTuple):
    """What an event shows of the process."""

    fit: Fit | None
    """The model that is believed."""
    decided: bool
    """Its kind is beyond doubt."""
    contradiction: str
    """In what the data contradict the kind that the table declares, in words; empty where they do not."""
    direct: list[Fit]
    """The direct fits that were made."""


def model_of_event(loop: Loop, event: ClosedEvent) -> Shown:
    """Return the model that an event shows.

    Where the kind that the table declares does not explain the event, or by a gain of the wrong sign or of any size
    alone, and the other one does, that is the process.
    """
    shown = _identify(loop, event)
    fit = shown.fit
    if fit is None or loop.process == "auto" or not shown.decided:
        return shown
    wrong = not is_explained(fit, event) or (loop.kp is not None and fit.gain * loop.kp < 0)
    # a load through a lag makes an integrating process look like a self-regulating one
    if not is_wide(fit) and (not wrong or event.kind == LOAD_STEP):
        return shown
    both = _both_kinds(event)
    other, sure = decide(both, float(event.window.time[-1]))
    if other is None or not sure or other.process == fit.process or not is_explained(other, event):
        return shown
    if is_wide(other) or (loop.kp is not None and other.gain * loop.kp < 0):
        return shown
    said = f"the table calls the process {loop.process}, the data show a {other.process} one"
    return Shown(other, True, said, both)


def rivals(event: ClosedEvent, shown: Shown) -> tuple[Fit, ...]:
    """Return the models of the other kind of process that an event does not exclude."""
    if shown.fit is None:
        return ()
    kind, direct = shown.fit.process, shown.direct
    if len(direct) == 1 and kind == SELF_REGULATING:  # its likelihood is that of a model with two lags, too
        load = event.kind == LOAD_STEP
        beside = shown.fit.beside_loads
        other = fit_window(event.window, INTEGRATING, load, event.period, compared=True, other_loads=beside)
        direct = [*direct, *([] if other is None else [other])]
    elif len(direct) == 1:
        direct = _both_kinds(event)
    mine = next((f for f in direct if f.process == kind), shown.fit)
    others = [replace(f, extra_delay=shown.fit.extra_delay) for f in direct if f.process != kind]
    if shown.contradiction:  # one event is not enough against what the table declares
        return tuple(f for f in others if f.gain * mine.gain > 0)
    if event.kind == LOAD_STEP:  # likelihoods are those of a load that steps: it may not have
        likely = [f for f in others if f.gain * mine.gain > 0 and f.sigma <= LIKELY_LOAD_RATIO * mine.sigma]
        return tuple(f for f in likely if is_explained(f, event))
    return rivals_of(mine, others)


def _both_kinds(event: ClosedEvent) -> list[Fit]:
    """Fit both kinds of process, their likelihoods comparable."""
    return fit_kinds(event.window, [INTEGRATING, SELF_REGULATING], event.kind == LOAD_STEP, event.period)


def _identify(loop: Loop, event: ClosedEvent) -> Shown:
    """Fit the kinds of process that the loop may be.

    Directly first. A set-point step under much noise is also fitted by simulating the closed loop, where the known
    settings reproduce OP: noise that travels round the loop biases the direct fit, while a wrong order of the
    model costs the simulated loop more. After a load step the simulated loop has false minima and is left out.
    """
    kinds = [INTEGRATING, SELF_REGULATING] if loop.process == "auto" else [loop.process]
    window, period, load = event.window, event.period, event.kind == LOAD_STEP
    span = float(window.time[-1])
    direct = fit_kinds(window, kinds, load, period)
    best, decided = decide(direct, span)
    settings = settings_of(loop)
    noisy = best is not None and best.sigma >= NOISY_RANGE_SHARE * float(np.ptp(window.pv))
    unlike = load or not window.rested or event.kind == SETPOINT_RAMP
    if best is None or unlike or settings is None or not noisy or best.beside_loads:
        return Shown(best, decided, "", direct)
    if op_explained(window, settings, period) < LEAST_OP_EXPLAINED:
        return Shown(best, decided, "", direct)
    fits = [indirect_fit(window, period, settings, f) for f in ([best] if decided else direct)]
    better = [f for f in fits if f is not None and is_explained(f, event) and not contradictory([f], best)]
    if not better:
        return Shown(best, decided, "", direct)
    chosen, sure = decide(better, span)
    return Shown(chosen, decided or (sure and len(better) == len(direct)), "", direct)
