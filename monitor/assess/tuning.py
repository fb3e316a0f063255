"""Verdict and reason in plain words: how fast a loop is (CI), and how safe (Ms), by what it is there for."""

from __future__ import annotations

import math

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, LOAD, RETUNE, SETPOINT
from tuners.levels import method_product
from tuners.models import IntegratingModel, Model
from tuners.robustness import peak_sensitivity
from tuners.settings import NotRepresentableError

from .reference import settings_of, with_hold_delay

MS_MARGIN_RATIO = 1.25
"""A loop is flagged for robustness above this many times its ``ms_max``: the reference itself may lie near it."""
LEAST_METHOD_PRODUCT = 2.0
"""Kc K Ti below which an integrator under PI rolls (damping below 0.7); good rules lie at 2.4 to 4."""


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


def judge(
    loop: Loop, model: Model, ci: tuple[float | None, float | None], ms: float | None, over: float
) -> tuple[str, str]:
    """Verdict and reason for a loop or event whose evidence is trusted.

    ``ci`` is (CI_sp, CI_ld); the loop's objective says which of them count.
    """
    if loop.objective == "averaging":
        return _judge_averaging(loop, model, ms)
    reasons = []
    if ms is not None and ms > MS_MARGIN_RATIO * loop.ms_max:
        said = "unstable on the model" if math.isinf(ms) else f"Ms = {ms:.2f}"
        reasons.append(f"too close to instability: {said} ({MS_MARGIN_RATIO * loop.ms_max:.3g} at most)")
    shape = f", overshoot {over:.0%}" if over > 0.1 else ""
    wanted = [
        (value, name)
        for value, name, other in zip(
            ci, ("slow to follow: CI_sp", "slow to recover from a load: CI_ld"), (LOAD, SETPOINT), strict=True
        )
        if loop.objective != other and value is not None
    ]
    for value, name in wanted:
        if value < loop.ci_min:
            reasons.append(f"{name} = {value:.2f} ({loop.ci_min:.2g} at least{shape})")
    if reasons:
        cause = integral_too_strong(loop, model)
        return RETUNE, "; ".join([*reasons, cause] if cause else reasons)
    if not wanted and any(value is not None for value in ci):
        return INCONCLUSIVE, f"no index for what the loop is there for: its objective is {loop.objective}"
    if not wanted:
        return INCONCLUSIVE, "no index: the event ended before the loop had come to rest"
    return (
        GOOD,
        "" if ms is not None else "speed only: its settings are not known, so its robustness is not judged",
    )


def _judge_averaging(loop: Loop, model: Model, ms: float | None) -> tuple[str, str]:
    """Judge a surge vessel by what it is for: gentle, not tight."""
    if ms is not None and ms > MS_MARGIN_RATIO * loop.ms_max:
        return RETUNE, f"averaging level too close to instability: Ms = {ms:.2f}"
    cause = integral_too_strong(loop, model)
    if cause:
        return RETUNE, f"averaging level: {cause}"
    return GOOD, "averaging level: judged by damping and robustness, not by speed"
