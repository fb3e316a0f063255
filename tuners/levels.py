"""Averaging level control: surge vessels that are to absorb, not to hold their set point."""

from __future__ import annotations

import numpy as np

from tuners.models import FloatOrArray, Model, as_integrating
from tuners.settings import Settings

DAMPING = 1.0  # zeta = sqrt(kp K ti)/2: 1 gives the shortest ti without rolling


def averaging(model: Model, max_load: FloatOrArray, max_deviation: FloatOrArray) -> Settings:
    """Averaging level PI: ``kp = max_load/max_deviation``, ``kp K ti = 4`` (damping 1).

    The lowest gain for which the largest load keeps the level inside the allowed excursion (P action alone
    would let it go exactly there; the integral then brings it back), with the fastest reset that does not
    make it roll. Holds for a dead time that is small beside ti.

    Parameters
    ----------
    model
        Integrating process.
    max_load
        Largest load change to be expected, above 0 [OP].
    max_deviation
        Allowed excursion of the level, above 0 [PV].

    Returns
    -------
    Settings
        PI, standard form; kp has the sign of the gain.

    Raises
    ------
    ValueError
        For a self-regulating process, or a value that is not above 0.

    References
    ----------
    Cheung and Luyben 1979, Ind. Eng. Chem. Fundam. 18, 15-21 (proportional and PI averaging level control);
    the factor 4 is the double pole of ``s^2 + kp K s + kp K/ti`` (derived).

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = averaging(IntegratingModel(gain=0.01, dead_time=2.0), max_load=10.0, max_deviation=20.0)
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s"
    'kp = 0.5, ti = 800 s'
    """
    model = as_integrating(model, "averaging level control")
    for name, value in (("max_load", max_load), ("max_deviation", max_deviation)):
        if not np.all((np.asarray(value) > 0) & np.isfinite(value)):
            raise ValueError(f"{name} = {value}: must be above 0 and finite")
    kp = np.sign(model.gain) * max_load / max_deviation
    ti = 4 * DAMPING**2 / (kp * model.gain)
    return Settings(kp if np.ndim(kp) else float(kp), ti if np.ndim(ti) else float(ti))


def method_product(model: Model, settings: Settings) -> FloatOrArray:
    """Product kp K ti of a level loop [-]: below 2 (damping below 0.7) it rolls, and more so with less gain.

    Parameters
    ----------
    model, settings
        Integrating process and PI controller; fields are floats or arrays that broadcast.

    Returns
    -------
    float or ndarray
        kp K ti; inf without integral action. Well-damped published rules lie at 2.4 to 4.

    Raises
    ------
    ValueError
        For a self-regulating process.

    References
    ----------
    Di Ruscio 2010, Modeling, Identification and Control 31, 145-164 (method product).

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> method_product(IntegratingModel(gain=0.03, dead_time=4.0), Settings(kp=0.6, ti=44.4)) < 2  # it rolls
    True
    """
    model = as_integrating(model, "the method product")
    standard = settings.to("standard")
    return standard.kp * model.gain * standard.ti
