"""Process models with dead time, their responses, and the half rule that reduces higher orders to them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
FloatOrArray = float | Array

INTEGRATING, SELF_REGULATING = "integrating", "self-regulating"
"""Words for the kinds of process, in every table and option."""
CLOSE = 1.6 - 1e-9  # "below 1.6"; example E2 of Skogestad 2003 has 0.08/0.05, which must not count as below


def _check(name: str, value: FloatOrArray, wrong: Any, accepted: str) -> None:
    """Raise where `wrong` holds for any element; NaN (a missing value) is never wrong."""
    if np.any(wrong):
        bad = np.broadcast_to(np.asarray(value, dtype=float), np.shape(wrong))[np.asarray(wrong)]
        raise ValueError(f"{name} = {bad.flat[0]:g}: must be {accepted}")


def check_model(gain: FloatOrArray, **times: FloatOrArray) -> None:
    """Raise ValueError unless gain is finite and not 0 and each time [s] is finite and not negative."""
    _check("gain", gain, (np.asarray(gain) == 0) | np.isinf(gain), "a finite number other than 0")
    for name, value in times.items():
        _check(name, value, (np.asarray(value) < 0) | np.isinf(value), "a finite time, 0 or more [s]")


@dataclass(frozen=True, slots=True)
class IntegratingModel:
    """``gain e^(-dead_time s) / (s (lag s + 1))``; fields are floats or arrays that broadcast.

    Parameters
    ----------
    gain
        Slope of PV for each unit of OP, signed, not 0 [PV/(OP s)].
    dead_time
        Effective dead time [s].
    lag
        Retained lag, 0 for IPDT [s].

    Raises
    ------
    ValueError
        Where the gain is 0 or infinite, or a time negative or infinite. NaN marks a missing model.

    Examples
    --------
    >>> level = IntegratingModel(gain=0.05, dead_time=4.0, lag=3.0)
    >>> level.process, level.t0
    ('integrating', 7.0)
    >>> level.without_lag()  # as PI rules see it
    IntegratingModel(gain=0.05, dead_time=5.5, lag=0.0)
    """

    gain: FloatOrArray
    dead_time: FloatOrArray
    lag: FloatOrArray = 0.0

    def __post_init__(self) -> None:
        check_model(self.gain, dead_time=self.dead_time, lag=self.lag)

    @property
    def process(self) -> str:
        """The word that tables use for this kind of process."""
        return INTEGRATING

    @property
    def t0(self) -> FloatOrArray:
        """Sum of lag and dead time [s]."""
        return self.lag + self.dead_time

    @property
    def lags(self) -> tuple[FloatOrArray, ...]:
        """The retained lags [s]."""
        return (self.lag,)

    def frequency_response(self, omega: FloatOrArray) -> ComplexArray:
        """Response at `omega` [rad/s], which broadcasts against the fields."""
        s = 1j * np.asarray(omega)
        response: ComplexArray = self.gain * np.exp(-s * self.dead_time) / (s * (self.lag * s + 1))
        return response

    def step_response(self, time: FloatOrArray) -> Array:
        """PV [PV] at `time` [s] after a unit step of OP at time 0."""
        t = np.maximum(np.asarray(time, dtype=float) - self.dead_time, 0.0)
        return np.asarray(self.gain * (t - self.lag * _settled(t, self.lag)))

    def without_lag(self) -> IntegratingModel:
        """IPDT model that PI rules use: half of the lag counts as dead time (Skogestad 2003, half rule)."""
        return IntegratingModel(self.gain, self.dead_time + self.lag / 2)


@dataclass(frozen=True, slots=True)
class SelfRegulatingModel:
    """``gain e^(-dead_time s) / ((lag s + 1)(lag2 s + 1))``; fields are floats or arrays that broadcast.

    Parameters
    ----------
    gain
        Change of PV for each unit of OP, signed, not 0 [PV/OP].
    dead_time
        Effective dead time [s].
    lag, lag2
        Lags; lag2 = 0 for FOPDT [s].

    Raises
    ------
    ValueError
        Where the gain is 0 or infinite, or a time negative or infinite. NaN marks a missing model.

    Examples
    --------
    >>> flow = SelfRegulatingModel(gain=2.0, dead_time=1.0, lag=5.0)
    >>> flow.process, flow.t0
    ('self-regulating', 6.0)
    >>> float(SelfRegulatingModel(2.0, 1.0, 5.0, 2.0).first_order().lag)  # as PI rules see it
    6.0
    """

    gain: FloatOrArray
    dead_time: FloatOrArray
    lag: FloatOrArray
    lag2: FloatOrArray = 0.0

    def __post_init__(self) -> None:
        check_model(self.gain, dead_time=self.dead_time, lag=self.lag, lag2=self.lag2)

    @property
    def process(self) -> str:
        """The word that tables use for this kind of process."""
        return SELF_REGULATING

    @property
    def t0(self) -> FloatOrArray:
        """Sum of lags and dead time [s]."""
        return self.lag + self.lag2 + self.dead_time

    @property
    def lags(self) -> tuple[FloatOrArray, ...]:
        """The retained lags [s]."""
        return (self.lag, self.lag2)

    def frequency_response(self, omega: FloatOrArray) -> ComplexArray:
        """Response at `omega` [rad/s], which broadcasts against the fields."""
        s = 1j * np.asarray(omega)
        lags = (self.lag * s + 1) * (self.lag2 * s + 1)
        response: ComplexArray = self.gain * np.exp(-s * self.dead_time) / lags
        return response

    def step_response(self, time: FloatOrArray) -> Array:
        """PV [PV] at `time` [s] after a unit step of OP at time 0."""
        t = np.maximum(np.asarray(time, dtype=float) - self.dead_time, 0.0)
        big, small = np.maximum(self.lag, self.lag2), np.minimum(self.lag, self.lag2)
        # Equal lags are the limit of unequal ones; a relative gap of 1e-5 is wrong by less than 1e-5.
        small = np.where(small > (1 - 1e-5) * big, (1 - 1e-5) * big, small)
        gap = np.where(big > 0, big - small, 1.0)
        two = (big * _settled(t, big) - small * _settled(t, small)) / gap
        return np.asarray(self.gain * np.where(big > 0, two, t > 0))

    def first_order(self) -> SelfRegulatingModel:
        """FOPDT model that PI rules use: the smaller lag is split by the half rule (Skogestad 2003)."""
        small = np.minimum(self.lag, self.lag2) / 2
        return SelfRegulatingModel(self.gain, self.dead_time + small, np.maximum(self.lag, self.lag2) + small)


Model = IntegratingModel | SelfRegulatingModel


@dataclass(frozen=True, slots=True)
class Plant:
    """A process of any order, ``gain e^(-dead_time s) / (s prod (lag s + 1))``, to judge settings on.

    Parameters
    ----------
    gain
        [PV/(OP s)], or [PV/OP] where it is not integrating.
    dead_time
        [s].
    lags
        Any number of lags, each a float or an array that broadcasts [s].
    integrating
        Whether the process has the factor 1/s.

    Raises
    ------
    ValueError
        As for the models.

    Examples
    --------
    >>> tank = Plant(gain=0.2, dead_time=3.0, lags=(4.0, 1.0))
    >>> tank.process, tank.t0
    ('integrating', 8.0)
    """

    gain: FloatOrArray
    dead_time: FloatOrArray = 0.0
    lags: tuple[FloatOrArray, ...] = ()
    integrating: bool = True

    def __post_init__(self) -> None:
        check_model(
            self.gain, dead_time=self.dead_time, **{f"lag {i}": lag for i, lag in enumerate(self.lags)}
        )

    @property
    def process(self) -> str:
        """The word that tables use for this kind of process."""
        return INTEGRATING if self.integrating else SELF_REGULATING

    @property
    def t0(self) -> FloatOrArray:
        """Sum of lags and dead time [s]."""
        return self.dead_time + sum(self.lags)

    def frequency_response(self, omega: FloatOrArray) -> ComplexArray:
        """Response at `omega` [rad/s], which broadcasts against the fields."""
        s = 1j * np.asarray(omega)
        response = self.gain * np.exp(-s * self.dead_time) / (s if self.integrating else 1.0)
        for lag in self.lags:
            response = response / (lag * s + 1)
        return np.asarray(response)


Process = Model | Plant


def _settled(t: Array, lag: FloatOrArray) -> Array:
    """Return 1 - e^(-t/lag), which is 1 for lag = 0 and t > 0."""
    lag = np.asarray(lag, dtype=float)
    nothing_to_wait_for = np.broadcast_to(
        np.where(t > 0, np.inf, 0.0), np.broadcast_shapes(t.shape, lag.shape)
    )
    ratio = np.divide(t, lag, out=np.array(nothing_to_wait_for), where=lag > 0)
    return np.asarray(-np.expm1(-ratio))


def half_rule(
    lags: Sequence[float],
    dead_time: float = 0.0,
    order: int = 2,
    zeros: Sequence[float] = (),
    *,
    process: str = INTEGRATING,
) -> tuple[float, Any]:
    """Reduce a chain of lags to a model of first or second order (Skogestad 2003, SIMC, half rule).

    The largest lag that is not retained is split: half to the retained lag, half to the dead time; all
    smaller ones go to the dead time. An integrator counts as the slowest lag, so an integrating model of
    order 2 keeps one lag, of order 1 none.

    Parameters
    ----------
    lags
        Time constants of the denominator, the integrator left out, in any order [s].
    dead_time
        True dead time [s].
    order
        Order of the model: 1 for PI rules, 2 for PID rules.
    zeros
        Time constants T of the zeros (T s + 1); negative for a zero in the right half plane [s].
    process
        'integrating' or 'self-regulating'.

    Returns
    -------
    tuple
        (dead_time, lag) [s]; lag is 0 for an integrating model of order 1, and a pair of lags for a
        self-regulating one of order 2.

    Raises
    ------
    ValueError
        For a negative time, another order or process, or a zero whose removal changes the gain (use
        `reduced_model`) or for which no lag is left.
    """
    theta, kept, factor = _reduce(lags, dead_time, order, zeros, process)
    if factor != 1:
        raise ValueError(f"zeros = {tuple(zeros)}: they change the gain by {factor:g}; use reduced_model")
    if process == INTEGRATING:
        return theta, kept[0] if kept else 0.0
    return theta, kept[0] if order == 1 else (kept[0], kept[1])


def reduced_model(
    gain: float,
    lags: Sequence[float],
    dead_time: float = 0.0,
    order: int = 2,
    zeros: Sequence[float] = (),
    *,
    process: str = INTEGRATING,
) -> Model:
    """Model of the given order for a chain of lags and zeros; parameters and errors as in `half_rule`."""
    theta, kept, factor = _reduce(lags, dead_time, order, zeros, process)
    kind = IntegratingModel if process == INTEGRATING else SelfRegulatingModel
    return kind(gain * factor, theta, *kept)


def _reduce(
    lags: Sequence[float], dead_time: float, order: int, zeros: Sequence[float], process: str
) -> tuple[float, list[float], float]:
    """Return effective dead time [s], retained lags [s] and the factor on the gain."""
    if process not in {INTEGRATING, SELF_REGULATING}:
        raise ValueError(f"process = {process!r}: must be 'integrating' or 'self-regulating'")
    if order not in {1, 2}:
        raise ValueError(f"order = {order}: must be 1 or 2")
    if dead_time < 0 or any(lag < 0 for lag in lags):
        raise ValueError(f"lags = {tuple(lags)}, dead_time = {dead_time}: must be 0 or more [s]")
    keep = order - (process == INTEGRATING)
    dead_time += sum(-zero for zero in zeros if zero < 0)
    leads = sorted((zero for zero in zeros if zero > 0), reverse=True)
    # The rules for zeros ask for the final dead time: guess it, then iterate (Skogestad 2003).
    theta, _ = _split(list(lags), dead_time, keep)
    for _attempt in range(50):
        rest, factor = list(lags), 1.0
        for lead in leads:
            factor *= _cancel(rest, lead, theta, process)
        previous, (theta, kept) = theta, _split(rest, dead_time, keep)
        if math.isclose(theta, previous, rel_tol=1e-12):
            break
    return theta, kept, factor


def _split(lags: list[float], dead_time: float, keep: int) -> tuple[float, list[float]]:
    """Apply the half rule: dead time [s] and `keep` retained lags [s]."""
    ordered = sorted(lags, reverse=True) + [0.0] * (keep + 1)
    half = ordered[keep] / 2
    kept = ordered[:keep]
    if kept:
        kept[-1] += half
    return dead_time + half + sum(ordered[keep + 1 :]), kept


def _cancel(lags: list[float], lead: float, theta: float, process: str) -> float:
    """Cancel the zero (lead s + 1) against a neighbouring lag in place; return the factor on the gain.

    Skogestad 2003, rules T1, T1a, T1b, T2, T3. The neighbour is the next larger lag, unless there is none
    or the next smaller one is close (ratio below 1.6 and below that of the larger one).
    """
    larger = min((lag for lag in lags if lag >= lead), default=None)
    smaller = max((lag for lag in lags if 0 < lag < lead), default=None)
    if larger is None and smaller is None:
        raise ValueError(f"zeros: no lag is left to cancel the zero of {lead:g} s ({process} process)")
    if larger is None or (smaller and lead / smaller < min(CLOSE, larger / lead)):
        lags.remove(float(smaller or 0.0))
        if theta <= float(smaller or 0.0):
            return lead / float(smaller or 0.0)  # T1a
        return lead / theta if lead >= theta else 1.0  # T1, T1b
    lags.remove(larger)
    if lead >= 5 * theta:
        return lead / larger  # T2
    reduced = min(larger, 5 * theta)
    lags.append(reduced - lead)
    return reduced / larger  # T3
