"""An upset that is no clean step: a record of its own, with its size and how the loop got over it, in words."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from monitor.contract.loops import Loop
from monitor.contract.records import DISTURBANCE, INCONCLUSIVE, LOAD, Assessment, event_id
from monitor.contract.text import duration
from monitor.detect.event import ClosedEvent
from monitor.identify.outliers import without_outliers
from tuners.models import Model, SelfRegulatingModel
from tuners.responses import closed_loop_response

from .event import RECONSTRUCTED_SHARE
from .evidence import coverage, how_it_ended
from .reference import closed_loop_time, reduced, reference_settings, reference_structure
from .upset import BAND_SHARE, Upset, measured

CRAWLS_RATIO = 3.0
"""Times what the reference loop takes after a load step, from which a loop crawls back. An upset that lasts makes any
loop take longer, so this is no verdict."""
MADE_UP_RATIO = 5.0
"""Times the error when quiet that an upset is measured by where a historian made up most of PV: straight lines between
kept points hide a swing as wide as its deviation."""
NO_STEP = "an upset that is no clean step"


class Reference(NamedTuple):
    """What is known of the loop's process by other events, to measure a recovery by."""

    unit: float
    """T0 or dead time [s]."""
    name: str
    """Of the unit, in words, for several of them."""
    recovery: float | None
    """Of the reference loop after a load step [s]; None where there is none."""


def assess_disturbance(
    loop: Loop, event: ClosedEvent, model: Model | None = None, reconstructed: float = 0.0
) -> Assessment | None:
    """Record a suspected load step that no step explains; None where it does not stand out of what the loop does.

    Its verdict is `inconclusive` whatever it shows: the cause's shape is not known, so neither is what the loop's
    tuning has to do with it.

    Parameters
    ----------
    loop
        The loop's row, with the settings in force.
    model
        The process as other events of the loop show it.
    reconstructed
        Share of PV's values that a historian made up, so far.
    """
    event = without_outliers(event)
    if reconstructed > RECONSTRUCTED_SHARE:
        event = replace(event, error_sd=MADE_UP_RATIO * event.error_sd)
    upset = measured(event)
    if upset is None:
        return None
    said = [
        f"{NO_STEP}: PV went {in_words(upset, _reference(loop, model, event.period))}",
        how_it_ended(event),
    ]
    return Assessment(
        loop=loop.name,
        id=event_id(loop.name, event.onset),
        event=event.number,
        kind=DISTURBANCE,
        start=event.onset + round(upset.onset * 1e9),
        end=event.end,
        state=event.state,
        amplitude=upset.size,
        iae=event.iae,
        coverage=coverage(event),
        verdict=INCONCLUSIVE,
        reason="; ".join(filter(None, said)),
        recovery=upset.recovery,
        overshoot=upset.overshoot,
        damping=upset.damping,
    )


def in_words(upset: Upset, known: Reference | None) -> str:
    """Say how far PV went, how it came back, and whether it rings."""
    rings = f", rings after it (damping {upset.damping:.2g})" if upset.rings else ""
    return f"{upset.size:+.3g} [PV], {_back(upset, known)}{rings}"


def many_in_words(count: int, largest: Assessment) -> str:
    """Say of a loop what its upsets were like, by the largest of them.

    Examples
    --------
    >>> record = Assessment(loop="A", id="", event=1, kind=DISTURBANCE, start=0, end=0, state="settled",
    ...     amplitude=-4.2, verdict=INCONCLUSIVE, reason="", recovery=720.0, overshoot=0.4, damping=0.15)
    >>> many_in_words(3, record)
    '3 upsets were seen, none a clean step: the largest -4.2 [PV], back within 12 min, rings after it (damping 0.15)'
    """
    upset = Upset(largest.amplitude, 0.0, largest.recovery, largest.overshoot, largest.damping)
    if count == 1:
        return f"1 upset was seen, no clean step: {in_words(upset, None)}"
    return f"{count} upsets were seen, none a clean step: the largest {in_words(upset, None)}"


def _back(upset: Upset, known: Reference | None) -> str:
    if upset.recovery is None:
        return "not seen to come back"
    if known is None:
        return f"back within {duration(upset.recovery)}"
    times = f"{_figure(upset.recovery / known.unit)} {known.name}"
    if known.recovery is None:
        return f"back within {duration(upset.recovery)} ({times})"
    beside = f"the reference loop takes {_figure(known.recovery / known.unit)} after a load step"
    if upset.recovery > CRAWLS_RATIO * known.recovery and not upset.rings:
        return f"crawls back within {duration(upset.recovery)}: {times}; {beside}"
    return f"recovered in {times} ({duration(upset.recovery)}; {beside})"


def _figure(value: float) -> str:
    """Write two digits, or all of those before the point."""
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def _reference(loop: Loop, model: Model | None, period: float) -> Reference | None:
    """Return what a recovery is measured by; None without a model."""
    if model is None:
        return None
    dead_time = float(model.dead_time)
    lags = float(model.lag) + float(getattr(model, "lag2", 0.0))
    unit, name = (dead_time, "dead times") if dead_time >= lags else (dead_time + lags, "times T0")
    unit = max(unit, period)
    return Reference(unit, name, _of_reference_loop(loop, model, period))


def _of_reference_loop(loop: Loop, model: Model, period: float) -> float | None:
    """Return how long the reference loop takes to recover from a load step [s]; None where there is none."""
    structure = reference_structure(loop)
    if structure not in {"pi", "pid"}:
        return None
    of = reduced(model, structure)
    if isinstance(of, SelfRegulatingModel):
        structure = "pi"
    try:
        settings = reference_settings(of, structure, closed_loop_time(loop, of, period))
        response = closed_loop_response(of, settings, LOAD)
    except ValueError:
        return None
    away = np.abs(response.pv)
    out = np.flatnonzero(away > BAND_SHARE * np.max(away, initial=0.0))
    return float(response.time[out[-1]]) if len(out) else None
