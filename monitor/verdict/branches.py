"""What the tree's branches look for: each returns in plain words what it finds, and nothing where that is nothing."""

from __future__ import annotations

import math

import numpy as np

from monitor.assess.reference import settings_of
from monitor.assess.tuning import MS_MARGIN_RATIO, integral_too_strong
from monitor.contract.loops import Loop, offset_intended
from monitor.contract.records import GOOD, RETUNE
from monitor.contract.text import duration
from monitor.contract.times import iso
from monitor.health.loop_health import Health
from monitor.health.response import goes_right
from tuners.models import INTEGRATING, IntegratingModel, SelfRegulatingModel

from .parts import Tuning
from .routine import LED_SP_SHARE

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
PROGRAMME_RAMPS, PROGRAMME_SHARE = 4, 0.8
"""Ramps of the set point, and their share of its moves, from which they are a programme."""
AWAY_SD = 4.0
"""Mean size of the error, in standard deviations of PV's noise, from which a controller without integral action leaves
an offset, wherever loads and set points put it."""
SHAPE_SUPPORT = 150.0
"""LR of a block from which OP speaks for a valve whose cycle has the shape of one that sticks; healthy loops: 100."""
LARGE_BAND_SHARE = 0.5
"""Of OP's range, from which a band is the valve's even in data that a historian has compressed."""
ALWAYS_SHARE, MOST_SPANS = 0.9, 3
"""Share of the judged time from which a loop oscillates all the time; and episodes that are named, the newest."""
SAME_GAIN_RATIO = 2.0
"""Factor between the gain of the events and the interval of that of the cycle, from which they are not the same."""
SAME_PERIOD_RATIO = 2.0
"""Factor between a loop's own period and the one seen, up to which its settings may be the cause."""


