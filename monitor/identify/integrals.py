"""Process figures from an event's running integrals: exact without noise, for any linear controller."""

from __future__ import annotations

import math


def setpoint_integrals(amplitude: float, s1: float, s2: float, y1: float) -> tuple[float, float]:
    """Gain [PV/(OP s)] and T0 [s] of an integrating process from a set-point step's integrals.

    ``mu = Ar / int u``, ``T0 = (mu int int u - int y) / Ar`` (derived; exact for any linear controller once
    the loop has settled). NaN where OP's integral is zero.

    Examples
    --------
    >>> setpoint_integrals(amplitude=2.0, s1=40.0, s2=4000.0, y1=192.0)
    (0.05, 4.0)
    """
    gain = amplitude / s1 if s1 != 0 else math.nan
    return gain, (gain * s2 - y1) / amplitude
