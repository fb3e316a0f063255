"""Internal-model-control rules: Rice & Cooper's five for integrators, lambda tuning, Rivera's for FOPDT.

Models and results are scalars or arrays of one shape (L,): kp [OP/PV], times [s].
"""

from __future__ import annotations

import math

import numpy as np

from tuners.models import (
    FloatOrArray,
    IntegratingModel,
    Model,
    SelfRegulatingModel,
    as_integrating,
    as_self_regulating,
)
from tuners.settings import Settings, plain, with_filter
from tuners.simc import loop_time


def ipdt(model: Model) -> IntegratingModel:
    """Return the integrator with dead time alone that a rule for IPDT processes uses.

    Raises
    ------
    ValueError
        For a self-regulating model, or one without any dead time after the half rule.
    """
    reduced = as_integrating(model).without_lag()
    if np.any(np.asarray(reduced.dead_time) <= 0):
        raise ValueError("dead_time = 0: this rule needs a dead time or a lag above 0 [s]")
    return reduced


def fopdt(model: Model) -> SelfRegulatingModel:
    """Return the first-order model that a rule for FOPDT processes uses.

    Raises
    ------
    ValueError
        For an integrating model, or one without dead time or lag.
    """
    reduced = as_self_regulating(model).first_order()
    if np.any((np.asarray(reduced.dead_time) <= 0) | (np.asarray(reduced.lag) <= 0)):
        raise ValueError("dead_time, lag: this rule needs both above 0 [s]")
    return reduced


def _rice_cooper(
    model: Model, closed_loop_time: FloatOrArray | None
) -> tuple[FloatOrArray, FloatOrArray, FloatOrArray]:
    """Gain, dead time and closed-loop time, by default `rice_cooper_time`."""
    process = ipdt(model)
    return process.gain, process.dead_time, loop_time(closed_loop_time, rice_cooper_time(process))


def rice_cooper_time(model: Model) -> FloatOrArray:
    """Return sqrt(10) dead times, all lags half dead time (Rice & Cooper 2002, after Chien & Fruehauf 1990) [s]."""
    return math.sqrt(10) * ipdt(model).dead_time


def lambda_time(model: Model) -> FloatOrArray:
    """Return three dead times (integrating) or three lags: the usual robust choices of lambda [s]."""
    return 3 * (ipdt(model).dead_time if isinstance(model, IntegratingModel) else model.first_order().lag)


def first_order_time(model: Model) -> FloatOrArray:
    """Return 0.8 dead times, but at least a tenth of the lag (Rivera, Morari & Skogestad 1986) [s]."""
    process = fopdt(model)
    return plain(np.maximum(0.8 * process.dead_time, 0.1 * process.lag))