def no_data(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "no good sample was seen" if health.coverage is None else ""


def idle(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "idle: set point, PV and output do not move" if health.idle else ""


def stuck(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    if health.stuck:
        return "PV is frozen while the output moves"
    if health.signs.rests and health.dead_band is None:
        return "PV did not move once while the set point or OP did: no flow, or a frozen signal"
    return ""


def mapping(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    if health.mapping and not health.units:
        return "the tags look mixed up: PV does not follow OP, or is free of noise while SP is not"
    return health.units or ""


def changed(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    return "PV and SP jumped together: a new unit or range" if health.config_change else ""


def by_exception(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    if health.dead_band is None:
        return ""
    return (
        f"PV is reported by exception (dead band about {health.dead_band:.2g} [PV]): between rows its last value "
        "is held"
    )


def compressed(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    share = 0.0 if health.dead_band is not None else _of(health.compression)
    return (
        f"the historian compressed these data ({share:.0%} of the points are reconstructed): intervals are wider"
        if share > COMPRESSED_SHARE
        else ""
    )


def coarse(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    if health.signs.too_fast:
        return "the error turns at nearly every sample: it swings faster than the sampling resolves"
    if health.signs.tracks == "tracks":  # the closed loop's shape is seen
        return ""
    return "sampled too coarsely to show how the loop moves" if health.undersampled else ""


def uncovered(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    covered = _of(health.coverage)
    return (
        f"only {covered:.0%} of the time is covered by good samples" if covered < LEAST_LOOP_COVERAGE else ""
    )


def manual(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    share = max(_of(health.manual), _of(health.held))
    return f"in manual for {share:.0%} of the time" if share > MANUAL_SHARE else ""


def slave(health: Health, tuning: Tuning, loop: Loop) -> str:
    master = f" of {loop.master}" if loop.master else ""
    if tuning.led or _of(health.sp_moving) > SLAVE_SP_SHARE:
        return (
            f"its set point moves all the time: the slave{master} of a cascade, or a programme; not a fault"
        )
    return ""


def programme(_health: Health, tuning: Tuning, _loop: Loop) -> str:
    ramps, moves = tuning.ramps
    if tuning.led or ramps < PROGRAMME_RAMPS or ramps < PROGRAMME_SHARE * moves:
        return ""
    return f"its set point follows a programme: {ramps} of its {moves} moves are ramps"


def at_limit(health: Health, _tuning: Tuning, loop: Loop) -> str:
    # where no limit is known, an output that rests at its own extreme may have arrived where it belongs
    known = (loop.op_low is not None or loop.op_high is not None) and health.signs.two_valued is None
    share = _of(health.saturation) if known else 0.0
    return (
        f"OP is at its limit for {share:.0%} of the time: the loop has no room to control"
        if share > AT_LIMIT_SHARE
        else ""
    )


def touches_limit(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    share = _of(health.saturation) if health.signs.two_valued is None else 0.0
    return f"OP is at its limit for {share:.0%} of the time" if share > TOUCHES_LIMIT_SHARE else ""


def two_valued(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    if health.signs.two_valued is None:
        return ""
    return "OP has but two values: a relay, or the pulses of a time-proportioned output; not the controller's demand"


def mismatch(_health: Health, tuning: Tuning, loop: Loop) -> str:
    return tuning.contradiction if loop.kp is not None else ""


def not_linear(_health: Health, tuning: Tuning, loop: Loop) -> str:
    return tuning.contradiction if loop.kp is None else ""


def sticks(health: Health, _tuning: Tuning, loop: Loop) -> str:
    valve = health.signs.valve
    if health.signs.two_valued is not None:
        return ""
    compressed = _of(health.compression) > COMPRESSED_SHARE
    if health.dead_band is not None or (
        compressed and (valve is None or valve.range_share < LARGE_BAND_SHARE)
    ):
        valve = None  # PV rests where the archive lets it rest, which is for less than most of OP's range
    if valve is not None and valve.strength > STICKS_INDEX:
        span, unit = (loop.op_span / 100.0, "%") if loop.op_span else (1.0, "[OP]")
        return (
            f"the valve sticks: OP travels {valve.band / span:.2g} {unit} after a reversal before PV answers"
        )
    # a load that is no sine gives a cycle that shape, too: what OP does before PV answers has to speak for the valve
    supported = valve is not None or health.signs.valve_support > SHAPE_SUPPORT
    if not supported or _of(health.stiction) <= STICKS_INDEX or _of(health.sp_moving) > LED_SP_SHARE:
        return ""
    return f"the valve sticks (index {_of(health.stiction):.2f}): {_cycle(health)}"


def oscillates(health: Health, _tuning: Tuning, _loop: Loop) -> str:
    size = max((span.amplitude for span in health.signs.spans), default=0.0)
    swings = health.oscillating or (health.signs.oscillating and size > _of(health.quantum))
    return _cycle(health) if swings and _of(health.sp_moving) <= LED_SP_SHARE else ""


def oscillates_otherwise(health: Health, tuning: Tuning, loop: Loop) -> str:
    """Name an oscillation that today's settings do not explain."""
    cycle = oscillates(health, tuning, loop)
    if not cycle or _rolls_by_itself(health, tuning, loop) or trapped(health, tuning, loop):
        return ""
    if tuning.ms is not None:
        return f"{cycle}, which its settings do not explain (Ms = {tuning.ms:.2f})"
    return f"{cycle}; whether its settings are the cause is not known"


def _rolls_by_itself(health: Health, tuning: Tuning, loop: Loop) -> bool:
    """Whether the settings of today explain an oscillation: a poorly damped loop, and its own period."""
    settings = settings_of(loop)
    period, gain = _period(health), tuning.model.get("gain")
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


def trapped(health: Health, tuning: Tuning, loop: Loop) -> str:
    """Explain a cycle by an integral action too strong for an integrating process, whose gain the cycle itself shows.

    Empty where the process is not integrating, or would swing at another period: ``2 pi sqrt(Ti/(Kc K))`` (derived).
    """
    cycle, settings = health.signs.gain, settings_of(loop)
    if tuning.ms is not None or not oscillates(health, tuning, loop):
        return ""  # the events tell more
    if (
        cycle is None
        or not cycle.integrating
        or settings is None
        or INTEGRATING not in (loop.process, tuning.process)
    ):
        return ""
    too_strong = integral_too_strong(loop, IntegratingModel(cycle.gain, cycle.dead_time))
    if not too_strong:
        return ""
    standard = settings.to("standard")
    own = 2.0 * math.pi * math.sqrt(abs(float(standard.ti) / (float(standard.kp) * cycle.gain)))
    if not 1 / SAME_PERIOD_RATIO <= own / cycle.period <= SAME_PERIOD_RATIO:
        return ""
    gain = f"gain about {cycle.gain:.2g} [PV/(OP s)], by the amplitudes of PV and OP in the cycle"
    return f"{_cycle(health)}: {too_strong} ({gain})"


def gain_in_doubt(health: Health, tuning: Tuning, loop: Loop) -> str:
    """Name a cycle of the loop's own whose amplitudes show another gain of an integrating process than events do."""
    cycle, gain = health.signs.gain, tuning.model.get("gain")
    if cycle is None or gain is None or not cycle.integrating or tuning.process != INTEGRATING:
        return ""
    if not oscillates(health, tuning, loop) or not _rolls_by_itself(health, tuning, loop):
        return ""
    least, most = sorted((abs(cycle.gain_lo), abs(cycle.gain_hi)))
    if gain * cycle.gain > 0.0 and least / SAME_GAIN_RATIO <= abs(gain) <= most * SAME_GAIN_RATIO:
        return ""
    return (
        f"{_cycle(health)}; by its amplitudes the gain is {cycle.gain:.2g} [PV/(OP s)], by the events {gain:.2g}: "
        "settings that cure one make the other worse"
    )


def _period(health: Health) -> float | None:
    """Return the period of a loop's cycle [s]: of long, or of single episodes."""
    return health.oscillation_period if health.oscillating else health.signs.cycle_period


def _cycle(health: Health) -> str:
    period, share = _period(health), health.signs.oscillating_share
    said = "it oscillates" if period is None else f"it oscillates with a period of {duration(period)}"
    if share is None or share > ALWAYS_SHARE or not health.signs.spans:
        return said
    spans = ", ".join(f"{iso(s.start)[:19]} to {iso(s.end)[:19]}" for s in health.signs.spans[-MOST_SPANS:])
    return f"{said}, {share:.0%} of the time ({spans})"


def silent(health: Health, tuning: Tuning, loop: Loop) -> str:
    silent = health.signs.silent
    if silent is None or silent.kind == "held" or offset_intended(loop):
        return ""
    # events have shown how PV answers, or a ramp's error stays as long as the ramp
    if tuning.verdict in (GOOD, RETUNE) or programme(health, tuning, loop) or slave(health, tuning, loop):
        return ""
    if loop.kp is not None and math.isinf(loop.ti):  # OP stands still where PV does
        return ""
    time = duration(health.signs.silent_time)
    way = f"OP went by {silent.op_way:+.3g} [OP] in {time}, and PV stayed {-silent.error:+.3g} [PV] from the set point"
    if goes_right(silent.error, silent.op_way, int(np.sign(loop.kp or 0.0))) is False:
        return f"PV does not answer OP: {way}, which is the wrong way for the sign of kp"
    if silent.kind == "slow_integral":
        return f"PV does not answer OP: {way}; the integral action is far too slow, or something holds OP"
    return f"PV does not answer OP: {way}"


def near_instability(_health: Health, tuning: Tuning, loop: Loop) -> str:
    if tuning.ms is None or tuning.ms <= MS_MARGIN_RATIO * loop.ms_max:
        return ""
    return "today's settings are close to instability"


def without_integral(health: Health, tuning: Tuning, loop: Loop) -> str:
    without = loop.kp is not None and math.isinf(loop.ti)
    if not without or offset_intended(loop):
        return ""
    if not health.settled_offset:
        away, noise = _of(health.mean_abs_e), max(_of(health.noise), _of(health.quantum))
        free = _of(health.saturation) <= TOUCHES_LIMIT_SHARE and tuning.suggested is None
        off = free and noise > 0.0 and away > AWAY_SD * noise
        said = f"PV is {away:.3g} [PV] away from the set point in the mean: the controller has no integral action"
        return said if off else ""
    return f"PV stays {_of(health.offset):+.3g} [PV] away from the set point: the controller has no integral action"


def stays_off(health: Health, tuning: Tuning, loop: Loop) -> str:
    # a slow integral action looks like none, and a retune cures it
    slow = tuning.verdict == RETUNE and loop.kp is not None and math.isfinite(loop.ti)
    if not health.settled_offset or slow or offset_intended(loop) or health.signs.silent is not None:
        return ""
    return f"PV stays {_of(health.offset):+.3g} [PV] away from the set point: no integral action, or OP held"


def noisy(health: Health, _tuning: Tuning, loop: Loop) -> str:
    if loop.op_span is None or health.op_noise is None:
        return ""
    share = 100.0 * health.op_noise / loop.op_span
    return f"noise moves OP by {share:.2g} % of its span" if share > loop.op_noise_max else ""


def _of(value: float | None) -> float:
    return 0.0 if value is None else value
