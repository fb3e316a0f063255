"""What is true of a loop of the benchmark `plant_life`, whether it deserves a verdict, and which answers are right.

One table, `ANSWERS`: for each kind what has to be seen for a verdict to be deserved, what is right, what is wrong
beside what is wrong of any loop (`_false_flag`, `_harm`). What is neither is silent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from monitor.contract.records import GOOD, RETUNE, LoopRow
from tests.bench.mismatch_plant import Law
from tests.bench.plant_life_fleet import (
    AGGRESSIVE,
    BACKLASH,
    FROZEN,
    HEALTHY,
    HUNTING,
    INTEGRAL,
    MANUAL,
    NO_RESPONSE,
    P_ONLY,
    PROGRAMME,
    RATE,
    RELAY,
    SATURATED,
    SINE,
    SLAVE,
    SLOW,
    SPLIT,
    SQUARE,
    STICK,
    TRIANGLE,
    VALVES,
    Base,
)  # fmt: skip

RIGHT, SILENT, WRONG = "right", "silent", "wrong"
HARMFUL_MS = 3.0
"""True Ms above which settings do harm."""
BAND_SD = 3.0
"""How far a valve's band moves PV, in standard deviations of noise, from which it has to be named."""
CYCLES, WAVE_SD = 6.0, 2.0
"""Cycles from which an oscillation has to be found; its amplitude in standard deviations of the noise."""
CLEAR = 1.5
"""Least amplitude of it in standard deviations of what the wandering load does to PV."""
CYCLE_SAMPLES = 5.0
"""Recorded samples of a cycle from which it can be seen."""
AT_LIMIT_SHARE, SOME_SHARE = 0.3, 0.03
"""Shares of the time that have to be said, and that may be said."""
BY_HAND_SHARE = 0.5
RATE_SHARE = 0.02
"""Share of the time in automatic at which a slow valve is under way, from which it may be noticed."""
OFFSET_SD = 3.0
COARSE, TUNABLE, WELL = 1.0, 2.0, 4.0
"""Recorded periods in the natural time of a loop from which a verdict may be asked for, from which one on its tuning
may be, and from which nobody can call it sampled too coarsely."""


@dataclass
class Facts:
    """What is true of a loop's record."""

    noise: float
    clean: int = 0
    """Steps of set point or load of five standard deviations that nothing else disturbs, recorded and in automatic."""
    band_sd: float = 0.0
    """Spread of what the valve does to PV (5 to 95 %), in standard deviations of noise."""
    cycles: float = 0.0
    """Recorded cycles of a load that swings."""
    wave_sd: float = 0.0
    """Amplitude of PV of that, in standard deviations of noise."""
    wander_sd: float = 0.0
    """Standard deviation of PV by a load that wanders, in those of noise."""
    cycle_samples: float = math.inf
    samples_in_natural: float = math.inf
    saturation: float = 0.0
    manual: float = 0.0
    """Share of time, whatever the tags say."""
    told_manual: float = 0.0
    """As the tags say."""
    rate: float = 0.0
    """Share of the time at which a slow valve is under way."""
    offset_sd: float = 0.0
    frozen: float = 0.0
    shut: float = 0.0
    crossed: bool = False
    """Whether a split range was seen on both sides."""
    how: str = ""
    ms: float = math.nan
    ci: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Said:
    """A loop's row, read for the judge."""

    row: LoopRow
    base: Base
    facts: Facts
    ms_after: float
    """True Ms under what is suggested; NaN without a suggestion."""
    swings_after: bool = False
    """Whether the simulated loop, slow valve included, swings on under what is suggested."""

    @property
    def flags(self) -> set[str]:
        return set(self.row.flags)

    @property
    def words(self) -> str:
        return f"{self.row.reason} {self.row.action}".lower()

    @property
    def advice(self) -> bool:
        return self.row.new_kp is not None

    @property
    def harmful(self) -> bool:
        return self.advice and (not self.ms_after <= HARMFUL_MS or self.swings_after)

    @property
    def safe(self) -> bool:
        return self.advice and not self.harmful

    @property
    def valve(self) -> bool:
        return (
            "stiction" in self.flags or "valve sticks" in self.words or "dead band of the valve" in self.words
        )

    def says(self, *words: str) -> bool:
        return any(word in self.words for word in words)


