"""What keeps settings back that a model allows: other kinds of process, the model's error, what was not excited, loads.

A suggestion has to be safe on the true process, not on the fitted model's family alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from monitor.assess.doubt import share_of_model
from monitor.assess.reference import model_of, settings_of, with_hold_delay
from monitor.assess.tuning import MS_MARGIN_RATIO
from monitor.contract.loops import Loop
from monitor.contract.samples import Array
from monitor.identify.misfit import ModelError
from tuners.loops import coefficients
from tuners.models import Model
from tuners.settings import Settings

from .evidence import Evidence
from .region import nominal, worst_peaks
from .stages import stacked
from .worst_case import last_crossovers

Flags = NDArray[np.bool_]
"""(T,) of settings."""
RIVAL_MS = 2.6
"""Highest Ms on a model of the other kind: the model found may not be the true one."""
LEAST_DISTANCE = 1.0 / 3.0
"""Least abs(1 + L) that the model's error may leave: Ms 3."""
CROSSOVER_RATIO, GAIN_RATIO = 3.0, 2.0
"""Of the gain crossover and of the gain in today's: what is excited under today's settings reaches little further."""
EXCITED_RATIO = 4.0
"""Of both, where a set-point step excited what lies further up: an error of the model there would have been seen."""
LIKELY_TURNS = 2.0
"""Half turns in the model's dead time, above which an error counts where it looks like one, not where it might be."""
LOST_SHARE = 1.0
"""Of the model, from which an error that is seen leaves nothing of it."""
LOADS_GAIN_RATIO = 2.0
"""Of the gain in today's, after load steps alone."""
WRONG_RATIO = 4.0
"""Factor by which a model may be wrong, for a gain and a crossover that lie so far below those of the aim."""
LOADS_TIME_RATIO = 4.0
"""Of today's integral time in the new one, after load steps alone, which tell little of a dead time."""
LEAST_LEAD_SHARE = 0.5
"""Of the derivative time in today's, after load steps alone: to take lead away is a change of the loop, too."""
ONCE_RATIO, ONCE_TIME_RATIO = 4.0, 4.0
"""Of the gain in today's, and of today's integral time, at once, whatever is known: what lies below the crossover is
excited by the integral action, too."""
SOFT_DISTANCE = 0.1
"""Least abs(1 + L) that the mode which explains most may leave after a soft step."""
SOFT_RATIO = 1.25
"""Of gain and crossover in today's, where the model's error forbids everything."""
LEAST_GAIN_SHARE = 1.0 / 3.0
"""Of the gain in today's, at once, where nothing is urgent: a model may be wrong."""
LITTLE_MORE_RATIO = 1.2
"""Gain on trial: where it lowers Ms the loop swings for want of gain, by too much integral action."""
SAFER_SHARE = 0.9
"""Share of today's Ms below which settings that are no good are at least better."""
OTHER_KIND, MISFIT, NOT_EXCITED, LOADS_ALONE, IN_PARTS, NEAR_THE_EDGE, FAR_SLOWER = (
    "the events do not exclude the other kind of process",
    "the model leaves more unexplained than noise does",
    "what the events have not excited is not known",
    "load steps alone show too little for more gain at once, or for a new derivative",
    "no more than four times the gain, no less than a quarter of the integral time, at a time",
    "the loop is too close to instability for more gain",
    "no less than a third of the gain at a time",
)
"""Why settings are refused, in words."""


