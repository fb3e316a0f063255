"""Process models with dead time, and their frequency responses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
FloatOrArray = float | Array

INTEGRATING, SELF_REGULATING = "integrating", "self-regulating"
"""Words for the kinds of process, in every table and option."""


def holds_anywhere(wrong: Any) -> bool:
    """Whether a truth, or any of an array of them, is true."""
    return wrong if isinstance(wrong, bool) else bool(np.any(wrong))


def _check(name: str, value: FloatOrArray, wrong: Any, accepted: str) -> None:
    """Raise where `wrong` holds for any element; NaN (a missing value) is never wrong."""
    if holds_anywhere(wrong):
        bad = np.broadcast_to(np.asarray(value, dtype=float), np.shape(wrong))[np.asarray(wrong)]
        raise ValueError(f"{name} = {bad.flat[0]:g}: must be {accepted}")


def is_no_time(value: FloatOrArray) -> Any:
    """Whether a time [s] is negative or infinite; an array of truths for an array."""
    if isinstance(value, float):  # a dozen times cheaper than by way of an array
        return bool(value < 0.0 or value == math.inf)
    return (np.asarray(value) < 0) | np.isinf(value)


def check_model(gain: FloatOrArray, **times: FloatOrArray) -> None:
    """Raise ValueError unless gain is finite and not 0 and each time [s] is finite and not negative."""
    if isinstance(gain, float):
        none: Any = bool(gain == 0.0 or math.isinf(gain))
    else:
        none = (np.asarray(gain) == 0) | np.isinf(gain)
    _check("gain", gain, none, "a finite number other than 0")
    for name, value in times.items():
        _check(name, value, is_no_time(value), "a finite time, 0 or more [s]")


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

    def first_order(self) -> SelfRegulatingModel:
        """FOPDT model that PI rules use: the smaller lag is split by the half rule (Skogestad 2003)."""
        small = np.minimum(self.lag, self.lag2) / 2
        return SelfRegulatingModel(self.gain, self.dead_time + small, np.maximum(self.lag, self.lag2) + small)


Model = IntegratingModel | SelfRegulatingModel


def as_integrating(model: Model, what: str = "this rule") -> IntegratingModel:
    """Return the model of an integrating process, for ``what`` is for no other.

    Raises
    ------
    ValueError
        It is of a self-regulating one.
    """
    if isinstance(model, IntegratingModel):
        return model
    raise ValueError(f"process = {model.process}: {what} is for integrating processes")


def as_self_regulating(model: Model, what: str = "this rule") -> SelfRegulatingModel:
    """Return the model of a self-regulating process, for ``what`` is for no other.

    Raises
    ------
    ValueError
        It is of an integrating one.
    """
    if isinstance(model, SelfRegulatingModel):
        return model
    raise ValueError(f"process = {model.process}: {what} is for self-regulating processes")


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
