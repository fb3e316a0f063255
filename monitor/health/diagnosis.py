"""What is wrong with a loop, beside its tuning, as its blocks show it: each is looked at once, in order of time.

A block is what came in a row in automatic, sample by sample or in averages of sixteen (`detect.buffer`). Of each is
asked: does the valve stick, does the error swing, does PV answer OP, does it follow the set point, has OP but two
values. What is kept of the answers is bounded, however long a loop is watched.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from monitor.by_size import median, range_of

from .cycle_gain import CycleGain, cycle_gain
from .episodes import Episodes, LoopSpan, episodes_of, too_fast
from .response import NoResponse, no_response_of
from .tracking import Tracked, tracking_of, tracking_verdict
from .two_valued import two_valued
from .valve import Valve, ValveEvidence, halved, merged, valve_and_support, valve_evidence

Array = NDArray[np.float64]

MOST_MOVES = 16
"""Moves of the set point that are kept."""
ALL_BLOCKS, EVERY_BLOCKS = 16, 4
"""Blocks of samples of which each is looked at, and from then on every so many: shares of the time need no more."""
VALVE_BLOCKS, VALVE_RATIO = 8, 1.25
"""Blocks in which each the valve is looked for, which costs ten times as much, and from then on one whenever there are
so many times more."""
HALVED_S = 14 * 86400.0
"""Judged time after which what is summed over it is halved: a loop is judged by its recent weeks [s]."""
NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Samples in a row in automatic, or averages of sixteen: to see what is wrong with a loop in."""

    row: int
    """The loop's row of the table."""
    level: int
    """0: of samples; 1: of averages."""
    start: int
    """[ns since 1970]"""
    end: int
    """[ns since 1970]"""
    period: float
    """From one value to the next [s]."""
    sp: Array
    """(n,) [PV]"""
    pv: Array
    """(n,) [PV]"""
    op: Array
    """(n,) [OP]"""
    so_far: bool
    """Whether it goes on: shown because an event closes, and shown again when it is full."""


@dataclass(frozen=True, slots=True)
class Signs:
    """What is wrong, or right, as far as the blocks show; None and empty where they show nothing."""

    oscillating_share: float | None = None
    """Of the judged time; None before any is judged."""
    oscillating: bool = False
    """Whether that is enough to call the loop oscillating."""
    cycle_period: float | None = None
    """Of the episodes [s]."""
    spans: tuple[LoopSpan, ...] = ()
    """The newest and longest episodes that count, in order of time."""
    judged: float = 0.0
    """Time that was judged [s]."""
    rests: bool = False
    """Whether PV does not move at all in most blocks in which SP or OP does."""
    too_fast: bool = False
    """Whether the error swings faster than the sampling resolves."""
    valve: Valve | None = None
    """The valve's dead band or stick-slip, where one is seen."""
    valve_support: float = 0.0
    """What OP says for a valve at all: for a cycle that has a sticking valve's shape [-]."""
    two_valued: float | None = None
    """Share of samples at which OP has one of two values, where it has hardly another in most blocks."""
    silent: NoResponse | None = None
    """A stretch in which PV does not answer OP, of the newest block that shows one."""
    silent_since: int = 0
    """When that began [ns since 1970]."""
    silent_time: float = 0.0
    """How long it lasted [s]."""
    tracks: str | None = None
    """``tracks``, ``rings``, ``crawls``: how PV follows the set point, where it is fast for the sampling."""
    follows_within: float | None = None
    """Delay and three lags of that [s]."""
    period: float | None = None
    """Of the newest samples [s]."""
    gain: CycleGain | None = None
    """What the newest sustained cycle says of an integrating process."""


NO_SIGNS = Signs()


