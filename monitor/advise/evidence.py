"""What the evidence leaves open beside a model and its intervals: what a suggestion has to be safe against."""

from __future__ import annotations

from dataclasses import dataclass

from monitor.identify.fit import Fit
from monitor.identify.misfit import ModelError


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """What is known of a loop's events beyond the model that they agree on; as it is here where nothing is."""

    rivals: tuple[Fit, ...] = ()
    """Models of the other kind of process that the events do not exclude."""
    misfit: ModelError | None = None
    """Error of the model that the newest usable event shows."""
    loads_only: bool = False
    """No set point has stepped: a load's shape and a model's error cannot be told apart."""
    soft_step: bool = True
    """Whether a small step may be taken in spite of such an error: once for a model."""


NO_DOUBT = Evidence()
