"""Rules from an open-loop model: Ziegler-Nichols' reaction curve, Cohen-Coon, AMIGO and others; Di Ruscio's.

Models and results are scalars or arrays of one shape (L,): kp [OP/PV], times [s].
"""

from __future__ import annotations

import numpy as np

from tuners.imc import fopdt, ipdt
from tuners.models import FloatOrArray, IntegratingModel, Model
from tuners.settings import Settings, with_filter


def _reaction_curve(model: Model) -> tuple[FloatOrArray, FloatOrArray]:
    """Steepest slope of the step response [PV/(OP s)] and dead time [s]."""
    if isinstance(model, IntegratingModel):
        process = ipdt(model)
        return process.gain, process.dead_time
    reduced = fopdt(model)
    return reduced.gain / reduced.lag, reduced.dead_time


def ziegler_nichols_step_pi(model: Model) -> Settings:
    """Ziegler-Nichols PI from the reaction curve: ``kp = 0.9/(R theta)``, ``ti = theta/0.3``.

    R is the steepest slope: K (integrating) or K/T (self-regulating).

    Parameters
    ----------
    model
        Process with dead time; further lags are absorbed by the half rule.

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For a model without dead time, or a self-regulating one without lag.

    References
    ----------
    Ziegler and Nichols 1942, Trans. ASME 64, 759-768.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = ziegler_nichols_step_pi(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 2.25, ti = 13.33 s'
    """
    slope, theta = _reaction_curve(model)
    return Settings(0.9 / (slope * theta), theta / 0.3)


def ziegler_nichols_step(model: Model) -> Settings:
    """Ziegler-Nichols PID from the reaction curve: ``kp = 1.2/(R theta)``, ti = 2 theta, td = theta/2.

    R is the steepest slope: K (integrating) or K/T (self-regulating); tf = td/10 is added.

    Parameters
    ----------
    model
        Process with dead time; further lags are absorbed by the half rule.

    Returns
    -------
    Settings
        Standard form.

    Raises
    ------
    ValueError
        For a model without dead time, or a self-regulating one without lag.

    References
    ----------
    Ziegler and Nichols 1942, Trans. ASME 64, 759-768.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = ziegler_nichols_step(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 3, ti = 8 s, td = 2 s'
    """
    slope, theta = _reaction_curve(model)
    return with_filter(Settings(1.2 / (slope * theta), 2 * theta, theta / 2))


def cohen_coon_pi(model: Model) -> Settings:
    """Cohen-Coon PI for FOPDT, with r = theta/T.

    ``kp = (0.9 + r/12)/(K r)``, ``ti = theta (30 + 3 r)/(9 + 20 r)``.

    Parameters
    ----------
    model
        Self-regulating process; a second lag is absorbed by the half rule.

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For an integrating process, or one without dead time or lag.

    References
    ----------
    Cohen and Coon 1953, Trans. ASME 75, 827-834.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = cohen_coon_pi(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 2.292, ti = 9.415 s'
    """
    process = fopdt(model)
    r = process.dead_time / process.lag
    return Settings((0.9 + r / 12) / (process.gain * r), process.dead_time * (30 + 3 * r) / (9 + 20 * r))


def cohen_coon(model: Model) -> Settings:
    """Cohen-Coon PID for FOPDT, with r = theta/T; tf = td/10 is added.

    ``kp = (4/3 + r/4)/(K r)``, ``ti = theta (32 + 6 r)/(13 + 8 r)``, ``td = 4 theta/(11 + 2 r)``.

    Parameters
    ----------
    model
        Self-regulating process; a second lag is absorbed by the half rule.

    Returns
    -------
    Settings
        Standard form.

    Raises
    ------
    ValueError
        For an integrating process, or one without dead time or lag.

    References
    ----------
    Cohen and Coon 1953, Trans. ASME 75, 827-834.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = cohen_coon(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 3.458, ti = 9.096 s, td = 1.404 s'
    """
    process = fopdt(model)
    theta, r = process.dead_time, process.dead_time / process.lag
    kp = (4 / 3 + r / 4) / (process.gain * r)
    return with_filter(Settings(kp, theta * (32 + 6 * r) / (13 + 8 * r), 4 * theta / (11 + 2 * r)))


def amigo_pi(model: Model) -> Settings:
    """AMIGO PI, integrating and self-regulating.

    IPDT: ``kp = 0.35/(K theta)``, ``ti = 13.4 theta``; FOPDT:
    ``kp = 0.15/K + (0.35 - theta T/(theta + T)^2) T/(K theta)``,
    ``ti = 0.35 theta + 13 theta T^2/(T^2 + 12 theta T + 7 theta^2)``.

    Parameters
    ----------
    model
        Process with dead time; further lags are absorbed by the half rule.

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For a model without dead time, or a self-regulating one without lag.

    References
    ----------
    Åström and Hägglund 2006, Advanced PID Control, eq. 7.5 and its limit for integrating processes.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = amigo_pi(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 0.6028, ti = 15.53 s'
    """
    if isinstance(model, IntegratingModel):
        process = ipdt(model)
        return Settings(0.35 / (process.gain * process.dead_time), 13.4 * process.dead_time)
    reduced = fopdt(model)
    theta, lag = reduced.dead_time, reduced.lag
    kp = (0.15 + (0.35 - theta * lag / (theta + lag) ** 2) * lag / theta) / reduced.gain
    return Settings(kp, 0.35 * theta + 13 * theta * lag**2 / (lag**2 + 12 * theta * lag + 7 * theta**2))


