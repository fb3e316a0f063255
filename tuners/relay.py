"""Models from a relay test: period and amplitude of the limit cycle under a symmetric relay."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tuners.models import Array, FloatOrArray, IntegratingModel
from tuners.settings import plain


def _check_cycle(**values: FloatOrArray) -> None:
    for name, value in values.items():
        if np.any(np.asarray(value) <= 0):
            raise ValueError(f"{name}: must be above 0")


def relay_ipdt(relay: FloatOrArray, period: FloatOrArray, amplitude: FloatOrArray) -> IntegratingModel:
    """IPDT model from a relay test: ``theta = P/4``, ``K = 4 a/(h P)``; exact.

    Parameters
    ----------
    relay
        Height h of the relay, which switches between +h and -h [OP].
    period
        Period of the limit cycle [s].
    amplitude
        Amplitude of PV, half of peak to peak [PV].

    Returns
    -------
    IntegratingModel
        With lag 0; the gain is taken as positive.

    Raises
    ------
    ValueError
        For a value that is not above 0.

    References
    ----------
    Kaya 1999 (relay identification); exact limit cycle of an integrator with dead time.
    """
    _check_cycle(relay=relay, period=period, amplitude=amplitude)
    return IntegratingModel(4 * amplitude / (relay * period), period / 4)


def relay_ifopdt(
    gain: FloatOrArray, relay: FloatOrArray, period: FloatOrArray, amplitude: FloatOrArray
) -> IntegratingModel:
    """Integrator with lag and dead time from a relay test and the known gain; exact.

    With q = P/2, ``a/(h K) = q/2 - T ln(2/(1 + e^(-q/T)))`` gives T, then
    ``0 = q/2 - theta - T + 2 T e^(-(q - theta)/T)/(1 + e^(-q/T))`` gives theta.

    Parameters
    ----------
    gain
        Known gain, signed (from a set-point step, say) [PV/(OP s)].
    relay, period, amplitude
        As in `relay_ipdt` [OP], [s], [PV].

    Returns
    -------
    IntegratingModel
        lag and dead_time solve the two equations to 1e-12.

    Raises
    ------
    ValueError
        For a value that is not above 0, gain 0, or an amplitude above that of the pure integrator,
        ``abs(K) h P/4``, for which no lag exists.

    References
    ----------
    Kaya 1999 (relay identification).
    """
    _check_cycle(relay=relay, period=period, amplitude=amplitude)
    q = np.asarray(period) / 2
    target = np.asarray(amplitude / (relay * np.abs(gain)))
    if np.any(target > q / 2 * (1 + 1e-12)):
        raise ValueError("amplitude: above abs(gain) relay period / 4, no lag explains it")
    lag = _bisect(lambda lag: q / 2 - lag * np.log(2 / (1 + np.exp(-q / lag))) - target, q * 1e-9, q * 1e3)

    def switch(theta: Array) -> Array:
        # Positive at 0, negative at q/2: PV passes zero a dead time before the relay's edge arrives.
        share = np.exp(-(q - theta) / lag) / (1 + np.exp(-q / lag))
        return np.asarray(q / 2 - theta - lag + 2 * lag * share)

    dead_time = _bisect(switch, np.zeros_like(q), q)
    return IntegratingModel(gain, plain(dead_time), plain(lag))


def _bisect(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Root of a falling function between low and high, elementwise."""
    for _ in range(200):
        middle = (low + high) / 2
        positive = function(middle) > 0
        low, high = np.where(positive, middle, low), np.where(positive, high, middle)
    return np.asarray((low + high) / 2)
