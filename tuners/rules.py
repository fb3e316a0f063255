"""Tuning rules by name, each with its source: `RULES`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tuners.settings import Settings
from tuners.simc import simc_pd, simc_pi, simc_pid

__all__ = ["RULES", "Rule", "simc_pd", "simc_pi", "simc_pid"]

BOTH = ("integrating", "self-regulating")


@dataclass(frozen=True, slots=True)
class Rule:
    """A tuning rule: ``function(model, **parameters) -> Settings``.

    Parameters
    ----------
    function
        The rule; a model first, then the extra parameters by name.
    source
        Author, year, place.
    structure
        'P', 'PI', 'PD', 'PID', 'I-PD'.
    form
        Form of the settings that the function returns.
    processes
        Kinds of process that it takes.
    parameters
        Names of the extra parameters.
    """

    function: Callable[..., Settings]
    source: str
    structure: str
    form: str
    processes: tuple[str, ...]
    parameters: tuple[str, ...] = ()


SIMC = "Skogestad 2003, J. Process Control 13, 291-309"
VV10 = "Veronesi & Visioli 2010, J. Process Control 20, 261-269"

RULES: dict[str, Rule] = {
    "simc-pi": Rule(simc_pi, f"{SIMC}; {VV10}", "PI", "standard", BOTH, ("closed_loop_time",)),
    "simc-pid": Rule(simc_pid, f"{SIMC}; {VV10}", "PID", "series", BOTH, ("closed_loop_time",)),
    "simc-pd": Rule(simc_pd, VV10, "PD", "series", BOTH, ("closed_loop_time",)),
}
