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

from collections.abc import Callable
from dataclasses import dataclass

from monitor.contract.loops import Loop
from monitor.contract.records import GOOD, INCONCLUSIVE, NOT_ASSESSED, RETUNE
from monitor.contract.text import duration
from monitor.health.loop_health import Health

from . import branches
from .parts import Tuning
from .routine import routine

QUIET_SHARE = 0.05
"""Of the judged time in episodes of oscillation, from which a loop that follows its set point is not called good."""
REPEATED_LETTERS = 24
"""By which two findings that begin alike are one, with other figures."""
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
    verdict = tuning.verdict
    if verdict in (INCONCLUSIVE, NOT_ASSESSED) and health.signs.tracks is not None:
        verdict, reason, action = _tracking(health, verdict, reason, action)
    return Conclusion(verdict, reason, action, flags, withheld=False)


def _tracking(health: Health, verdict: str, reason: str, action: str) -> tuple[str, str, str]:
    """Judge a loop that is too fast for its sampling by the way PV follows the set point; say it before the rest."""
    signs = health.signs
    within, sampled = duration(signs.follows_within or 0.0), duration(signs.period or 0.0)
    if signs.tracks == "tracks" and (signs.oscillating_share or 0.0) > QUIET_SHARE:
        return verdict, reason, action  # it hunts between its moves
    if signs.tracks == "tracks":
        unseen = f"its dead time cannot be seen at samples of {sampled}"
        return (
            GOOD,
            f"PV follows the set point within {within}, without overshoot or ringing; {unseen}",
            "none",
        )
    how = "overshoots and rings" if signs.tracks == "rings" else "creeps up to it"
    return verdict, f"after set-point moves PV {how}; {reason}", action


def _seen(tuning: Tuning) -> str:
    """Say what was seen of a loop without any assessed event; empty where nothing was."""
    moves = f"the set point made {tuning.moves}" if tuning.moves else ""
    return "; ".join(filter(None, [moves, tuning.upsets]))


def _over(tuning: Tuning, said: str) -> str:
    """Put a branch's finding before what the events said."""
    if tuning.verdict == RETUNE:
        return f"{said}; a retune is withheld ({tuning.reason})"
    repeats = tuning.reason[:REPEATED_LETTERS] == said[:REPEATED_LETTERS]
    return f"{said}; {tuning.reason}" if tuning.verdict == INCONCLUSIVE and not repeats else said


_LOOK = "find out what changed, and judge the loop on data from after it"
_RAW = (
    "for finer figures switch exception reporting off for this loop's tags (dead band 0, or report every scan), then "
    "make a set-point step"
)
_WIRING = "check the loop's tags in the loop table against the plant"
_FACEPLATE = "compare form, kp, ti and td of the loop table with the block's faceplate, units included"
_LAW = "find out what else moves OP: a gap, a gain that follows the error, an override, a feed-forward"
_VALVE = "check the valve and its positioner before the tuning: stroke it in manual and see whether the cycle stops"
_LONGER = "lengthen the integral time as said; then a set-point step shows what else can be gained"
_OTHERS = "find the source first: in manual, does the cycle stay? Then it comes from outside"
_DOUBT = "make a set-point step large enough to stand out of the cycle: it shows which gain is right"
_DEMAND = "record the controller's demand (before the pulses), or OP's mean over a cycle of pulses"
_ROOM = "look for the bottleneck (valve size, bypass, pump), or a set point within reach"
_SHUT = (
    "look at the valve in the field: shut, blocked, at its end, by-passed or overridden; if it moves, the integral "
    "time is far too long"
)
_INTEGRAL = "add integral action if the offset is not wanted"

TREE = (
    # are the data trustworthy?
    Branch("", branches.no_data, EXPLAINS, "check the loop's name and tags"),
    Branch("stuck_pv", branches.stuck, WITHHOLDS, "check the transmitter and the path of its signal"),
    Branch("mapping_suspect", branches.mapping, WITHHOLDS, _WIRING),
    Branch("config_change", branches.changed, MARKS, _LOOK),
    Branch(
        "compressed",
        branches.compressed,
        WORDS,
        "export raw data, or switch compression off for this loop's tags",
    ),
    Branch("exception_reported", branches.by_exception, WORDS, _RAW),
    Branch("undersampled", branches.coarse, WITHHOLDS, "sample the loop faster"),
    Branch("", branches.uncovered, EXPLAINS, "find out why samples are missing or bad"),
    # is the loop in control?
    Branch("manual", branches.manual, EXPLAINS, "find out why it is kept in manual"),
    Branch("idle", branches.idle, EXPLAINS, "none while the unit is down"),
    Branch("cascade_slave", branches.slave, WORDS, "none; judge its master"),
    Branch(
        "",
        branches.programme,
        WORDS,
        "none; a set-point step between two ramps shows how fast it could follow",
    ),
    Branch("two_valued_op", branches.two_valued, WITHHOLDS, _DEMAND),
    Branch("saturated", branches.at_limit, WITHHOLDS, _ROOM),
    Branch("saturated", branches.touches_limit, MARKS, _ROOM),
    # is the controller the one of the loop table?
    Branch("settings_mismatch", branches.mismatch, WITHHOLDS, _FACEPLATE),
    Branch("", branches.not_linear, WITHHOLDS, _LAW),
    # is it the valve?
    Branch("stiction", branches.sticks, WITHHOLDS, _VALVE),
    # does it oscillate for another reason?
    Branch("oscillating", branches.trapped, WITHHOLDS, _LONGER),
    Branch("oscillating", branches.gain_in_doubt, WITHHOLDS, _DOUBT),
    Branch("oscillating", branches.oscillates_otherwise, WITHHOLDS, _OTHERS),
    Branch("oscillating", branches.oscillates, MARKS, ""),
    # then the tuning; what else is worth a word
    Branch(
        "near_instability", branches.near_instability, MARKS, "slow the controller down before anything else"
    ),
    Branch("no_response", branches.silent, WITHHOLDS, _SHUT),
    Branch("no_integral", branches.without_integral, WITHHOLDS, _INTEGRAL),
    Branch("offset", branches.stays_off, WITHHOLDS, _INTEGRAL),
    Branch("noisy_op", branches.noisy, MARKS, "filter PV, or take derivative action away"),
)
"""From the root; the first that withholds gives verdict, reason and action."""