def new_law(law: Law, row: LoopRow) -> Law:
    """Return the law that a row suggests, in the loop's own form."""
    assert row.new_kp is not None
    ti, td, tf = math.inf if row.new_ti is None else row.new_ti, row.new_td or 0.0, row.new_tf or 0.0
    return replace(law, kp=row.new_kp, ti=ti, td=td, tf=tf)


Question = Callable[[Facts], bool]
Right = Callable[[Said], bool]
Wrong = Callable[[Said], str]


@dataclass(frozen=True)
class Answer:
    """What is right and wrong of a kind; `flags`: those that are true of it."""

    deserves: Question
    right: Right
    wrong: Wrong
    flags: frozenset[str] = frozenset()
    good: bool = False
    """Whether `good` may be said though the kind's own trouble is not named."""


def _not_good(said: Said) -> str:
    return "called good" if said.row.verdict == GOOD else ""


def _no_retune(said: Said) -> str:
    """Whatever is wrong, it is not the tuning."""
    if said.row.verdict == RETUNE:
        return "tuning blamed, settings given" if said.advice else "tuning blamed"
    return ""


def _neither(said: Said) -> str:
    return _not_good(said) or _no_retune(said)


def _retuned(said: Said) -> bool:
    return said.row.verdict == RETUNE and said.safe


def _nothing(_said: Said) -> str:
    return ""


def _always(_facts: Facts) -> bool:
    return True


def _swings(f: Facts) -> bool:
    return (
        f.cycles >= CYCLES
        and f.wave_sd >= max(WAVE_SD, CLEAR * f.wander_sd)
        and f.cycle_samples >= CYCLE_SAMPLES
    )


def _named_valve(said: Said) -> bool:
    return said.valve and said.row.verdict not in {GOOD, RETUNE} and not said.advice


_UPSET = {"permanent_upset"}
_CYCLE = frozenset({"oscillating", *_UPSET})
_WAVE = Answer(
    _swings, lambda s: "oscillating" in s.flags and s.row.verdict not in {GOOD, RETUNE}, _neither, _CYCLE
)
_VALVE = Answer(lambda f: f.band_sd >= BAND_SD, _named_valve, _neither, _CYCLE | {"stiction"})


def _tunable(f: Facts) -> bool:
    return f.clean > 0 and f.samples_in_natural >= TUNABLE


ANSWERS: dict[str, Answer] = {
    HEALTHY: Answer(_tunable, lambda s: s.row.verdict == GOOD, _no_retune, good=True),
    SLOW: Answer(_tunable, _retuned, _not_good, frozenset({"offset"})),
    AGGRESSIVE: Answer(_tunable, _retuned, _not_good, _CYCLE | {"near_instability"}),
    INTEGRAL: Answer(_tunable, _retuned, _not_good, _CYCLE | {"near_instability", "offset"}),
    STICK: _VALVE,
    BACKLASH: _VALVE,
    RATE: Answer(
        lambda f: f.rate >= RATE_SHARE,
        lambda s: s.valve or s.says("valve", "rate", "moves slowly") or _retuned(s),
        _nothing,
        _CYCLE | {"stiction"},
        good=True,
    ),
    SINE: _WAVE,
    SQUARE: _WAVE,
    TRIANGLE: _WAVE,
    HUNTING: _WAVE,
    SATURATED: Answer(
        lambda f: f.saturation >= AT_LIMIT_SHARE,
        lambda s: bool(s.flags & {"saturated", "no_response"}) and s.row.verdict != GOOD and not s.advice,
        _neither,
        frozenset({"saturated", "offset", "no_response"}),
    ),
    RELAY: Answer(
        _always,
        lambda s: ("two_valued_op" in s.flags or s.says("two values", "relay", "pulse")) and not s.advice,
        _neither,
        _CYCLE | {"two_valued_op", "settings_mismatch"},
    ),
    SPLIT: Answer(
        lambda f: f.crossed and _tunable(f),
        lambda s: s.says("split", "gains differ", "gain differs", "by direction") or _retuned(s),
        _not_good,
        _CYCLE | {"near_instability"},
    ),
    NO_RESPONSE: Answer(
        lambda f: f.shut > AT_LIMIT_SHARE,
        lambda s: (
            bool(s.flags & {"no_response", "saturated"}) and not s.advice and not s.says("add integral")
        ),
        lambda s: _neither(s) or ("asks for integral action" if s.says("add integral") else ""),
        frozenset({"no_response", "saturated", "offset"}),
    ),
    P_ONLY: Answer(
        lambda f: f.offset_sd >= OFFSET_SD,
        lambda s: bool(s.flags & {"offset", "no_integral"}) or s.says("no integral"),
        lambda s: "" if s.flags & {"offset", "no_integral"} else _not_good(s),
        frozenset({"offset", "no_integral"}),
    ),
    MANUAL: Answer(
        lambda f: f.told_manual >= BY_HAND_SHARE,
        lambda s: "manual" in s.flags or s.says("in manual"),
        _no_retune,
        frozenset({"manual", "idle", "offset", "no_response", "saturated"}),
        good=True,
    ),
    SLAVE: Answer(
        _always,
        lambda s: ("cascade_slave" in s.flags or s.row.verdict == GOOD) and not s.advice,
        _no_retune,
        frozenset({"cascade_slave"}),
        good=True,
    ),
    PROGRAMME: Answer(
        _always,
        lambda s: "cascade_slave" in s.flags or s.row.verdict == GOOD or s.says("programme"),
        _no_retune,
        frozenset({"cascade_slave"}),
        good=True,
    ),
    FROZEN: Answer(
        lambda f: f.frozen >= AT_LIMIT_SHARE,
        lambda s: bool(s.flags & {"stuck_pv", "stale", "idle", "no_response"}) and not s.advice,
        _neither,
        frozenset(
            {"stuck_pv", "stale", "idle", "no_response", "saturated", "offset", "mapping_suspect", "manual"}
        ),
    ),
}

