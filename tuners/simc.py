"""SIMC rules (Skogestad 2003), the references against which loops are judged, and close relatives.

Every rule takes a model whose fields are floats or arrays of one shape (L,) and returns `Settings` of that
shape: kp [OP/PV], times [s].
"""

from __future__ import annotations

import numpy as np

from tuners.models import FloatOrArray, IntegratingModel, Model, SelfRegulatingModel, as_self_regulating
from tuners.settings import Settings, plain, with_filter


def loop_time(closed_loop_time: FloatOrArray | None, default: FloatOrArray) -> FloatOrArray:
    """Return closed_loop_time [s], or the rule's default [s] where it is None.

    Raises
    ------
    ValueError
        Where the time is not above 0; a model without dead time has no default.
    """
    if closed_loop_time is None:
        if np.any(np.asarray(default) <= 0):
            raise ValueError("closed_loop_time: must be given for a model without dead time [s]")
        return default
    if np.any(np.asarray(closed_loop_time) <= 0) or np.any(np.isinf(closed_loop_time)):
        raise ValueError(f"closed_loop_time = {closed_loop_time}: must be above 0 and finite [s]")
    return closed_loop_time


def _least(x: FloatOrArray, y: FloatOrArray) -> FloatOrArray:
    return plain(np.minimum(x, y))


def simc_pi(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """SIMC PI; on an integrator half of the lag counts as dead time.

    Integrating: ``kp = 1/(K (tc + theta))``, ``ti = 4 (tc + theta)``; self-regulating:
    ``kp = T/(K (tc + theta))``, ``ti = min(T, 4 (tc + theta))``.

    Parameters
    ----------
    model
        Process; a lag (integrating) or second lag (self-regulating) is absorbed by the half rule.
    closed_loop_time
        tc; by default the dead time [s].

    Returns
    -------
    Settings
        PI, standard form (a PI controller is the same in all forms).

    Raises
    ------
    ValueError
        For tc that is not above 0.

    References
    ----------
    Skogestad 2003, J. Process Control 13, 291-309, table 1.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = simc_pi(IntegratingModel(gain=1.0, dead_time=1.5))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 0.3333, ti = 12 s'
    """
    if isinstance(model, IntegratingModel):
        ipdt = model.without_lag()
        tc = loop_time(closed_loop_time, ipdt.dead_time)
        return Settings(1 / (ipdt.gain * (tc + ipdt.dead_time)), 4 * (tc + ipdt.dead_time))
    fopdt = model.first_order()
    tc = loop_time(closed_loop_time, fopdt.dead_time)
    return Settings(*_first_order_pi(fopdt, tc))


def _first_order_pi(model: SelfRegulatingModel, tc: FloatOrArray) -> tuple[FloatOrArray, FloatOrArray]:
    """Return kp and ti of SIMC for the larger lag alone."""
    lag = plain(np.maximum(model.lag, model.lag2))
    if np.any(np.asarray(lag) <= 0):
        # SIMC for a process that is dead time alone is a pure integral controller.
        raise ValueError("lag = 0: SIMC for a self-regulating process needs a lag above 0 [s]")
    time = tc + model.dead_time
    return lag / (model.gain * time), _least(lag, 4 * time)


def simc_pid(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """SIMC PID in the series form: SIMC PI with ``td`` = the lag (integrating) or the smaller lag.

    Parameters
    ----------
    model
        Process with one retained lag (integrating) or two (self-regulating).
    closed_loop_time
        tc; by default the dead time [s].

    Returns
    -------
    Settings
        Series form with td = lag and tf = td/10; PI where the lag is 0.

    Raises
    ------
    ValueError
        For tc that is not above 0.

    References
    ----------
    Skogestad 2003, table 1; as reference for load and set point: Veronesi and Visioli 2010, J. Process
    Control 20, 261-269.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = simc_pid(IntegratingModel(gain=0.05, dead_time=4.0, lag=3.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 2.5, ti = 32 s, td = 3 s'
    """
    tc = loop_time(closed_loop_time, model.dead_time)
    if isinstance(model, SelfRegulatingModel):
        td = _least(model.lag, model.lag2)
        return with_filter(Settings(*_first_order_pi(model, tc), td, form="series"))
    time = tc + model.dead_time
    return with_filter(Settings(1 / (model.gain * time), 4 * time, model.lag, form="series"))


def simc_pd(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """IMC PD in the series form: ``kp = 1/(K (tc + theta))``, td = the lag; no integral action.

    For a self-regulating process (derived: SIMC PID without its integral) kp = T/(K (tc + theta)) and
    td = the smaller lag; this leaves an offset.

    Parameters
    ----------
    model
        Process with one retained lag (integrating) or two (self-regulating).
    closed_loop_time
        tc; by default the dead time [s].

    Returns
    -------
    Settings
        Series form, ti = inf, td = lag and tf = td/10.

    Raises
    ------
    ValueError
        For tc that is not above 0.

    References
    ----------
    Veronesi and Visioli 2010, J. Process Control 20, 261-269 (set-point reference).

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = simc_pd(IntegratingModel(gain=0.05, dead_time=4.0, lag=3.0))
    >>> f"kp = {settings.kp:.4g}, td = {settings.td:.4g} s"
    'kp = 2.5, td = 3 s'
    """
    tc = loop_time(closed_loop_time, model.dead_time)
    if isinstance(model, SelfRegulatingModel):
        lag, td = np.maximum(model.lag, model.lag2), _least(model.lag, model.lag2)
        kp = plain(lag / (model.gain * (tc + model.dead_time)))
        return with_filter(Settings(kp, np.inf, td, form="series"))
    return with_filter(Settings(1 / (model.gain * (tc + model.dead_time)), np.inf, model.lag, form="series"))


def simc_pi_improved(model: Model, closed_loop_time: FloatOrArray | None = None) -> Settings:
    """Improved SIMC PI for self-regulating processes: a third of the dead time is added to the lag.

    ``kp = (T + theta/3)/(K (tc + theta))``, ``ti = min(T + theta/3, 4 (tc + theta))``.

    Parameters
    ----------
    model
        Self-regulating process; a second lag is absorbed by the half rule.
    closed_loop_time
        tc; by default the dead time [s].

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For an integrating process, where the rule is SIMC itself, or tc that is not above 0.

    References
    ----------
    Grimholt and Skogestad 2012, IFAC PID'12, 11-22.

    Examples
    --------
    >>> from tuners.models import SelfRegulatingModel
    >>> settings = simc_pi_improved(SelfRegulatingModel(gain=2.0, dead_time=4.0, lag=20.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 1.333, ti = 21.33 s'
    """
    fopdt = as_self_regulating(model, "the improved SIMC rule").first_order()
    tc = loop_time(closed_loop_time, fopdt.dead_time)
    lag = fopdt.lag + fopdt.dead_time / 3
    time = tc + fopdt.dead_time
    return Settings(lag / (fopdt.gain * time), _least(lag, 4 * time))
