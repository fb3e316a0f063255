"""How fast a loop is by all that its events show: measured on the model that they agree on, and foreseen by it."""

from __future__ import annotations

from monitor.advise.prediction import predict, references_of
from monitor.assess.event import Finding
from monitor.assess.index import index_on
from monitor.assess.predicted import NO_INDICES, Indices
from monitor.assess.reference import model_of, settings_of, structure_and_time
from monitor.assess.tuning import current_sensitivity, indices_to_come
from monitor.by_size import median
from monitor.contract.loops import Loop
from monitor.contract.records import LOAD, SETPOINT
from monitor.identify.fit import Fit

SHORT_RATIO = 1.25
"""Times ``ci_min`` below which the model foresees that a retuned loop is still too slow. The dead time that a fit finds
lies 5 to 25 % above that of the half rule where there are many lags, and with it the reference's error."""


def indices(loop: Loop, joint: Fit, findings: list[Finding]) -> tuple[float | None, float | None]:
    """Return CI_sp and CI_ld on the model that the events agree on, each the median of its events.

    An event's own model may be a poor one, and say that the reference is as slow as the loop: under 3 % of noise, or
    where a load has moved PV little, by a factor of two to five.
    """
    found: dict[str, list[float]] = {SETPOINT: [], LOAD: []}
    for finding in findings:
        if finding.record.ci is None or finding.fit is None:
            continue
        kind = finding.record.kind
        size = finding.record.amplitude if finding.fit.size is None else finding.fit.size
        ci: float | None = finding.record.ci
        if finding.stepped:
            ci = index_on(loop, joint, (kind, size, finding.error), finding.period)
        if ci is not None:
            found[kind].append(ci)
    of_setpoint, of_load = (median(v) if v else None for v in found.values())
    return of_setpoint, of_load


def kindest(loop: Loop, predicted: Indices, ci: Indices, rivals: tuple[Fit, ...], period: float) -> Indices:
    """Return the larger of the indices predicted on a model and on those of the other kind of process.

    A process with a long lag is tuned as such, and on an integrating model looks slow: what an event does not exclude
    has to agree before a loop is called slow that nothing has shown to be so.

    Parameters
    ----------
    ci
        CI_sp and CI_ld as measured.
    rivals
        The models of the other kind that are not excluded.
    """
    for model in map(model_of, rivals if predicted != NO_INDICES else ()):
        other = indices_to_come(loop, model, ci, current_sensitivity(loop, model, period), period)
        pairs = zip(predicted, other, strict=True)
        of_setpoint, of_load = (a if a is None or b is None else max(a, b) for a, b in pairs)
        predicted = of_setpoint, of_load
    return predicted


def falls_short(loop: Loop, joint: Fit, period: float) -> str:
    """Say for which kind of step the model foresees that today's settings are too slow; empty where for none.

    Events may have shown the other kind alone.
    """
    today = settings_of(loop)
    if today is None or loop.objective == "averaging":
        return ""
    model = model_of(joint)
    structure, tc = structure_and_time(loop, model, period)
    (now,), _ = predict(model, [today], None)
    for kind, best in references_of(loop, joint, structure, tc).of.items():
        if best.iae < SHORT_RATIO * loop.ci_min * now.iae[kind]:
            name = "CI_sp" if kind == SETPOINT else "CI_ld"
            return f"the model foresees {name} = {best.iae / now.iae[kind]:.2f}"
    return ""