@dataclass(slots=True)
class Diagnosis:
    """What a loop's blocks showed so far."""

    episodes: tuple[Episodes, Episodes] = field(default_factory=lambda: (Episodes(), Episodes()))
    """Of samples, and of averages."""
    judged: float = 0.0
    """Time of the blocks of samples since sums were halved [s]."""
    fast: float = 0.0
    """Of it, in blocks that swing faster than the sampling [s]."""
    rested: float = 0.0
    """Of it, in blocks in which PV does not move, but SP or OP does [s]."""
    evidence: list[ValveEvidence | None] = field(default_factory=lambda: [None, None])
    """Of the valve, by level."""
    valves: list[tuple[ValveEvidence, tuple[Valve | None, float]] | None] = field(
        init=False, default_factory=lambda: [None, None]
    )
    """What that showed when it was last asked, by level."""
    two_valued: float | None = None
    two: float = 0.0
    """Of the judged time, in blocks in which OP has two values [s]."""
    silent: NoResponse | None = None
    silent_since: int = 0
    silent_time: float = 0.0
    moves: tuple[Tracked, ...] = ()
    gain: CycleGain | None = None
    period: float | None = None
    seen: list[int] = field(default_factory=lambda: [0, 0])
    """Blocks so far, by level."""
    next_valve: list[int] = field(default_factory=lambda: [0, 0])
    """From which the valve is looked for, by level."""

    def add(self, block: Block) -> None:
        """Take in the next block; of a loop that has been watched for long, only some are looked at."""
        number = self.seen[block.level]
        self.seen[block.level] = number + 1
        if block.level == 0 and number >= ALL_BLOCKS and number % EVERY_BLOCKS:
            return
        n, error = len(block.pv), block.sp - block.pv
        found = episodes_of(error, block.period, block.sp)
        self.episodes[block.level].add(found, block.start, n, block.period)
        strong = max((e for e in found or () if e.strong), key=lambda e: e.end - e.start, default=None)
        if strong is not None:
            self.gain = cycle_gain(block.pv, block.op, block.period, strong) or self.gain
        self._listen(block)
        if number >= self.next_valve[block.level]:
            self._look_for_valve(block)
            self.next_valve[block.level] = 0 if number < VALVE_BLOCKS else int(VALVE_RATIO * number) + 1
        if block.level == 0:
            self.fast += n * block.period if too_fast(error) else 0.0
            led = range_of(block.sp) > 0.0
            still = range_of(block.pv) == 0.0 and (led or range_of(block.op) > 0.0)
            self.rested += n * block.period if still else 0.0
            self.judged += n * block.period
            self.period = block.period
            two = two_valued(block.op)
            self.two += n * block.period if two is not None else 0.0
            self.two_valued = self.two_valued if two is None else two
            if led:
                moves = tracking_of(block.sp, block.pv, block.period, _noise(block.pv))
                self.moves = (*self.moves, *moves)[-MOST_MOVES:]
            if self.judged > HALVED_S:
                self._halve()

    def _look_for_valve(self, block: Block) -> None:
        """Add what a block says of the valve."""
        seen, before = valve_evidence(block.sp, block.pv, block.op), self.evidence[block.level]
        if seen is not None:
            self.evidence[block.level] = seen if before is None else merged(before, seen)

    def _valve(self, level: int, evidence: ValveEvidence) -> tuple[Valve | None, float]:
        """Return what the evidence of a level shows; it is worked out once."""
        known = self.valves[level]
        if known is None or known[0] is not evidence:
            known = self.valves[level] = evidence, valve_and_support(evidence)
        return known[1]

    def _listen(self, block: Block) -> None:
        """Keep a stretch in which PV does not answer; a later block in which it does takes it back."""
        silent = no_response_of(block.sp, block.pv, block.op, block.period)
        if silent is not None:
            self.silent = silent
            self.silent_since = block.start + round(silent.start * block.period * NS)
            self.silent_time = (silent.end - silent.start) * block.period
        elif block.end - self.silent_since > 2 * self.silent_time * NS:
            self.silent = None

    def _halve(self) -> None:
        """Let what is old count half."""
        self.judged *= 0.5
        self.fast *= 0.5
        self.rested *= 0.5
        self.two *= 0.5
        self.evidence = [None if e is None else halved(e) for e in self.evidence]
        for episodes in self.episodes:
            episodes.decay()

    def signs(self) -> Signs:
        """Return what the blocks show together."""
        own = max(self.episodes, key=lambda e: e.oscillating_share or 0.0)
        said = tracking_verdict(list(self.moves))
        within = max((m.delay + 3.0 * m.lag for m in self.moves if m.verdict == said), default=None)
        seen = [self._valve(level, e) for level, e in enumerate(self.evidence) if e is not None]
        valves = [valve for valve, _ in seen if valve is not None]
        return Signs(
            valve=max(valves, key=lambda v: v.strength, default=None),
            valve_support=max((support for _, support in seen), default=0.0),
            two_valued=self.two_valued if self.two > 0.5 * self.judged else None,
            oscillating_share=own.oscillating_share,
            oscillating=bool(own.oscillating),
            cycle_period=own.period,
            spans=tuple(s for s in own.spans if s.strong),
            judged=self.judged,
            rests=self.rested > 0.5 * self.judged,
            too_fast=self.fast > 0.5 * self.judged,
            silent=self.silent,
            silent_since=self.silent_since,
            silent_time=self.silent_time,
            tracks=said,
            follows_within=within if said else None,
            period=self.period,
            gain=self.gain,
        )


def _noise(pv: Array) -> float:
    """Return the standard deviation of PV's noise: of the median size of its second differences (derived)."""
    second = np.abs(np.diff(pv, 2))
    return median(second) / 0.6745 / np.sqrt(6.0) if len(second) else 0.0
