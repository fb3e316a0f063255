"""Rules for integrating processes with dead time: Fruehauf, Shinskey, Cluett and Wang, Di Ruscio.

Models and results are scalars or arrays of one shape (L,): kp [OP/PV], times [s].
"""

from __future__ import annotations

import numpy as np

from tuners.imc import ipdt
from tuners.models import FloatOrArray, Model
from tuners.settings import Settings, with_filter


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
