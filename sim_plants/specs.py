"""What a loop is: plant, controller, what is done to it, how it is measured."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from sim_plants.controllers import Controller
from sim_plants.plants import GRID_TOLERANCE, Plant, delay_of

# Fields of a loop that are sizes, rates or times: finite, 0 or more.
_SIZES = (
    "noise", "noise_time", "quantum", "wander", "stiction", "setpoint_rate", "master", "master_time", "master_scan",
)  # fmt: skip
Objective = Literal["setpoint", "load", "both", "averaging"]

# Times are kept in whole microseconds: a float of epoch seconds holds no more, ISO text shows no more.
TICK_NS = 1000


@dataclass(frozen=True)
class Steps:
    """Steps at given times, once or repeated for ever.

    Parameters
    ----------
    times : tuple of float
        When, since the start of the simulation, 0 or more and rising [s].
    sizes : tuple of float
        By how much, each a change against what is in force [the quantity's unit].
    repeat : float
        Period of the repetition, longer than from the first to the last time; 0 for once [s].

    Raises
    ------
    ValueError
        Naming the field, its value and what is expected.
    """

    times: tuple[float, ...] = ()
    sizes: tuple[float, ...] = ()
    repeat: float = 0.0

    def __post_init__(self) -> None:
        times = np.asarray(self.times, dtype=float)
        if not (np.isfinite(times).all() and (times >= 0).all() and (np.diff(times) > 0).all()):
            raise ValueError(f"times: {list(self.times)!r}, expected rising numbers of seconds, 0 or more")
        if len(self.sizes) != len(self.times) or not all(math.isfinite(size) for size in self.sizes):
            raise ValueError(f"sizes: {list(self.sizes)!r}, expected a finite number for each of the times")
        span = self.times[-1] - self.times[0] if self.times else 0.0
        if not (math.isfinite(self.repeat) and (self.repeat == 0 or self.repeat > span)):
            raise ValueError(
                f"repeat: {self.repeat!r}, expected seconds above the span of the times ({span:g})"
            )

    def until(self, end: float) -> list[tuple[float, float]]:
        """Return (time [s], size) of each step before `end` [s]."""
        result = []
        base = 0.0
        while True:
            rows = [(base + t, a) for t, a in zip(self.times, self.sizes, strict=True) if base + t < end]
            result += rows
            base += self.repeat
            if not rows or self.repeat == 0:
                return result


NEVER = Steps()


@dataclass(frozen=True)
class LoopSpec:
    """One loop: plant, controller, what is done to it, and how it is measured. It starts at rest.

    Parameters
    ----------
    name : str
        Tag, e.g. `LIC-101`.
    plant, controller : Plant, Controller
        What the loop is made of.
    pv0, op0 : float
        Operating point at the start: PV = SP = `pv0` [PV], OP = `op0` balances the load [OP].
    period : float
        Sample and scan period, at least a microsecond [s].
    setpoint : Steps
        Steps of SP; each acts at the first sample at or after its time [PV].
    load : Steps
        Steps of a load at the process input, at any instant (they need not meet a sample) [OP].
    auto : bool
        Whether the loop starts in automatic.
    modes : Steps
        Changes of mode: -1 to manual, +1 to automatic.
    output : Steps
        Moves of OP by the operator; without effect in automatic [OP].
    noise : float
        Standard deviation of the noise on PV [PV].
    noise_time : float
        Correlation time of the noise; 0 where it is white [s].
    quantum : float
        Resolution of PV; 0 for none [PV].
    wander : float
        Standard deviation of the change of a randomly walking load [OP per square root of a second].
    wander_time : float
        Time constant with which that load comes back to its mean; `inf` where it never does [s].
    setpoint_rate : float
        Rate at which SP moves to where a step sends it; 0 for at once [PV/s].
    master : float
        Standard deviation of what a cascade's master adds to SP, 0 without a master [PV].
    master_time, master_scan : float, float
        Correlation time of that, and how often the master writes it; 0 for every sample [s].
    stiction : float
        Change of OP that the valve needs to move at all [OP]. One-parameter model of A. Stenman,
        F. Gustafsson, K. Forsman, Int. J. Adaptive Control Signal Process. 17 (2003) 769-790.
    seed : int
        Seed of noise, wander and master.
    objective : {'setpoint', 'load', 'both', 'averaging'}
        What the loop is for.
    pv_low, pv_high : float
        Range of the transmitter; for the loop table, PV is not clipped [PV].
    unit : str
        Unit of PV.
    tuning : str
        How the settings came about, in a word; for the truth.
    closed_loop_time, max_load, max_deviation, allow_pd : float, float, float, bool
        Columns of the loop table [s], [OP], [PV], without effect on the simulation.

    Raises
    ------
    ValueError
        Naming loop, field, value and what is expected.
    """

    name: str
    plant: Plant
    controller: Controller
    pv0: float = 0.0
    op0: float = 0.0
    period: float = 1.0
    setpoint: Steps = NEVER
    load: Steps = NEVER
    auto: bool = True
    modes: Steps = NEVER
    output: Steps = NEVER
    noise: float = 0.0
    quantum: float = 0.0
    noise_time: float = 0.0
    wander: float = 0.0
    wander_time: float = math.inf
    setpoint_rate: float = 0.0
    master: float = 0.0
    master_time: float = 60.0
    master_scan: float = 0.0
    stiction: float = 0.0
    seed: int = 0
    objective: Objective = "both"
    pv_low: float = -math.inf
    pv_high: float = math.inf
    unit: str = ""
    tuning: str = ""
    closed_loop_time: float | None = None
    max_load: float | None = None
    max_deviation: float | None = None
    allow_pd: bool = False

    def __post_init__(self) -> None:
        def need(ok: bool, what: str, expected: str) -> None:
            if not ok:
                raise ValueError(f"loop {self.name!r}: {what}: {getattr(self, what)!r}, expected {expected}")

        need(bool(self.name), "name", "a tag, e.g. LIC-101")
        for what in ("pv0", "op0"):
            need(math.isfinite(getattr(self, what)), what, "a finite number")
        for what in _SIZES:
            value = getattr(self, what)
            need(math.isfinite(value) and value >= 0, what, "a number, 0 or more")
        need(self.wander_time > 0, "wander_time", "seconds above 0, or inf")
        need(math.isfinite(self.period) and self.period >= 1e-6, "period", "seconds, 0.000001 or more")
        need(self.objective in get_args(Objective), "objective", "one of " + ", ".join(get_args(Objective)))
        need(self.pv_low < self.pv_high, "pv_low", f"a number below pv_high ({self.pv_high!r})")
        low, high = self.controller.op_low, self.controller.op_high
        need(low <= self.op0 <= high, "op0", f"a number within op_low and op_high ({low:g} to {high:g})")
        level = int(self.auto)
        for size in self.modes.sizes:
            level += int(size)
            need(level in (0, 1) and size in (-1, 1), "modes", "-1 (to manual) and +1 (to automatic) in turn")
        need(
            level == self.auto or not self.modes.repeat,
            "modes",
            "to end in the mode it starts in, if repeated",
        )
        for what in ("setpoint", "load", "modes", "output"):
            repeat = getattr(self, what).repeat
            whole = delay_of(repeat, self.true_period)[1] <= 1e-6 * self.period
            need(whole, what, f"repeat to be a multiple of the period ({self.period:g} s)")

    @property
    def period_ns(self) -> int:
        """Sample period in whole microseconds [ns]."""
        return round(self.period * 1e9 / TICK_NS) * TICK_NS

    @property
    def true_period(self) -> float:
        """Sample period as it is kept [s]."""
        return self.period_ns * 1e-9

    def sample_at(self, time: float) -> int:
        """Return the number of the first sample at or after `time` since the start [s]."""
        return math.ceil(time / self.true_period - GRID_TOLERANCE)
