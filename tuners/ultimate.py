"""Rules from the ultimate gain and period: Ziegler-Nichols, Tyreus-Luyben, Luyben.

Models and results are scalars or arrays of one shape (L,): kp [OP/PV], times [s].
"""

from __future__ import annotations

import math

import numpy as np

from tuners.models import FloatOrArray, IntegratingModel, Model
from tuners.settings import Settings, plain, with_filter


def ultimate(model: Model) -> tuple[FloatOrArray, FloatOrArray]:
    """Ultimate gain, with the sign of the process gain [OP/PV], and ultimate period [s].

    They follow from the model's phase with exact dead time (bisection); for IPDT this gives
    ``Ku = pi/(2 K theta)`` and ``Pu = 4 theta``.

    Parameters
    ----------
    model
        Process with a dead time.

    Returns
    -------
    tuple
        (ku, pu).

    Raises
    ------
    ValueError
        For a model without dead time, which P control cannot bring to oscillate.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> ku, pu = ultimate(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"Ku = {ku:.3f} OP/PV, Pu = {pu:.1f} s"
    'Ku = 7.854 OP/PV, Pu = 16.0 s'
    """
    theta = np.asarray(model.dead_time, dtype=float)
    if np.any(theta <= 0):
        raise ValueError("dead_time = 0: without dead time there is no ultimate gain")
    # An integrator takes 90 of the 180 degrees; dead time and lags take the rest.
    target = math.pi / 2 if isinstance(model, IntegratingModel) else math.pi
    shape = np.broadcast_shapes(theta.shape, *(np.shape(lag) for lag in model.lags))
    low, high = np.zeros(shape), np.broadcast_to(target / theta, shape).astype(float)
    for _ in range(60):
        middle = (low + high) / 2
        phase = theta * middle + sum(np.arctan(lag * middle) for lag in model.lags)
        low, high = np.where(phase < target, middle, low), np.where(phase < target, high, middle)
    size = np.abs(model.frequency_response(high)) * np.sign(model.gain)
    return plain(1 / size), plain(2 * math.pi / high)


def ziegler_nichols(model: Model) -> Settings:
    """Ziegler-Nichols PID: ``kp = 0.6 Ku``, ``ti = Pu/2``, ``td = Pu/8``; tf = td/10 is added.

    Parameters
    ----------
    model
        Process with a dead time.

    Returns
    -------
    Settings
        Standard form.

    Raises
    ------
    ValueError
        For a model without dead time.

    References
    ----------
    Ziegler and Nichols 1942, Trans. ASME 64, 759-768.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = ziegler_nichols(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 4.712, ti = 8 s, td = 2 s'
    """
    ku, pu = ultimate(model)
    return with_filter(Settings(0.6 * ku, pu / 2, pu / 8))


def ziegler_nichols_pi(model: Model) -> Settings:
    """Ziegler-Nichols PI: ``kp = 0.45 Ku``, ``ti = Pu/1.2``.

    Parameters
    ----------
    model
        Process with a dead time.

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For a model without dead time.

    References
    ----------
    Ziegler and Nichols 1942, Trans. ASME 64, 759-768.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = ziegler_nichols_pi(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 3.534, ti = 13.33 s'
    """
    ku, pu = ultimate(model)
    return Settings(0.45 * ku, pu / 1.2)


def tyreus_luyben(model: Model) -> Settings:
    """Tyreus-Luyben PI: ``kp = Ku/3.22``, ``ti = 2.2 Pu``.

    Parameters
    ----------
    model
        Process with a dead time.

    Returns
    -------
    Settings
        PI, standard form.

    Raises
    ------
    ValueError
        For a model without dead time.

    References
    ----------
    Tyreus and Luyben 1992, Ind. Eng. Chem. Res. 31, 2625-2628.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = tyreus_luyben(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 2.439, ti = 35.2 s'
    """
    ku, pu = ultimate(model)
    return Settings(ku / 3.22, 2.2 * pu)


def luyben_pid(model: Model) -> Settings:
    """Luyben's PID: ``kp = Ku/2.2``, ``ti = 2.2 Pu``, ``td = Pu/6.3``, ``tf = td/10``.

    Parameters
    ----------
    model
        Process with a dead time.

    Returns
    -------
    Settings
        Standard form.

    Raises
    ------
    ValueError
        For a model without dead time.

    References
    ----------
    Luyben 1996, Ind. Eng. Chem. Res. 35, 3480-3483; filter after Rice and Cooper 2002, comparison table.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = luyben_pid(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 3.57, ti = 35.2 s, td = 2.54 s'
    """
    ku, pu = ultimate(model)
    return with_filter(Settings(ku / 2.2, 2.2 * pu, pu / 6.3))
