"""A retune in parts: which part is in force, and where the rest leads."""

from __future__ import annotations

import math

from monitor.advise.evidence import Evidence
from monitor.advise.suggestion import Advice
from monitor.contract.loops import Loop
from monitor.contract.records import Plan
from tuners.settings import Settings

TYPED_LN = 0.1
"""Difference in ln of gain and integral time within which settings are the ones that were suggested."""


def plan_of(loop: Loop, advice: Advice, before: Plan | None, evidence: Evidence) -> Plan:
    """Return where a suggestion leads.

    Parameters
    ----------
    before
        The plan of the part that is in force, if one is.
    evidence
        On which the suggestion rests.
    """
    since = None if before is None else before.since
    softened = None if before is None or since is None else before.softened
    if advice.soft and evidence.misfit is not None:
        softened = evidence.misfit.size
    stages = tuple(_plain(s) for s in advice.stages)
    return Plan(loop=loop.name, form=advice.aim.form, stages=stages, since=since, softened=softened)


def part_of(plan: Plan, today: Settings | None) -> bool:
    """Whether settings are a part of a plan, or its aim."""
    return today is not None and any(_alike(today, stage) for stage in plan.stages)


def at_aim(plan: Plan, today: Settings | None) -> bool:
    """Whether settings are a plan's aim: nothing of it is to come."""
    return today is not None and _alike(today, plan.stages[-1])


def _plain(settings: Settings) -> dict[str, float | None]:
    values = {name: float(getattr(settings, name)) for name in ("kp", "ti", "td", "tf")}
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def _alike(settings: Settings, stage: dict[str, float | None]) -> bool:
    """Whether gain and integral time are a stage's, to `TYPED_LN`."""
    kp, ti = stage["kp"], stage["ti"]
    pairs = ((float(settings.kp), kp), (float(settings.ti), math.inf if ti is None else ti))
    return all(
        a == b or (b is not None and 0 < a * b < math.inf and abs(math.log(a / b)) < TYPED_LN)
        for a, b in pairs
    )