def imc_pi(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """IMC PI for IPDT: ``kp = (2 tc + theta)/(K (tc + theta)^2)``, ``ti = 2 tc + theta``.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.
    closed_loop_time
        tc; by default sqrt(10) times the dead time [s].

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For a self-regulating process, or tc that is not above 0.

    References
    ----------
    Rice and Cooper 2002, ISA, table of IMC relations, after Chien and Fruehauf 1990.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = imc_pi(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 2.114, ti = 29.3 s'
    """
    gain, theta, tc = _rice_cooper(model, closed_loop_time)
    return Settings((2 * tc + theta) / (gain * (tc + theta) ** 2), 2 * tc + theta)


def imc_pid(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """IMC PID for IPDT, standard form: ``kp = (2 tc + theta)/(K (tc + theta/2)^2)``.

    The source has no filter here; tf = td/10 is added, without which it cannot be built.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.
    closed_loop_time
        tc; by default sqrt(10) times the dead time [s].

    Returns
    -------
    Settings
        Standard form, ``ti = 2 tc + theta``, ``td = (theta^2/4 + tc theta)/ti``.

    Raises
    ------
    ValueError
        For a self-regulating process, or tc that is not above 0.

    References
    ----------
    Rice and Cooper 2002, ISA, table of IMC relations.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = imc_pid(IntegratingModel(gain=-0.022 / 60, dead_time=66.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = -22.57, ti = 483.4 s, td = 30.75 s'
    """
    gain, theta, tc = _rice_cooper(model, closed_loop_time)
    ti = 2 * tc + theta
    td = (theta**2 / 4 + tc * theta) / ti
    return with_filter(Settings(ti / (gain * (tc + theta / 2) ** 2), ti, td))


def imc_pid_series(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """IMC PID for IPDT, series form: ``kp = (2 tc + theta/2)/(K (tc + theta/2)^2)``.

    The source has no filter here; tf = td/10 is added, without which it cannot be built.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.
    closed_loop_time
        tc; by default sqrt(10) times the dead time [s].

    Returns
    -------
    Settings
        Series form, ``ti = 2 tc + theta/2``, ``td = theta/2``.

    Raises
    ------
    ValueError
        For a self-regulating process, or tc that is not above 0.

    References
    ----------
    Rice and Cooper 2002, ISA, table of IMC relations.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = imc_pid_series(IntegratingModel(gain=-0.022 / 60, dead_time=66.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = -21.03, ti = 450.4 s, td = 33 s'
    """
    gain, theta, tc = _rice_cooper(model, closed_loop_time)
    ti = 2 * tc + theta / 2
    return with_filter(Settings(ti / (gain * (tc + theta / 2) ** 2), ti, theta / 2, form="series"))


def imc_pid_filter(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """IMC PID with filter for IPDT, standard form: ``kp = (2 tc + 1.5 theta)/(K A)``.

    ``A = tc^2 + 2 tc theta + theta^2/2``. The source filters the whole output with tf = alpha td; here, as in
    most blocks, tf filters the D term alone. Where the difference matters use `imc_pid_series_filter`, which
    is the source's controller exactly, and convert that.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.
    closed_loop_time
        tc; by default sqrt(10) times the dead time [s].

    Returns
    -------
    Settings
        Standard form, ``ti = 2 tc + 1.5 theta``, ``td = (tc theta + theta^2/2)/ti``,
        ``tf = theta tc^2/(2 A)``.

    Raises
    ------
    ValueError
        For a self-regulating process, or tc that is not above 0.

    References
    ----------
    Rice and Cooper 2002, ISA, table of IMC relations.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = imc_pid_filter(IntegratingModel(gain=-0.022 / 60, dead_time=66.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = -19.22, ti = 516.4 s, td = 30.89 s'
    >>> f"tf = {settings.tf:.4g} s"
    'tf = 19.61 s'
    """
    gain, theta, tc = _rice_cooper(model, closed_loop_time)
    area = tc**2 + 2 * tc * theta + theta**2 / 2
    ti = 2 * tc + 1.5 * theta
    td = (tc * theta + theta**2 / 2) / ti
    return Settings(ti / (gain * area), ti, td, theta * tc**2 / (2 * area))


def imc_pid_series_filter(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """IMC PID with filter for IPDT, series form: ``kp = (2 tc + theta)/(K A)``.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.
    closed_loop_time
        tc; by default sqrt(10) times the dead time [s].

    Returns
    -------
    Settings
        Series form, ``ti = 2 tc + theta``, ``td = theta/2``, ``tf = td tc^2/A`` with
        ``A = tc^2 + 2 tc theta + theta^2/2``.

    Raises
    ------
    ValueError
        For a self-regulating process, or tc that is not above 0.

    References
    ----------
    Rice and Cooper 2002, ISA, table of IMC relations.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = imc_pid_series_filter(IntegratingModel(gain=-0.022 / 60, dead_time=66.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = -17.99, ti = 483.4 s, td = 33 s'
    >>> f"tf = {settings.tf:.4g} s"
    'tf = 19.61 s'
    """
    gain, theta, tc = _rice_cooper(model, closed_loop_time)
    area = tc**2 + 2 * tc * theta + theta**2 / 2
    ti = 2 * tc + theta
    return Settings(ti / (gain * area), ti, theta / 2, theta / 2 * tc**2 / area, form="series")


def lambda_pi(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """Lambda tuning, PI: the closed loop is to answer with the time constant lambda.

    Integrating: ``kp = (2 lambda + theta)/(K (lambda + theta)^2)``, ``ti = 2 lambda + theta``;
    self-regulating: ``kp = T/(K (lambda + theta))``, ``ti = T``.

    Parameters
    ----------
    model
        Process; a lag (integrating) or second lag (self-regulating) is absorbed by the half rule.
    closed_loop_time
        lambda; by default three dead times (integrating) or three lags (self-regulating), the usual robust
        choices [s].

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For lambda that is not above 0, or a model without dead time (integrating) or lag.

    References
    ----------
    Self-regulating: Dahlin 1968; integrating: Chien and Fruehauf 1990, Chem. Eng. Progress 86, 33-41.
    The default of three lags: Åström and Hägglund 2006, Advanced PID Control.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = lambda_pi(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 2.188, ti = 28 s'
    """
    if isinstance(model, IntegratingModel):
        process = ipdt(model)
        return imc_pi(process, loop_time(closed_loop_time, lambda_time(process)))
    reduced = model.first_order()
    time = loop_time(closed_loop_time, lambda_time(reduced))
    return Settings(reduced.lag / (reduced.gain * (time + reduced.dead_time)), reduced.lag)


def imc_pid_first_order(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """IMC PID for FOPDT: ``kp = (2 T + theta)/(K (2 tc + theta))``.

    The source has no filter; tf = td/10 is added.

    Parameters
    ----------
    model
        Self-regulating process; a second lag is absorbed by the half rule.
    closed_loop_time
        tc; by default 0.8 dead times, but at least a tenth of the lag [s].

    Returns
    -------
    Settings
        Standard form, ``ti = T + theta/2``, ``td = T theta/(2 T + theta)``.

    Raises
    ------
    ValueError
        For an integrating process, or tc that is not above 0.

    References
    ----------
    Rivera, Morari and Skogestad 1986, Ind. Eng. Chem. Process Des. Dev. 25, 252-265.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = imc_pid_first_order(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 2.115, ti = 22 s, td = 1.818 s'
    """
    process = fopdt(model)
    theta, lag = process.dead_time, process.lag
    tc = loop_time(closed_loop_time, first_order_time(process))
    both = 2 * lag + theta
    return with_filter(Settings(both / (process.gain * (2 * tc + theta)), both / 2, lag * theta / both))
