"""Verdict and reason in plain words: how fast a loop is (CI), and how safe (Ms), by what it is there for."""

from __future__ import annotations

import math

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, LOAD, RETUNE, SETPOINT
from tuners.levels import method_product
from tuners.models import IntegratingModel, Model
from tuners.robustness import peak_sensitivity
from tuners.settings import NotRepresentableError

from .predicted import NO_INDICES, Indices, predicted_indices
from .reference import settings_of, with_hold_delay

MS_MARGIN_RATIO = 1.25
"""A loop is flagged for robustness above this many times its ``ms_max``: the reference itself may lie near it."""
LEAST_METHOD_PRODUCT = 2.0
"""Kc K Ti below which an integrator under PI rolls (damping below 0.7); good rules lie at 2.4 to 4."""

_INDEX = ("CI_sp", "CI_ld")
_SLOW = ("slow to follow", "slow to recover from a load")
_WELL = ("follows well", "recovers well from a load")
_WOULD = ("would follow a set point slowly", "would recover from a load slowly")
_UNSEEN = ("how it follows a set point was not seen", "how it recovers from a load was not seen")
"""What is said of following a set point, and of recovering from a load."""
_NOT_ROBUST = (
    "its robustness is not known: no settings are that explain OP, and the response does not show its damping"
)


def current_sensitivity(loop: Loop, model: Model | None, period: float) -> float | None:
    """Ms of the loop's settings on a model, sampled every ``period`` [s]; inf where unstable, None where not known."""
    settings = settings_of(loop)
    if model is None or settings is None or float(settings.kp) * float(model.gain) < 0:
        return None
    return float(peak_sensitivity(with_hold_delay(model, period), settings))


def integral_too_strong(loop: Loop, model: Model) -> str:
    """Explain too much integral action on an integrator, empty where that is not the case.

    With a small dead time the damping is ``sqrt(Kc K Ti)/2``: below 2 the loop rolls, and *lowering* the
    gain makes it worse.
    """
    settings = settings_of(loop)
    if not isinstance(model, IntegratingModel) or settings is None or not math.isfinite(loop.ti):
        return ""
    try:
        product = float(method_product(model, settings))
    except NotRepresentableError:
        return ""
    if not 0 < product < LEAST_METHOD_PRODUCT:
        return ""
    longer = 4.0 / (float(settings.to("standard").kp) * float(model.gain))
    return (
        f"the integral action is too strong for the gain: Kc K Ti = {product:.2g} (below 2, damping "
        f"{math.sqrt(product) / 2:.2g}), so the loop rolls; a longer Ti ({longer:.3g} s or more at this gain) or a "
        "higher gain cures it, a lower gain makes it worse"
    )


def indices_to_come(loop: Loop, model: Model, ci: Indices, ms: float | None, period: float) -> Indices:
    """Predict CI_sp and CI_ld where a verdict hangs on them: an index is missing, and nothing speaks for a retune yet.

    Parameters are those of `judge`; ``period``: of the samples [s].
    """
    wanted = wanted_indices(loop)
    slow = any((value := ci[k]) is not None and value < loop.ci_min for k in wanted)
    nervous = ms is None or ms > MS_MARGIN_RATIO * loop.ms_max
    if slow or nervous or loop.objective == "averaging" or all(ci[k] is not None for k in wanted):
        return NO_INDICES
    return predicted_indices(loop, model, ms, period)


def wanted_indices(loop: Loop) -> list[int]:
    """Return which of CI_sp (0) and CI_ld (1) a loop's objective asks for."""
    return [k for k, other in enumerate((LOAD, SETPOINT)) if loop.objective != other]