def amigo(model: Model) -> Settings:
    """AMIGO PID, integrating and self-regulating; tf = td/10 is added.

    IPDT: ``kp = 0.45/(K theta)``, ``ti = 8 theta``, ``td = theta/2``; FOPDT:
    ``kp = (0.2 + 0.45 T/theta)/K``, ``ti = theta (0.4 theta + 0.8 T)/(theta + 0.1 T)``,
    ``td = 0.5 theta T/(0.3 theta + T)``.

    Parameters
    ----------
    model
        Process with dead time; further lags are absorbed by the half rule.

    Returns
    -------
    Settings
        Standard form.

    Raises
    ------
    ValueError
        For a model without dead time, or a self-regulating one without lag.

    References
    ----------
    Åström and Hägglund 2004, J. Process Control 14, 635-650; 2006, Advanced PID Control.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = amigo(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 1.225, ti = 11.73 s, td = 1.887 s'
    """
    if isinstance(model, IntegratingModel):
        process = ipdt(model)
        theta = process.dead_time
        return with_filter(Settings(0.45 / (process.gain * theta), 8 * theta, theta / 2))
    reduced = fopdt(model)
    theta, lag = reduced.dead_time, reduced.lag
    ti = theta * (0.4 * theta + 0.8 * lag) / (theta + 0.1 * lag)
    td = 0.5 * theta * lag / (0.3 * theta + lag)
    return with_filter(Settings((0.2 + 0.45 * lag / theta) / reduced.gain, ti, td))


def fruehauf(model: Model) -> Settings:
    """Fruehauf's PI for IPDT: ``kp = 0.5/(K theta)``, ``ti = 5 theta``.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For a self-regulating process, or one without dead time.

    References
    ----------
    Fruehauf, Chien and Lauritsen 1993, ISA Advances in Instrumentation and Control.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = fruehauf(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 2.5, ti = 20 s'
    """
    process = ipdt(model)
    return Settings(0.5 / (process.gain * process.dead_time), 5 * process.dead_time)


def shinskey(model: Model) -> Settings:
    """Shinskey's PI for IPDT with the least IAE after a load step: ``kp = 0.9259/(K theta)``, ti = 4 theta.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For a self-regulating process, or one without dead time.

    References
    ----------
    Shinskey 1994, Feedback Controllers for the Process Industries.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = shinskey(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 4.629, ti = 16 s'
    """
    process = ipdt(model)
    return Settings(0.9259 / (process.gain * process.dead_time), 4 * process.dead_time)


def cluett_wang(model: Model) -> Settings:
    """Cluett & Wang's PID for IPDT with a closed-loop time of two dead times; tf = td/10 is added.

    ``kp = 0.6232/(K theta)``, ``ti = 5.2586 theta``, ``td = 0.2632 theta``.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.

    Returns
    -------
    Settings
        Standard form.

    Raises
    ------
    ValueError
        For a self-regulating process, or one without dead time.

    References
    ----------
    Wang and Cluett 1997, IEE Proc. Control Theory Appl. 144, 385-392; agrees with the comparison table of
    Rice and Cooper 2002.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = cluett_wang(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 3.116, ti = 21.03 s, td = 1.053 s'
    """
    process = ipdt(model)
    theta = process.dead_time
    return with_filter(Settings(0.6232 / (process.gain * theta), 5.2586 * theta, 0.2632 * theta))


def di_ruscio(model: Model, delta: FloatOrArray = 1.6, c: FloatOrArray = 2.38) -> Settings:
    """Di Ruscio's delta tuning: PI for IPDT that bears a relative dead-time error of `delta`.

    ``kp = alpha/(K theta)``, ``ti = beta theta``, ``alpha = a/(delta + 1)``, ``beta = c/alpha``, with
    ``f = (1 + sqrt(1 + 4/c^2))/2`` and ``a = arctan(c sqrt f)/sqrt f`` (derived, exact).

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.
    delta
        Largest error of the dead time over the dead time, above 0; the loop is on the limit there [-].
    c
        Method product alpha beta = K kp ti, above 0 [-].

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For delta or c that is not above 0, a self-regulating process, or one without dead time.

    References
    ----------
    Di Ruscio 2010, Modeling, Identification and Control 31, 145-164.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = di_ruscio(IntegratingModel(gain=0.05, dead_time=4.0), delta=1.6, c=2.38)
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 2.145, ti = 22.19 s'
    """
    for name, value in (("delta", delta), ("c", c)):
        if not np.all((np.asarray(value) > 0) & np.isfinite(value)):
            raise ValueError(f"{name} = {value}: must be above 0 and finite")
    process = ipdt(model)
    alpha = _delay_limit(c) / (delta + 1)
    return Settings(alpha / (process.gain * process.dead_time), c / alpha * process.dead_time)


def _delay_limit(c: FloatOrArray) -> FloatOrArray:
    """Largest alpha [-] that is stable with the method product c [-] kept (derived)."""
    f = (1 + (1 + 4 / c**2) ** 0.5) / 2
    return np.arctan(c * f**0.5) / f**0.5


def delay_error(alpha: FloatOrArray, beta: FloatOrArray) -> FloatOrArray:
    """Largest relative dead-time error ``delta`` that PI on IPDT bears.

    Parameters
    ----------
    alpha, beta
        kp K theta and ti/theta [-].

    Returns
    -------
    float or ndarray
        delta = a/alpha - 1 [-]; negative for an unstable loop.

    References
    ----------
    Di Ruscio 2010, Modeling, Identification and Control 31, 145-164 (formula derived, exact).
    """
    return _delay_limit(alpha * beta) / alpha - 1
