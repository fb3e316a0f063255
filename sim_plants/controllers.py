"""PID controllers in the forms of ISA-TR5.9, with limits and anti-windup."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Form = Literal["standard", "series", "parallel"]
AntiWindup = Literal["conditional", "tracking", "none"]

# Derivative filter where none is given, as a share of the derivative time: the usual fixed filter of a DCS.
FILTER_SHARE = 0.1


@dataclass(frozen=True)
class Controller:
    """PID controller; `standard` and `parallel` are the same law with other names for its numbers.

    - standard, parallel: `kp [(b sp - pv) + int (sp - pv)/ti + td d/dt (c sp - pv) / (tf s + 1)]`
    - series: the lead `(td s + 1)/(tf s + 1)` goes before the integral too; `b` and `c` weigh the set point
      in the proportional part and in the lead's derivative part.

    Parameters
    ----------
    kp : float
        Gain, signed: negative for a direct-acting loop [OP/PV].
    ti : float
        Integral time; `inf` without integral action [s].
    td : float
        Derivative time [s].
    tf : float or None
        Derivative filter time; None for `td / 10` [s].
    form : {'standard', 'series', 'parallel'}
        Form of the settings.
    b, c : float
        Set-point weights of the proportional and derivative parts. I-PD: 0, 0. PI-D: 1, 0.
    op_low, op_high : float
        Limits of the output, infinite without [OP].
    anti_windup : {'conditional', 'tracking', 'none'}
        At a limit: no integration further into it; back calculation with `tracking_time`; nothing.
    tracking_time : float
        Time constant of the back calculation; 0 for at once [s].

    Raises
    ------
    ValueError
        Naming the field, its value and what is accepted.
    """

    kp: float
    ti: float = math.inf
    td: float = 0.0
    tf: float | None = None
    form: Form = "standard"
    b: float = 1.0
    c: float = 1.0
    op_low: float = -math.inf
    op_high: float = math.inf
    anti_windup: AntiWindup = "conditional"
    tracking_time: float = 0.0

    def __post_init__(self) -> None:
        if self.form not in get_args(Form):
            raise ValueError(f"form: {self.form!r}, expected one of {', '.join(get_args(Form))}")
        if self.anti_windup not in get_args(AntiWindup):
            raise ValueError(
                f"anti_windup: {self.anti_windup!r}, expected one of {', '.join(get_args(AntiWindup))}"
            )
        if not (math.isfinite(self.kp) and self.kp != 0):
            raise ValueError(f"kp: {self.kp!r}, expected a finite number other than 0")
        if not self.ti > 0:
            raise ValueError(f"ti: {self.ti!r}, expected a number of seconds above 0, or inf")
        for field in ("td", "tf", "tracking_time"):
            value = getattr(self, field)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{field}: {value!r}, expected a number of seconds, 0 or more")
        for field in ("b", "c"):
            if not math.isfinite(getattr(self, field)):
                raise ValueError(f"{field}: {getattr(self, field)!r}, expected a finite number")
        if not self.op_low < self.op_high:
            raise ValueError(f"op_low: {self.op_low!r}, expected a number below op_high ({self.op_high!r})")

    @property
    def filter_time(self) -> float:
        """Derivative filter time in force [s]."""
        return FILTER_SHARE * self.td if self.tf is None else self.tf

    @property
    def structure(self) -> str:
        """Which parts are there: `p`, `pi`, `pd` or `pid`."""
        return "p" + "i" * math.isfinite(self.ti) + "d" * (self.td > 0)

    @property
    def lead(self) -> float:
        """Factor of the filtered derivative [s]: the series lead is `1 + (td - tf) s/(tf s + 1)`."""
        if self.td == 0:
            return 0.0
        return self.td - self.filter_time if self.form == "series" else self.td

    def response(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Frequency response from -PV to OP at `omega` [rad/s], shape `(M,)`; [OP/PV], shape `(M,)`."""
        s = 1j * omega
        derivative = self.lead * s / (self.filter_time * s + 1)
        if self.form == "series":
            return np.asarray(self.kp * (1 + 1 / self.ti / s) * (1 + derivative), dtype=np.complex128)
        return np.asarray(self.kp * (1 + 1 / self.ti / s + derivative), dtype=np.complex128)
