"""PID settings: the standard, series and parallel forms, and the exact way between them.

Names follow ISA-TR5.9: standard (also called ideal, non-interacting, dependent), series (interacting) and
parallel (independent). With ``D = td s / (tf s + 1)`` the feedback path is

- standard: ``kp (1 + 1/(ti s) + D)``
- series: ``kp (1 + 1/(ti s)) (td s + 1)/(tf s + 1)``
- parallel: ``kp + ki/s + kd s/(tf s + 1)``, held as kp, ti = kp/ki and td = kd/kp.

The set-point path has the weights b and c: ``kp (b + 1/(ti s) + c D)`` in the standard and parallel form,
``kp (b + 1/(ti s)) (1 + c (td - tf) s/(tf s + 1))`` in the series form, whose lead acts on PV alone
where c = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tuners.models import Array, ComplexArray, FloatOrArray, holds_anywhere, is_no_time

FORMS = ("standard", "series", "parallel")
FILTER_RATIO = 10.0  # td/tf where neither source nor loop names a filter: the common industrial default


class NotRepresentableError(ValueError):
    """The settings have no counterpart in the form or block that was asked for."""


@dataclass(frozen=True, slots=True)
class Settings:
    """PID settings; fields are floats or arrays that broadcast.

    Parameters
    ----------
    kp
        Controller gain, signed: negative for a direct-acting loop [OP/PV].
    ti
        Integral time; inf for no integral action [s].
    td
        Derivative time; 0 for no derivative action [s].
    tf
        Derivative filter time, without effect where td = 0 [s].
    form
        'standard', 'series' or 'parallel' (which holds kp, ti and td too; see `ki`, `kd`).
    b, c
        Set-point weights of the proportional and the derivative action: PID (1, 1), PI-D (1, 0),
        I-PD (0, 0) [-].

    Raises
    ------
    ValueError
        For an unknown form, ti = 0 or a negative time, naming the field. NaN marks a missing value.

    Examples
    --------
    >>> settings = Settings(kp=2.0, ti=20.0, td=5.0, form="series")
    >>> settings.to("standard")
    Settings(kp=2.5, ti=25.0, td=4.0, tf=0.0, form='standard', b=1.0, c=1.0)
    >>> settings.to("parallel").ki
    0.1
    """

    kp: FloatOrArray
    ti: FloatOrArray = math.inf
    td: FloatOrArray = 0.0
    tf: FloatOrArray = 0.0
    form: str = "standard"
    b: FloatOrArray = 1.0
    c: FloatOrArray = 1.0

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise ValueError(f"form = {self.form!r}: must be one of {', '.join(FORMS)}")
        if self.ti <= 0.0 if isinstance(self.ti, float) else np.any(np.asarray(self.ti) <= 0):
            raise ValueError("ti: must be above 0 [s], inf for no integral action")
        for name, value in (("td", self.td), ("tf", self.tf)):
            if holds_anywhere(is_no_time(value)):
                raise ValueError(f"{name}: must be 0 or more and finite [s]")
        if math.isinf(self.kp) if isinstance(self.kp, float) else np.any(np.isinf(self.kp)):
            raise ValueError("kp: must be finite [OP/PV]")

    @property
    def ki(self) -> FloatOrArray:
        """Integral gain kp/ti, 0 without integral action [OP/(PV s)]."""
        return self.kp / self.ti

    @property
    def kd(self) -> FloatOrArray:
        """Derivative gain kp td [OP s/PV]."""
        return self.kp * self.td

    @property
    def filter_time(self) -> FloatOrArray:
        """The filter time that acts: tf, but 0 where there is no derivative [s]."""
        if isinstance(self.td, float | int) and isinstance(self.tf, float | int):
            return self.tf if self.td != 0 else 0.0
        return np.where(np.asarray(self.td) != 0, self.tf, 0.0)

    def to(self, form: str) -> Settings:
        """Return the same controller in another form, filter and set-point weights included.

        Parameters
        ----------
        form
            'standard', 'series' or 'parallel'.

        Raises
        ------
        NotRepresentableError
            Where a standard controller has no series counterpart (ti < 4 td, about), or a series one that
            is a lag (td < tf) no standard counterpart. For arrays: where any element has none.
        ValueError
            For an unknown form.
        """
        if form not in FORMS:
            raise ValueError(f"form = {form!r}: must be one of {', '.join(FORMS)}")
        if form == self.form:
            return self
        if "series" not in (form, self.form):
            return replace(self, form=form)
        return _series_to_standard(self, form) if self.form == "series" else _standard_to_series(self)

    def frequency_response(self, omega: FloatOrArray) -> ComplexArray:
        """Feedback path from -PV to OP at `omega` [rad/s], which broadcasts against the fields [OP/PV]."""
        s = 1j * np.asarray(omega)
        tf = self.filter_time
        if self.form == "series":
            lead = np.where(np.asarray(self.td) != 0, (self.td * s + 1) / (tf * s + 1), 1.0)
            return np.asarray(self.kp * (1 + 1 / np.asarray(self.ti) / s) * lead)
        return np.asarray(self.kp * (1 + 1 / np.asarray(self.ti) / s + self.td * s / (tf * s + 1)))

    def setpoint_response(self, omega: FloatOrArray) -> ComplexArray:
        """Path from SP to OP, with the set-point weights, at `omega` [rad/s] [OP/PV]."""
        s = 1j * np.asarray(omega)
        tf = self.filter_time
        if self.form == "series":
            lead = np.where(np.asarray(self.td) != 0, 1 + self.c * (self.td - tf) * s / (tf * s + 1), 1.0)
            return np.asarray(self.kp * (self.b + 1 / np.asarray(self.ti) / s) * lead)
        return np.asarray(
            self.kp * (self.b + 1 / np.asarray(self.ti) / s + self.c * self.td * s / (tf * s + 1))
        )


def with_filter(settings: Settings, ratio: float = FILTER_RATIO) -> Settings:
    """Return the settings with the derivative filter tf = td/ratio [s].

    Examples
    --------
    >>> with_filter(Settings(kp=2.0, ti=20.0, td=5.0)).tf
    0.5
    """
    return replace(settings, tf=settings.td / ratio)


def plain(value: FloatOrArray) -> FloatOrArray:
    """Return a float for a scalar, the array otherwise."""
    return float(value) if np.ndim(value) == 0 else value


def _series_to_standard(series: Settings, form: str) -> Settings:
    """Compare coefficients of both forms (derived); for tf = 0 the factor is the known 1 + td/ti."""
    tf, reset = np.asarray(series.filter_time), 1 / np.asarray(series.ti)
    lead = np.where(np.asarray(series.td) != 0, series.td - tf, 0.0)
    factor = 1 + lead * reset
    td = np.where(np.asarray(series.td) != 0, np.asarray(series.td) / factor - tf, 0.0)
    # A vanishing lead (td = tf) leaves rounding noise behind, not a derivative.
    td = np.where(np.abs(td) <= 1e-15 * np.asarray(series.td), 0.0, td)
    if np.any(td < 0) or np.any(factor <= 0):
        raise NotRepresentableError(
            f"series settings with td or ti below tf are a lag: the {form} form cannot represent them"
        )
    b = (series.b + series.c * lead * reset) / factor
    slope = series.c * lead * (series.b - tf * reset) / factor
    c = np.divide(slope, td, out=np.ones(np.broadcast_shapes(slope.shape, td.shape)), where=td > 0)
    return Settings(
        kp=plain(series.kp * factor),
        ti=plain(series.ti * factor),
        td=plain(td),
        tf=plain(np.where(td > 0, tf, 0.0)),
        form=form,
        b=plain(b),
        c=plain(c),
    )


def _standard_to_series(standard: Settings) -> Settings:
    """Solve the quadratic of the inverse (derived); for tf = 0 the root is the known sqrt(1 - 4 td/ti)."""
    tf, reset = np.asarray(standard.filter_time), 1 / np.asarray(standard.ti)
    total = 1 + tf * reset
    root2 = total**2 - 4 * (tf + standard.td) * reset
    # ti = 4 td exactly is the double root: rounding must not turn it into a refusal.
    if np.any(root2 < -1e-12):
        raise NotRepresentableError(
            f"ti must be at least {_least_ratio(standard):.4g} td for the series form to represent it"
        )
    share = (total + np.sqrt(np.maximum(root2, 0.0))) / 2  # ti of the series form over ti of the standard
    active = np.asarray(standard.td) != 0
    share = np.where(active, share, 1.0)
    td = np.where(active, (tf + standard.td) / share, 0.0)
    b, c = _series_weights(standard, share, td - np.where(active, tf, 0.0), tf, reset)
    return Settings(
        kp=plain(standard.kp * share),
        ti=plain(standard.ti * share),
        td=plain(td),
        tf=plain(tf),
        form="series",
        b=b,
        c=c,
    )


def _least_ratio(standard: Settings) -> float:
    """Smallest ti/td [-] that the series form can hold with the settings' tf/td (4 without a filter)."""
    n = float(
        np.max(np.divide(standard.filter_time, standard.td, where=np.asarray(standard.td) > 0, out=None))
    )
    return 2 + n + 2 * math.sqrt(1 + n)