def judge(
    loop: Loop,
    model: Model,
    ci: Indices,
    ms: float | None,
    over: float,
    predicted: Indices = NO_INDICES,
    damped: bool | None = None,
) -> tuple[str, str]:
    """Verdict and reason for a loop or event whose evidence is trusted.

    Parameters
    ----------
    ci
        CI_sp and CI_ld as measured; the loop's objective says which of them count.
    ms
        Peak sensitivity of the settings of today on the model; None where they are not known [-].
    over
        Overshoot after the set-point step, as a share of it [-].
    predicted
        CI_sp and CI_ld as the settings of today have them on the model: they count where none was measured.
    damped
        Whether the response shows by itself that it is well damped; None where it shows nothing of it.
    """
    if loop.objective == "averaging":
        return _judge_averaging(loop, model, ms, damped)
    reasons = []
    if ms is not None and ms > MS_MARGIN_RATIO * loop.ms_max:
        said = "unstable on the model" if math.isinf(ms) else f"Ms = {ms:.2f}"
        reasons.append(f"too close to instability: {said} ({MS_MARGIN_RATIO * loop.ms_max:.3g} at most)")
    shape = f", overshoot {over:.0%}" if over > 0.1 else ""
    wanted = wanted_indices(loop)
    reasons += [
        f"{_SLOW[k]}: {_INDEX[k]} = {value:.2f} ({loop.ci_min:.2g} at least{shape})"
        for k in wanted
        if (value := ci[k]) is not None and value < loop.ci_min
    ]
    reasons = reasons or _slow_by_prediction(loop, ci, predicted, wanted)
    if reasons:
        cause = integral_too_strong(loop, model)
        return RETUNE, "; ".join([*reasons, cause] if cause else reasons)
    return _not_slow(loop, ci, predicted, wanted, ms is not None or damped is True)


def _slow_by_prediction(loop: Loop, ci: Indices, predicted: Indices, wanted: list[int]) -> list[str]:
    """Say what would be slow of what no event has shown, after what was seen to be fast enough."""
    seen = [f"{_WELL[k]} ({_INDEX[k]} = {ci[k]:.2f})" for k in wanted if ci[k] is not None]
    slow = [
        f"{_WOULD[k]}: {_INDEX[k]} = {value:.2f} predicted ({loop.ci_min:.2g} at least)"
        for k in wanted
        if ci[k] is None and (value := predicted[k]) is not None and value < loop.ci_min
    ]
    return [" but ".join([*seen, " and ".join(slow)])] if slow else []


def _not_slow(
    loop: Loop, ci: Indices, predicted: Indices, wanted: list[int], robust: bool
) -> tuple[str, str]:
    """Verdict where nothing speaks against the loop; ``robust``: Ms, or the damping, is known to be in order."""
    seen = [k for k in wanted if ci[k] is not None]
    known = [k for k in wanted if ci[k] is not None or predicted[k] is not None]
    if not known and any(value is not None for value in ci):
        return INCONCLUSIVE, f"no index for what the loop is there for: its objective is {loop.objective}"
    if not known:
        return INCONCLUSIVE, "no index: the event ended before the loop had come to rest"
    figures = ", ".join(f"{_INDEX[k]} = {ci[k]:.2f}" for k in seen)
    if not robust:
        return INCONCLUSIVE, f"fast enough ({figures}), but {_NOT_ROBUST}"
    if loop.kp is None:
        unseen = "".join(f"; {_UNSEEN[k]}" for k in wanted if k not in known)
        return GOOD, f"by the speed and the damping of its response: its settings are not known{unseen}"
    if not seen:
        said = ", ".join(f"{_INDEX[k]} = {predicted[k]:.2f}" for k in known)
        return GOOD, f"{said} predicted: none was measured"
    return GOOD, ""


def _judge_averaging(loop: Loop, model: Model, ms: float | None, damped: bool | None) -> tuple[str, str]:
    """Judge a surge vessel by what it is for: gentle, not tight."""
    if ms is not None and ms > MS_MARGIN_RATIO * loop.ms_max:
        return RETUNE, f"averaging level too close to instability: Ms = {ms:.2f}"
    cause = integral_too_strong(loop, model)
    if cause:
        return RETUNE, f"averaging level: {cause}"
    if ms is None and damped is not True:
        return INCONCLUSIVE, f"averaging level: {_NOT_ROBUST}"
    return GOOD, "averaging level: judged by damping and robustness, not by speed"
