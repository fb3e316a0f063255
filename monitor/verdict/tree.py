"""One verdict and one action per loop: what its health says comes before what its events say of its tuning.

The tree, from the root; the first branch that holds and stops gives the verdict, every branch that holds its flag:

1. Are the data trustworthy? (no data, frozen, wired wrongly, changed, compressed, too coarse)
2. Is the loop in control? (in manual, idle, at its limit)
3. Is the controller the one of the loop table?
4. Is it the valve? (stiction)
5. Does it oscillate for another reason than its tuning?
6. Only then: how is it tuned?
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from monitor.assess.reference import settings_of
from monitor.assess.tuning import MS_MARGIN_RATIO, integral_too_strong
from monitor.contract.loops import Loop, offset_intended
from monitor.contract.records import INCONCLUSIVE, NOT_ASSESSED, RETUNE
from monitor.health.loop_health import Health
from tuners.models import INTEGRATING, IntegratingModel, SelfRegulatingModel

from .parts import Tuning
from .routine import LED_SP_SHARE, routine

MANUAL_SHARE = 0.5
"""Share of time in manual from which the loop is not in control."""
AT_LIMIT_SHARE = 0.3
"""Share of time at an output limit from which it is not in control."""
TOUCHES_LIMIT_SHARE = 0.05
"""Share of time at an output limit that is worth a word."""
LEAST_LOOP_COVERAGE = 0.5
"""Share of time with good samples below which nothing is concluded; single events have their own, stricter rule."""
COMPRESSED_SHARE = 0.5
"""Share of reconstructed points from which figures of shape and noise are the historian's, not the plant's."""
STICKS_INDEX = 0.5
"""Stiction index from which the valve is named."""
SLAVE_SP_SHARE = 0.5
"""Share of samples at which the set point moves, from which the loop is a cascade's slave or follows a programme."""
SAME_PERIOD_RATIO = 2.0
"""Factor between a loop's own period and the one seen, up to which its settings may be the cause."""

WITHHOLDS, EXPLAINS, MARKS, WORDS = "withholds", "explains", "marks", "says"
"""What a branch does: overrules any verdict on the tuning (`inconclusive`); says why a loop was not assessed; only sets
its flag; or is said beside the verdict, and says why a loop was not assessed."""


@dataclass(frozen=True, slots=True)
class Branch:
    """One question of the tree: its flag, what it finds (in plain words, empty where nothing), and what to do."""

    flag: str
    found: Callable[[Health, Tuning, Loop], str]
    effect: str
    action: str


@dataclass(frozen=True, slots=True)
class Conclusion:
    """What is said of a loop."""

    verdict: str
    reason: str
    action: str
    flags: tuple[str, ...]
    withheld: bool
    """Nothing is suggested, whatever the events say."""


def conclude(tuning: Tuning, loop: Loop, health: Health) -> Conclusion:
    """Walk the tree: what health says comes before what the events say of the tuning."""
    held = [(b, said) for b in TREE if (said := b.found(health, tuning, loop))]
    flags = tuple(dict.fromkeys(b.flag for b, _ in held if b.flag))
    first = next(((b, said) for b, said in held if b.effect == WITHHOLDS), None)
    if first is not None:
        branch, said = first
        return Conclusion(INCONCLUSIVE, _over(tuning, said), branch.action, flags, withheld=True)
    beside, finer = next(((said, b.action) for b, said in held if b.effect == WORDS), ("", ""))
    reason, action = "; ".join(filter(None, (tuning.reason, beside))), tuning.action
    if tuning.verdict == INCONCLUSIVE and finer:
        action = finer
    if tuning.verdict == NOT_ASSESSED:
        why = next(((said, b.action) for b, said in held if b.effect in (EXPLAINS, WORDS)), None)
        if why is None:
            said, action = routine(loop, health, _seen(tuning))
            why = "; ".join([said, *(mark for b, mark in held if b.effect == MARKS)]), action
        reason, action = why
    return Conclusion(tuning.verdict, reason, action, flags, withheld=False)


def _seen(tuning: Tuning) -> str:
    """Say what was seen of a loop without any assessed event; empty where nothing was."""
    moves = f"the set point made {tuning.moves}" if tuning.moves else ""
    return "; ".join(filter(None, [moves, tuning.upsets]))


def _over(tuning: Tuning, said: str) -> str:
    """Put a branch's finding before what the events said."""
    if tuning.verdict == RETUNE:
        return f"{said}; a retune is withheld ({tuning.reason})"
    return f"{said}; {tuning.reason}" if tuning.verdict == INCONCLUSIVE else said


