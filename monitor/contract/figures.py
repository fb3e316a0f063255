"""What each health figure of a loop means, and what to do about it: one sentence each, wherever they are shown."""

from __future__ import annotations

import re
from typing import NamedTuple

from tuners.models import INTEGRATING, SELF_REGULATING

GAIN_UNITS = {INTEGRATING: "PV/(OP s)", SELF_REGULATING: "PV/OP"}
"""By kind of process."""


def in_units(unit: str, pv: str, op: str) -> str:
    """Return a figure's unit with a loop's own in place of PV and OP, as far as these are known.

    Parameters
    ----------
    pv, op
        Units of the loop; empty where they are not known.

    Examples
    --------
    >>> in_units("OP/PV", "m3/h", "%"), in_units("PV", "m3/h", "%"), in_units("PV s", "", "%")
    ('%/(m3/h)', 'm3/h', 'PV s')
    """
    own = {"PV": pv, "OP": op}

    def put(match: re.Match[str]) -> str:
        known = own[match.group()] or match.group()
        return (
            f"({known})" if known != unit and re.search(r"[/ ]", known) and unit != match.group() else known
        )

    return re.sub(r"\b(?:PV|OP)\b(?!')", put, unit)


class Meaning(NamedTuple):
    """Unit of a figure, what it says, and what to do when it is conspicuous."""

    unit: str
    says: str
    do: str


MEANINGS: dict[str, Meaning] = {
    "coverage": Meaning(
        "share of time",
        "How much of the time there were good samples.",
        "Find out why samples are missing or bad.",
    ),
    "manual": Meaning(
        "share of time",
        "How long the loop was not in automatic.",
        "Ask the operators why; often the tuning or the valve is the reason.",
    ),
    "saturation": Meaning(
        "share of time",
        "How long OP stood at a limit, where the loop cannot control.",
        "Look for the bottleneck: valve size, bypass, pump, or a set point out of reach.",
    ),
    "offset": Meaning(
        "PV",
        "Mean of set point less PV while nothing happens.",
        "Where it lasts: add integral action, or accept it knowingly.",
    ),
    "noise": Meaning(
        "PV",
        "Standard deviation of what PV does from sample to sample, at the loop's own sampling.",
        "Where it moves OP too much: filter PV, or take derivative action away.",
    ),
    "quantum": Meaning(
        "PV",
        "Least change of PV: the resolution of transmitter or historian.",
        "Where it is as large as what is to be seen: raise the resolution.",
    ),
    "travel_per_hour": Meaning(
        "OP/h",
        "Way that OP goes in swings that stand out of its noise; it wears the valve.",
        "Much travel at a quiet set point: filter, or a lower gain where the robustness asks for it.",
    ),
    "reversals_per_hour": Meaning(
        "1/h",
        "Changes of direction of OP beyond its noise, at the loop's own sampling.",
        "Packings wear by reversals: find the oscillation or the noise behind them.",
    ),
    "oscillation_period": Meaning(
        "s",
        "Period of a lasting oscillation of the error.",
        "Loops with one period have one cause: look for the loop where it is largest.",
    ),
    "oscillation_regularity": Meaning(
        "0-1",
        "How regular that oscillation is in time and size; from 0.5 on it is called one.",
        "In manual, does it stay? Then it comes from outside; otherwise valve or tuning.",
    ),
    "stiction": Meaning(
        "0-1",
        "How much the oscillation has the shape that a sticking valve gives it.",
        "Check valve and positioner before the tuning.",
    ),
    "oscillating_share": Meaning(
        "share of time",
        "How long the error swung in episodes of five cycles or more.",
        "Hunting by the hour: compare its times with what ran then.",
    ),
    "oscillation_amplitude": Meaning(
        "PV",
        "Size of the longest episode.",
        "Of loops with one period look first where it is largest against the noise.",
    ),
    "oscillation_start": Meaning(
        "s since 1970",
        "When the first episode that is kept began.",
        "What ran then, and not before?",
    ),
    "oscillation_end": Meaning(
        "s since 1970",
        "When the last episode ended.",
        "What has stopped then?",
    ),
    "dead_band": Meaning(
        "% of OP's span, or OP",
        "What OP travels after a reversal before the valve moves.",
        "Above 1 %: packing, positioner, actuator.",
    ),
    "harris": Meaning(
        "0-1",
        "Least variance that any controller could reach over that of the error; 1 is as quiet as it gets.",
        "Low: there is room; high: a retune cannot make it quieter, look at the process.",
    ),
    "compression": Meaning(
        "0-1",
        "Share of points that the historian has made up between the ones that it kept.",
        "Export raw data, or switch compression off for this loop.",
    ),
}
"""By column of the loop's row."""