ALWAYS_FALSE = (
    "config_change", "settings_mismatch", "mapping_suspect", "stuck_pv", "idle", "two_valued_op", "no_integral",
    "cascade_slave", "no_response", "near_instability", "stiction", "oscillating", "offset",
)  # fmt: skip
"""Flags that are false of every loop of which they are not said to be true."""


ACCUSED = {
    "opposite signs": "accuses the table of a wrong sign",
    "the table calls the process": "accuses the table of a wrong process",
    "in minutes": "accuses the table of minutes",
}
"""Words that are false of every loop, since all tables here are right."""


def false_words(said: Said) -> str:
    """Say what is said of the table though it is not true; empty where nothing is."""
    return next((what for words, what in ACCUSED.items() if words in said.row.reason), "")


def false_flag(said: Said) -> str:
    """Name a flag that is not true of the loop; empty where there is none."""
    facts, true = said.facts, ANSWERS[said.base.kind].flags
    recorded = {
        "saturated": facts.saturation < SOME_SHARE,
        "manual": facts.manual < SOME_SHARE,
        "undersampled": facts.samples_in_natural > WELL,
        "compressed": facts.how not in {"swinging-door", "exception", "on-change"},
        "exception_reported": facts.how not in {"exception", "on-change"},
    }
    for flag in said.row.flags:
        if flag in true or (flag not in ALWAYS_FALSE and not recorded.get(flag, False)):
            continue
        return f"flag {flag}"
    return ""


def judge(said: Said) -> tuple[str, str]:
    """Return whether a row is right, silent or wrong, and why it is wrong."""
    answer = ANSWERS[said.base.kind]
    deserves = answer.deserves(said.facts)
    if said.harmful:
        much = "unstable" if math.isinf(said.ms_after) else "swings" if said.swings_after else "Ms above 3"
        return WRONG, f"settings that do harm: {much}"
    if said.valve and said.base.kind not in VALVES:
        return WRONG, "valve named"
    false = false_flag(said) or false_words(said)
    if false:
        return WRONG, false
    if said.base.kind == HEALTHY or deserves:
        wrong = answer.wrong(said)
        if wrong:
            return WRONG, wrong
    if answer.right(said):
        return RIGHT, ""
    return SILENT, ""


def deserves(base: Base, facts: Facts) -> bool:
    """Whether the record shows enough for a verdict."""
    return ANSWERS[base.kind].deserves(facts) and facts.samples_in_natural >= COARSE
