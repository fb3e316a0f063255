"""What routine operation says of a loop that no step has shown: words for an engineer, and never a verdict."""

from __future__ import annotations

import math

from monitor.assess.evidence import STANDS_OUT_SD
from monitor.contract.loops import Loop
from monitor.contract.text import duration
from monitor.health.loop_health import Health
from monitor.health.regulation import Regulation

LEAST_MOVING_SHARE = 0.05
"""Share of samples at which PV must move for its error to be the loop's."""
LED_SP_SHARE = 0.1
"""Share of samples at which the set point moves, from which the error is also the set point's own."""
LITTLE_ABOVE_NOISE = 1.2
"""Error over PV's noise up to which there is nothing to gain: noise is then 70 % of its variance."""
UPSETS_RATIO = 2.0
"""Standard deviation of the error over its mean size from which it comes of a few upsets: 1.25 for noise, 1.4 for noise
whose size wanders, and 3 where one sample in twelve holds it all."""

NOTHING_SEEN = "no set-point move and no upset was seen"
STEP_SHOWS = "none; a set-point step shows how the loop is tuned"


def routine(loop: Loop, health: Health, seen: str = "") -> tuple[str, str]:
    """Return reason and action for a loop without any step: how it regulates, as far as routine data say.

    ``seen`` says what was seen of moves and upsets; empty where there were none.
    """
    seen = seen or NOTHING_SEEN
    if health.pv_moving is not None and health.pv_moving < LEAST_MOVING_SHARE:
        rests = 1.0 - health.pv_moving
        why = "no flow, a frozen signal, or one that is stored on change"
        return f"{seen}; PV rests at {rests:.0%} of the samples: {why}", "find out why PV rests"
    found = health.regulation
    if found is None or (health.sp_moving or 0.0) > LED_SP_SHARE:
        return seen, STEP_SHOWS
    if health.mean_abs_e is not None and found.error_sd > UPSETS_RATIO * health.mean_abs_e:
        return (
            f"{seen}; the error comes of single upsets (mean size {health.mean_abs_e:.2g} [PV])",
            STEP_SHOWS,
        )
    said, action = _regulates(loop, health, found)
    return f"{seen}; in routine operation {said}", action


def _regulates(loop: Loop, health: Health, found: Regulation) -> tuple[str, str]:
    """Say how a loop regulates, and what would tell more."""
    size = _size(loop, health, found)
    if found.error_sd < (health.quantum or 0.0):
        return f"PV stays within its own resolution ({health.quantum:.2g} [PV]) of the set point", "none"
    if _is_noise(health, found):
        return f"{size}: regulation leaves nothing to gain that this sampling shows", "none"
    if found.cycle is not None:
        cycle = duration(found.cycle)
        return (
            f"{size}, and comes back every {cycle}: a cycle",
            "sample it faster, and find the cycle's source",
        )
    dies = f"takes {duration(found.memory)} to die away"
    if math.isinf(found.memory):
        dies = f"lasts longer than {duration(found.seen)}"
    if math.isinf(found.tight_from):
        return f"{size}, and {dies}: slow, or disturbed", f"{_step(found)} shows which"
    if found.tight_from == 0.0:  # less than its noise, more than its movement: noise that comes and goes
        return f"{size}, and {dies}", STEP_SHOWS
    pays = f"a tighter tuning pays only if the process's dead time is below {duration(found.tight_from)}"
    return (
        f"{size}, and {dies}: {pays}",
        f"none if the dead time is longer; else {_step(found)} shows the tuning",
    )


def _size(loop: Loop, health: Health, found: Regulation) -> str:
    """Say how large the error is, against PV's noise where that is seen, and against PV's span where that is known."""
    span = None if loop.pv_low is None or loop.pv_high is None else loop.pv_high - loop.pv_low
    share = f", {100.0 * found.error_sd / span:.2g} % of PV's span" if span else ""
    if not health.noise:
        return f"the error has a standard deviation of {found.error_sd:.2g} [PV]{share}"
    times = found.error_sd / health.noise
    return f"the error swings {times:.2g} times as wide as PV's noise ({found.error_sd:.2g} [PV]{share})"


def _is_noise(health: Health, found: Regulation) -> bool:
    """Whether nothing but noise is in the error."""
    if health.noise is None:
        return found.tight_from == 0.0
    return found.error_sd <= LITTLE_ABOVE_NOISE * health.noise


def _step(found: Regulation) -> str:
    """Name a step of the set point that stands out of the error."""
    return f"a set-point step of {STANDS_OUT_SD * found.error_sd:.2g} [PV] or more"
