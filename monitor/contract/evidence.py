"""What an eye is shown of a loop: an event's window with its model, answers to steps, new samples, panes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Nanos = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """The evidence of an event: its samples and the model's response over them. Columns are (n,)."""

    id: str
    loop: str
    onset: int
    """[ns] since 1970."""
    time: NDArray[np.int64]
    """[ns] since 1970."""
    sp: NDArray[np.float64]
    pv: NDArray[np.float64]
    op: NDArray[np.float64]
    """Held until the next point; where the window was thinned, the mean over what was left out [OP]."""
    model: NDArray[np.float64]
    """PV as the fitted model gives it from OP [PV]; NaN without a fit."""


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """How a loop answers a unit step, by today's settings and by those that are suggested. Predicted, not measured."""

    loop: str
    kind: str
    """``setpoint`` (unit [PV]) or ``load`` (unit [OP])."""
    time: Floats
    """From the step on (n,) [s]."""
    today: Floats
    """PV by the model found, and the least and the largest of all models that the evidence allows (3, n) [PV].

    NaN where the settings are not known; where the loop is unstable on the model, or the band has no bound.
    """
    new: Floats
    """The same with the suggested settings (3, n) [PV]."""


class Trend(NamedTuple):
    """New samples of one loop: columns of equal length ``(N,)``."""

    loop: str
    time: Nanos
    """[ns since 1970, UTC]."""
    sp: Floats
    """[PV]."""
    pv: Floats
    """[PV]."""
    op: Floats
    """[OP]."""


class Scale(NamedTuple):
    """What a loop's charts are labelled and measured by."""

    unit: str = ""
    """Of PV; empty where it is not known."""
    op_unit: str = ""
    """Of OP."""
    noise: float | None = None
    """Standard deviation of PV's noise [PV]."""


class Step(NamedTuple):
    """The step of which predicted responses are drawn: an event's own, or one that might come."""

    at: int
    """[ns since 1970]."""
    size: float
    """[PV] of a set-point step, [OP] of a load step."""
    level: float
    """PV before it [PV]."""


class Response(NamedTuple):
    """A chart of predicted responses."""

    kind: str
    """``setpoint`` or ``load``."""
    start: int
    """[ns since 1970]."""
    end: int
    name: str
    """What is predicted, in words."""


class Pane(NamedTuple):
    """One loop of the layout and the event that its charts are fitted to."""

    loop: str
    start: int
    """First time of the event's window [ns]; equal to ``end`` where there is no window."""
    end: int
    """Last time of the event's window [ns]."""
    name: str = ""
    """Of the event, in words."""
    responses: tuple[Response, ...] = ()
    recent: tuple[int, int] | None = None
    """First and last time of the newest samples [ns]; None: they go on, and the chart with them."""


class Fleet(NamedTuple):
    """All loops that have an index and a peak sensitivity: columns of equal length, the worst first."""

    names: Sequence[str]
    kinds: Sequence[str]
    """What is to be done with each: `monitor.contract.summary.KINDS`."""
    ci: Floats
    ms: Floats


def merge(trends: Sequence[Trend]) -> Trend:
    """Join parts of one loop's trend, given in the order of their arrival, in the order of time."""
    columns = [np.concatenate([part[i] for part in trends]) for i in range(1, 5)]
    order = np.argsort(columns[0], kind="stable")
    time, sp, pv, op = (column[order] for column in columns)
    return Trend(trends[0].loop, time, sp, pv, op)
