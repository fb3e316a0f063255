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


def load_integrals(
    s1: float, s2: float, s3: float, y1: float, y2: float, u_end: float
) -> tuple[float, float, float, float]:
    """Size [OP], age of the onset [s before the end], gain and T0 from a load step's integrals (derived).

    ``Ad = -u(inf)``, ``L = -S1/Ad``, ``mu = Y1/(S2 + Ad L^2/2)``, ``T0 = (mu (S3 + Ad L^3/6) - Y2)/Y1``.
    Under noise size and onset stay good, T0 does not.
    """
    size = -u_end
    age = -s1 / size
    gain = y1 / (s2 + size * age**2 / 2)
    return size, age, gain, (gain * (s3 + size * age**3 / 6) - y2) / y1