# ---------------------------------------------------------------------------------------------------
# what the branches look for


def _no_data(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "no good sample was seen" if health.coverage is None else ""


def _idle(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "idle: set point, PV and output do not move" if health.idle else ""


def _stuck(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "PV is frozen while the output moves" if health.stuck else ""


def _mapping(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return (
        "the tags look mixed up: PV does not follow OP, or is free of noise while SP is not"
        if health.mapping
        else ""
    )


def _changed(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "PV and SP jumped together: a new unit or range" if health.config_change else ""


def _by_exception(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    if health.dead_band is None:
        return ""
    return (
        f"PV is reported by exception (dead band about {health.dead_band:.2g} [PV]): between rows its last value "
        "is held"
    )


def _compressed(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    share = 0.0 if health.dead_band is not None else _of(health.compression)
    return (
        f"the historian compressed these data ({share:.0%} of the points are reconstructed): intervals are wider"
        if share > COMPRESSED_SHARE
        else ""
    )


def _coarse(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "sampled too coarsely to show how the loop moves" if health.undersampled else ""


def _uncovered(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    covered = _of(health.coverage)
    return (
        f"only {covered:.0%} of the time is covered by good samples" if covered < LEAST_LOOP_COVERAGE else ""
    )


def _manual(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    share = max(_of(health.manual), _of(health.held))
    return f"in manual for {share:.0%} of the time" if share > MANUAL_SHARE else ""


def _slave(health: Health, _tuning: Tuning, loop: Loop) -> str:
    master = f" of {loop.master}" if loop.master else ""
    if _of(health.sp_moving) > SLAVE_SP_SHARE:
        return (
            f"its set point moves all the time: the slave{master} of a cascade, or a programme; not a fault"
        )
    return ""


def _at_limit(health: Health, _tuning: Tuning, loop: Loop) -> str:
    # where no limit is known, an output that rests at its own extreme may have arrived where it belongs
    known = loop.op_low is not None or loop.op_high is not None
    share = _of(health.saturation) if known else 0.0
    return (
        f"OP is at its limit for {share:.0%} of the time: the loop has no room to control"
        if share > AT_LIMIT_SHARE
        else ""
    )


def _touches_limit(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    share = _of(health.saturation)
    return f"OP is at its limit for {share:.0%} of the time" if share > TOUCHES_LIMIT_SHARE else ""


def _mismatch(_health: Health, tuning: Tuning, loop: Loop) -> str:
    return tuning.contradiction if loop.kp is not None else ""


def _not_linear(_health: Health, tuning: Tuning, loop: Loop) -> str:
    return tuning.contradiction if loop.kp is None else ""


def _sticks(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    if _of(health.stiction) <= STICKS_INDEX or _of(health.sp_moving) > LED_SP_SHARE:
        return ""
    return f"the valve sticks (index {_of(health.stiction):.2f}): {_cycle(health)}"


def _oscillates(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return _cycle(health) if health.oscillating and _of(health.sp_moving) <= LED_SP_SHARE else ""


def _oscillates_otherwise(health: Health, tuning: Tuning, loop: Loop) -> str:
    """Name an oscillation that today's settings do not explain."""
    cycle = _oscillates(health, tuning, loop)
    if not cycle or _rolls_by_itself(health, tuning, loop):
        return ""
    if tuning.ms is not None:
        return f"{cycle}, which its settings do not explain (Ms = {tuning.ms:.2f})"
    return f"{cycle}; whether its settings are the cause is not known"


def _rolls_by_itself(health: Health, tuning: Tuning, loop: Loop) -> bool:
    """Whether the settings of today explain an oscillation: a poorly damped loop, and its own period."""
    settings = settings_of(loop)
    period, gain = health.oscillation_period, tuning.model.get("gain")
    if tuning.ms is None or gain is None or period is None or settings is None:
        return False
    dead_time, lag = tuning.model.get("dead_time") or 0.0, tuning.model.get("lag") or 0.0
    integrating = tuning.process == INTEGRATING
    model = (IntegratingModel if integrating else SelfRegulatingModel)(gain, dead_time, lag)
    if tuning.ms <= MS_MARGIN_RATIO * loop.ms_max and not integral_too_strong(loop, model):
        return False
    # relative to the period seen; the loop's own is where it amplifies most
    ratio = np.geomspace(1 / 30, 30, 301)
    omega = 2 * np.pi / period * ratio
    distance = np.abs(1 + model.frequency_response(omega) * settings.frequency_response(omega))
    own = float(ratio[int(np.argmin(distance))])
    return 1 / SAME_PERIOD_RATIO <= own <= SAME_PERIOD_RATIO


def _cycle(health: Health) -> str:
    period = (
        "" if health.oscillation_period is None else f" with a period of {health.oscillation_period:.3g} s"
    )
    return f"it oscillates{period}"


def _without_integral(health: Health, _tuning: Tuning, loop: Loop) -> str:
    without = loop.kp is not None and math.isinf(loop.ti)
    if not health.settled_offset or not without or offset_intended(loop):
        return ""
    return f"PV stays {_of(health.offset):+.3g} [PV] away from the set point: the controller has no integral action"


def _stays_off(health: Health, tuning: Tuning, loop: Loop) -> str:
    # a slow integral action looks like none, and a retune cures it
    slow = tuning.verdict == RETUNE and loop.kp is not None and math.isfinite(loop.ti)
    if not health.settled_offset or slow or offset_intended(loop):
        return ""
    return f"PV stays {_of(health.offset):+.3g} [PV] away from the set point: no integral action, or OP held"


def _noisy(health: Health, _tuning: Tuning, loop: Loop) -> str:
    if loop.op_span is None or health.op_noise is None:
        return ""
    share = 100.0 * health.op_noise / loop.op_span
    return f"noise moves OP by {share:.2g} % of its span" if share > loop.op_noise_max else ""


def _of(value: float | None) -> float:
    return 0.0 if value is None else value


_LOOK = "find out what changed, and judge the loop on data from after it"
_RAW = (
    "for finer figures switch exception reporting off for this loop's tags (dead band 0, or report every scan), then "
    "make a set-point step"
)
_WIRING = "check the loop's tags in the loop table against the plant"
_FACEPLATE = "compare form, kp, ti and td of the loop table with the block's faceplate, units included"
_LAW = "find out what else moves OP: a gap, a gain that follows the error, an override, a feed-forward"
_VALVE = "check the valve and its positioner before the tuning: stroke it in manual and see whether the cycle stops"
_OTHERS = "find the source first: in manual, does the cycle stay? Then it comes from outside"
_ROOM = "look for the bottleneck (valve size, bypass, pump), or a set point within reach"
_INTEGRAL = "add integral action if the offset is not wanted"

TREE = (
    # are the data trustworthy?
    Branch("", _no_data, EXPLAINS, "check the loop's name and tags"),
    Branch("stuck_pv", _stuck, WITHHOLDS, "check the transmitter and the path of its signal"),
    Branch("mapping_suspect", _mapping, WITHHOLDS, _WIRING),
    Branch("config_change", _changed, MARKS, _LOOK),
    Branch(
        "compressed",
        _compressed,
        WORDS,
        "export raw data, or switch compression off for this loop's tags",
    ),
    Branch("exception_reported", _by_exception, WORDS, _RAW),
    Branch("undersampled", _coarse, WITHHOLDS, "sample the loop faster"),
    Branch("", _uncovered, EXPLAINS, "find out why samples are missing or bad"),
    # is the loop in control?
    Branch("manual", _manual, EXPLAINS, "find out why it is kept in manual"),
    Branch("idle", _idle, EXPLAINS, "none while the unit is down"),
    Branch("cascade_slave", _slave, EXPLAINS, "none; judge its master"),
    Branch("saturated", _at_limit, WITHHOLDS, _ROOM),
    Branch("saturated", _touches_limit, MARKS, _ROOM),
    # is the controller the one of the loop table?
    Branch("settings_mismatch", _mismatch, WITHHOLDS, _FACEPLATE),
    Branch("", _not_linear, WITHHOLDS, _LAW),
    # is it the valve?
    Branch("stiction", _sticks, WITHHOLDS, _VALVE),
    # does it oscillate for another reason?
    Branch("oscillating", _oscillates_otherwise, WITHHOLDS, _OTHERS),
    Branch("oscillating", _oscillates, MARKS, ""),
    # then the tuning; what else is worth a word
    Branch("no_integral", _without_integral, WITHHOLDS, _INTEGRAL),
    Branch("offset", _stays_off, WITHHOLDS, _INTEGRAL),
    Branch("noisy_op", _noisy, MARKS, "filter PV, or take derivative action away"),
)
"""From the root; the first that withholds gives verdict, reason and action."""
