"""Rules from a step of the output in manual: Ziegler-Nichols' reaction curve, Cohen-Coon, AMIGO.

Models and results are scalars or arrays of one shape (L,): kp [OP/PV], times [s].
"""

from __future__ import annotations

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
