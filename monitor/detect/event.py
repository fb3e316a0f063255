"""What detection hands out: a set-point step that has opened, and an event that has closed, with its window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from monitor.by_size import median
from monitor.contract.samples import Array

SETPOINT_STEP, LOAD_STEP, SETPOINT_RAMP = 0, 1, 2
"""Kinds of event; a load step is suspected until a model has explained it; a set point that moved at more than a few
samples ramped, or follows a master."""
SETTLED, INTERRUPTED, TIMED_OUT = "settled", "interrupted", "timeout"
STATES = ("", SETTLED, INTERRUPTED, TIMED_OUT)
"""How an event ended, by the kernel's numbers."""
CAUSES = (
    "",
    "the set point moved again",
    "a gap in the data",
    "a change to manual",
    "the end of the data",
    "a change of settings",
    "the set point, which goes on moving",
)
"""What cut an event short, in words, by the kernel's numbers."""
BY_STEP, BY_GAP, BY_MODE, BY_END, BY_SETTINGS, BY_MOVING = range(1, 7)


MEAN_ABS_SD = 0.8
"""Mean size of white noise in its standard deviations."""
THINNED_PERIODS = 1.5
"""Sample periods from one point of a window to the next, in the median, from which samples have been left out."""


@dataclass(frozen=True, slots=True, eq=False)
class EventWindow:
    """An event's points in the order of time: every sample, or every second, fourth ... of a long event."""

    time: Array
    """(n,) from the onset; negative before it [s]."""
    sp: Array
    """(n,) set point [PV]."""
    pv: Array
    """(n,) [PV]."""
    op: Array
    """(n,) OP, held until the next point [OP]."""
    before: int
    """Points from before the onset (of a load step: from before it was noticed)."""
    rested: bool = True
    """Whether the loop was at rest before it: else what OP did before the window still moves PV in it."""

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, slots=True)
class Opened:
    """A set point has stepped, and rests at its new level."""

    row: int
    """The loop's row of the table."""
    number: int
    """Which of the loop's events it is, from 1."""
    onset: int
    """The first sample of the new set point [ns since 1970]."""
    amplitude: float
    """Size of the step [PV]."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Samples in a row, in automatic, whatever happens in them: to see the controller in."""

    row: int
    """The loop's row of the table."""
    start: int
    """[ns since 1970]"""
    end: int
    """[ns since 1970]"""
    period: float
    """Of the samples [s]."""
    window: EventWindow
    """Every sample; quiet or not, but where an event opens in it, points after its onset are not ``before`` it."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosedEvent:
    """An event from its onset to its end, with all that is known of it without a model."""

    row: int
    """The loop's row of the table."""
    number: int
    """Which of the loop's events it is, from 1."""
    kind: int
    """`SETPOINT_STEP`, `LOAD_STEP` or `SETPOINT_RAMP`."""
    state: str
    """How it ended: one of `STATES`."""
    cause: str
    """What cut it short, in words: one of `CAUSES`."""
    onset: int
    """Where the set point began to move; of a load step: where it was noticed [ns since 1970]."""
    end: int
    """[ns since 1970]"""
    duration: float
    """From onset to end [s]."""
    amplitude: float
    """Of the set point's step or ramp, or the largest excursion of the error's short average after a load step [PV]."""
    offset: float
    """Mean of the error where it came to rest [PV]."""
    quiet: bool
    """Whether the loop was at rest before the onset, so that the integrals begin where they should."""
    period: float
    """Of the samples [s]."""
    good_time: float
    """Time that good samples cover [s]."""
    saturated_time: float
    """Time that OP spent at a limit [s]."""
    since_start: float
    """From the loop's last beginning (of the data, after a gap, of automatic) to the onset [s]."""
    uncertain_share: float
    """Share of the samples whose quality is uncertain."""
    error_sd: float
    """Standard deviation of the error when quiet [PV]."""
    short_sd: float
    """Standard deviation of the error's short average when quiet, as known at the end [PV]."""
    noise: float
    """Standard deviation of PV's white noise [PV]."""
    quantum: float
    """Least change of PV that was seen [PV]."""
    pv0: float
    """PV at rest before the onset [PV]."""
    op0: float
    """OP at rest before the onset [OP]."""
    iae: float
    """Integrated absolute error [PV s]."""
    iae_noise: float
    """The noise's share of it [PV s]."""
    s1: float
    """Integral of OP from its rest [OP s]."""
    s2: float
    """Integral of `s1` [OP s^2]."""
    y1: float
    """Integral of PV from its rest [PV s]."""
    window: EventWindow
    health: np.void
    """The loop's health record (dtype `HEALTH`) at the event's end, so that what is concluded does not depend on how
    the samples were batched."""

    @property
    def thinned(self) -> bool:
        """Whether the window holds every second, fourth ... sample only."""
        return len(self.window) > 2 and median(np.diff(self.window.time)) > THINNED_PERIODS * self.period