def _series_weights(
    standard: Settings, share: Array, lead: Array, tf: Array, reset: Array
) -> tuple[FloatOrArray, FloatOrArray]:
    """Set-point weights of the series form that give the same set-point path (derived).

    With m = lead/ti and rho = tf/ti of the series form, ``b = b0 (1 + m) - c m`` and c is the root of
    ``m c^2 - (b0 (1 + m) - rho) c + c0 (1 - rho) = 0`` that vanishes with c0.
    """
    m, rho = lead * reset / share, tf * reset / share
    linear = standard.b * (1 + m) - rho
    constant = standard.c * (1 - rho) * np.where(lead > 0, 1.0, 0.0)
    root2 = linear**2 - 4 * m * constant
    if np.any(root2 < -1e-12) or np.any((constant > 0) & (linear <= 0)):
        raise NotRepresentableError("the series form cannot represent these set-point weights b, c")
    divisor = linear + np.sqrt(np.maximum(root2, 0.0))
    c = np.divide(2 * constant, divisor, out=np.zeros(np.shape(divisor)), where=constant > 0)
    b = standard.b * (1 + m) - c * m
    has_lead = np.asarray(standard.td) != 0
    return plain(np.where(has_lead, b, standard.b)), plain(np.where(has_lead, c, standard.c))