@dataclass(frozen=True, eq=False, slots=True)
class Guards:
    """What settings are held against beside Ms on the model's region."""

    model: Model
    """The model found, as the controller meets it; fields (1,)."""
    rivals: tuple[Model, ...]
    today: Settings | None
    evidence: Evidence
    most_ms: float
    """Ms of today's settings above which the loop is too close to instability [-]."""
    aim: Settings | None = None
    """Where the way leads."""

    @classmethod
    def of(cls, loop: Loop, region: Model, evidence: Evidence, period: float) -> Guards:
        """Return those of a loop.

        Parameters
        ----------
        region
            Models that the evidence allows, fields (M, 1); the first is the one found.
        period
            Sample period [s].
        """
        rivals = tuple(with_hold_delay(model_of(fit), period) for fit in evidence.rivals)
        return cls(nominal(region), rivals, settings_of(loop), evidence, MS_MARGIN_RATIO * loop.ms_max)

    def refused(self, many: list[Settings]) -> list[str]:
        """Say for each of the settings why it is refused; empty where it is not."""
        if not many:
            return []
        checks = (
            (OTHER_KIND, self._on_rivals(many)),
            (MISFIT, self._by_misfit(many)),
            (NOT_EXCITED, self._not_excited(many)),
            (LOADS_ALONE, self._after_loads(many)),
            (IN_PARTS, self._at_once(many, ONCE_RATIO) | self._faster_reset(many, ONCE_TIME_RATIO)),
            (NEAR_THE_EDGE, self._near_the_edge(many)),
            (FAR_SLOWER, self._far_slower(many)),
        )
        return [next((why for why, where in checks if where[k]), "") for k in range(len(many))]

    def soft(self, many: list[Settings]) -> list[bool]:
        """Return which of the settings are a small step from today's that nothing but the model's error forbids.

        That error is judged by the mode that explains most of it: a misfit of any shape lights up some narrow mode too.
        """
        misfit = self.evidence.misfit
        if self.today is None or misfit is None or not many or not self.evidence.soft_step:
            return [False] * len(many)
        new_lead = [float(s.td) > float(self.today.td) for s in many]
        wrong = self._on_rivals(many) | self._after_loads(many) | self._at_once(many, SOFT_RATIO)
        wrong |= np.array(new_lead) | self._beyond(many, SOFT_RATIO)
        if len(misfit.omega):
            top = slice(k := int(np.argmax(misfit.chi)), k + 1)
            room = self._room(many, misfit.omega[top], misfit.bound[top])
            wrong |= room[0, : len(many)] < SOFT_DISTANCE
        return [bool(ok) for ok in ~wrong]

    def endangered(self, many: list[Settings]) -> Flags:
        """Where the error of the model may bring the loop too close to instability, wherever it is today."""
        misfit = self.evidence.misfit
        if misfit is None or not len(misfit.omega):
            return np.zeros(len(many), dtype=bool)
        room = self._room(many, misfit.omega, misfit.bound)[:, : len(many)]
        return np.asarray(np.any(room < LEAST_DISTANCE, axis=0))

    @property
    def lead_withheld(self) -> bool:
        """Whether load steps alone do not allow a derivative, as there is none today."""
        return self.today is not None and self.evidence.loads_only and float(self.today.td) == 0

    def _far_slower(self, many: list[Settings]) -> Flags:
        """Where most of the gain is taken from a loop that the model does not call too close to instability."""
        less = ~self._at_once(many, LEAST_GAIN_SHARE)
        if self.today is None or not np.any(less):
            return np.zeros(len(many), dtype=bool)
        (peak,) = worst_peaks(self.model, self.today)
        return np.asarray(less & bool(peak <= self.most_ms))

    def _near_the_edge(self, many: list[Settings]) -> Flags:
        """Where gain is added to a loop that the model calls too close to instability, unless it is gain it wants."""
        more = self._at_once(many, 1.0)
        if self.today is None or not np.any(more):
            return more
        louder = replace(self.today, kp=LITTLE_MORE_RATIO * float(self.today.kp))
        peak, then = worst_peaks(self.model, stacked([self.today, louder]))
        return np.asarray(more & bool(peak > self.most_ms and not then < peak))

    def _on_rivals(self, many: list[Settings]) -> Flags:
        """Where Ms on a model of the other kind is too high, and no lower than that of today's settings."""
        wrong = np.zeros(len(many), dtype=bool)
        for rival in self.rivals:
            peaks = worst_peaks(rival, stacked([*many, *self._today()]))
            allowed = max(RIVAL_MS, 0.0 if self.today is None else SAFER_SHARE * peaks[-1])
            wrong |= ~(peaks[: len(many)] <= allowed) | np.isinf(peaks[: len(many)])
        return wrong

    def _room(self, many: list[Settings], omega: Array, bound: Array) -> Array:
        """Return ``|1 + L| - |C| U`` for each mode (k, T), of the settings and, last, of today's where known."""
        c = stacked([*many, *self._today()]).frequency_response(omega[:, None])
        loop = np.abs(1.0 + c * self.model.frequency_response(omega[:, None]))
        return np.asarray(loop - np.abs(c) * bound[:, None])

    def _by_misfit(self, many: list[Settings]) -> Flags:
        """Where the error of the model may bring the loop too close to instability, and closer than it is today.

        ``max 1/(|1 + L| - |C| U) <= 3`` over the modes seen, U the bound of the error.
        """
        wrong = self.endangered(many)
        misfit = self.evidence.misfit
        if misfit is not None and self._lost(misfit):
            wrong = wrong | self._at_once(many, 1.0) | self._beyond(many, 1.0)
        if self.today is not None and misfit is not None and np.any(wrong):
            least = np.min(self._room(many, misfit.omega, misfit.bound), axis=0)
            safer = (least[:-1] > least[-1]) & ~self._beyond(many, 1.0) & ~self._at_once(many, 1.0)
            return np.asarray(wrong & ~safer)
        return wrong

    def _lost(self, misfit: ModelError) -> bool:
        """Whether the error that is seen is as large as the model, below where that turns by half in its dead time."""
        below = misfit.omega * self.model.dead_time < 0.5 * math.pi
        return bool(np.any((share_of_model(misfit, self.model) > LOST_SHARE) & below))

    def _not_excited(self, many: list[Settings]) -> Flags:
        """Where the crossover goes further up than the events have shown the process."""
        gain, crossover = self._far_below()
        far = self._beyond(many, max(CROSSOVER_RATIO, crossover)) | self._at_once(many, max(GAIN_RATIO, gain))
        raised = far | self._beyond(many, CROSSOVER_RATIO) | self._at_once(many, GAIN_RATIO)
        misfit = self.evidence.misfit
        if self.evidence.loads_only or misfit is None or not len(misfit.unseen.omega) or not np.any(raised):
            return far
        unseen = misfit.unseen
        close = self._room(many, unseen.omega, unseen.bound)[:, : len(many)] < LEAST_DISTANCE
        # far below the aim, and far above the crossover, it takes an error that looks like one; else one that might be
        suspected = np.any(close[unseen.suspect], axis=0)
        likely = unseen.omega * self.model.dead_time < LIKELY_TURNS * math.pi
        hidden = np.any(close[likely], axis=0) | self._beyond(many, EXCITED_RATIO)
        return np.asarray((raised & suspected) | (far & hidden))

    def _beyond(self, many: list[Settings], ratio: float) -> Flags:
        """Where the gain crossover lies so many times above today's."""
        if self.today is None:
            return np.zeros(len(many), dtype=bool)
        *found, today = crossovers(self.model, [*many, self.today])
        if today == 0.0:
            return self._at_once(many, ratio)
        return np.asarray(np.array(found) > ratio * today * (1.0 + 1e-9))

    def _after_loads(self, many: list[Settings]) -> Flags:
        """Where more is asked for than load steps alone can show."""
        if self.today is None or not self.evidence.loads_only:
            return np.zeros(len(many), dtype=bool)
        td = np.array([float(s.td) for s in many])
        reset = self._faster_reset(many, LOADS_TIME_RATIO)
        lead = (td > 0) & self.lead_withheld | (td < LEAST_LEAD_SHARE * float(self.today.td))
        return np.asarray(self._at_once(many, max(LOADS_GAIN_RATIO, self._far_below()[0])) | lead | reset)

    def _faster_reset(self, many: list[Settings], ratio: float) -> Flags:
        """Where the integral time is less than today's over this ratio."""
        if self.today is None:
            return np.zeros(len(many), dtype=bool)
        times = np.array([float(s.ti) for s in many])
        return np.asarray(times * ratio * (1.0 + 1e-9) < float(self.today.ti)) & math.isfinite(
            float(self.today.ti)
        )

    def _far_below(self) -> tuple[float, float]:
        """Return the ratios of gain and crossover, far below the aim, that bear a model which is wrong by a factor."""
        if self.today is None or self.aim is None:
            return 0.0, 0.0
        gain = float(self.aim.kp) / float(self.today.kp)
        aim, today = crossovers(self.model, [self.aim, self.today])
        ratios = gain, aim / today if today > 0.0 else gain
        gain, crossover = (min(ratio / WRONG_RATIO, EXCITED_RATIO) for ratio in ratios)
        return gain, crossover

    def _at_once(self, many: list[Settings], ratio: float) -> Flags:
        """Where the gain is so many times today's."""
        if self.today is None:
            return np.zeros(len(many), dtype=bool)
        gains = np.array([float(s.kp) for s in many]) / float(self.today.kp)
        return np.asarray(gains > ratio * (1.0 + 1e-9))

    def _today(self) -> list[Settings]:
        return [] if self.today is None else [self.today]


def crossovers(model: Model, many: list[Settings]) -> list[float]:
    """Return the last frequency at which abs(L) = 1, for each of the settings; 0 where there is none [rad/s]."""
    found: list[float] = last_crossovers(coefficients(model, stacked(many))[0]).tolist()
    return found
