"""How stable and how fast a simulated loop is: to draw settings, and to space steps."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_plants.controllers import Controller
from sim_plants.plants import Plant

Floats = NDArray[np.float64]

# Grid of frequencies: fine enough that the dead time turns by less than a radian from one to the next.
_POINTS = 500
# Lowest frequency, against the slowest of the loop's own; at a hundredth of it |L| is far above 1.
_LOWEST = 0.01
# Highest frequency times dead time: a loop that is still above 1 there is beyond hope.
_HIGHEST = 30.0


@dataclass(frozen=True)
class Margin:
    """Robustness of a loop.

    Parameters
    ----------
    stable : bool
        Whether the closed loop is stable.
    ms : float
        Peak of the sensitivity, max |1/(1 + L)|; without meaning where unstable.
    omega : float
        Where that peak is [rad/s].
    """

    stable: bool
    ms: float
    omega: float


def _gain(plant: Plant, controller: Controller) -> float:
    """Return the loop's gain, positive when it acts against the error."""
    return plant.gain * controller.kp


def margin(plant: Plant, controller: Controller, period: float) -> Margin:
    """Judge the sampled loop; the hold of the output counts as half a `period` [s] of dead time."""
    if _gain(plant, controller) <= 0:
        return Margin(stable=False, ms=np.inf, omega=np.nan)
    omega = _grid(plant, controller, period)
    return _judge(omega, _loop(omega, plant, controller, period), _integrators(plant, controller))


def _loop(omega: Floats, plant: Plant, controller: Controller, period: float) -> NDArray[np.complex128]:
    held: NDArray[np.complex128] = np.exp(-0.5j * omega * period)
    return plant.response(omega) * controller.response(omega) * held


def _integrators(plant: Plant, controller: Controller) -> int:
    return int(plant.integrating) + int(np.isfinite(controller.ti))


def _judge(omega: Floats, loop: NDArray[np.complex128], integrators: int) -> Margin:
    """Judge by the Nyquist criterion.

    The argument of 1 + L has to turn by a quarter for each integrator of L on the way from the lowest to the
    highest frequency.
    """
    distance = 1 + loop
    angle = np.unwrap(np.angle(distance))
    # An encirclement is a whole turn: half a turn away from the right number tells it from none.
    stable = abs(angle[-1] - angle[0] - integrators * np.pi / 2) < np.pi
    closest = int(np.argmin(np.abs(distance)))
    return Margin(stable=bool(stable), ms=float(1 / abs(distance[closest])), omega=float(omega[closest]))


def _grid(plant: Plant, controller: Controller, period: float) -> Floats:
    """Return frequencies that reach from where |L| is large to where it is small [rad/s]."""
    gain = _gain(plant, controller)
    # Natural frequency of the integrators in the loop alone; without integral action, the gain itself.
    reset = 1 / controller.ti
    own = np.sqrt(gain * reset) if plant.integrating else gain * reset
    slowest = min([f for f in (own, reset, gain if plant.integrating else 1 / plant.t0) if f > 0])
    return np.geomspace(_LOWEST * slowest, _HIGHEST / (plant.dead_time + period / 2), _POINTS)


def settling_time(plant: Plant, controller: Controller, period: float) -> float:
    """Estimate of how long a step is felt, to about 1 % of its peak [s].

    The slowest pole of the model with one lag and no dead time gives the tail, the peak of the sensitivity
    the ringing (a pole of damping 1 / (2 Ms) at its frequency).
    """
    gain, reset, lag = _gain(plant, controller), 1 / controller.ti, plant.half_rule()[1]
    first = [lag, 1.0, gain, gain * reset] if plant.integrating else [lag, 1.0 + gain, gain * reset]
    poles = np.roots(first)
    speeds = np.abs(poles.real)
    slowest = speeds[speeds > 1e-9 / plant.t0].min() if plant.t0 > 0 else speeds.min()
    peak = margin(plant, controller, period)
    ringing = 8 * peak.ms / peak.omega if peak.ms > 1.5 else 0.0
    return float(max(5 / slowest, ringing) + 3 * plant.t0)


def at_sensitivity(plant: Plant, controller: Controller, period: float, ms: float) -> Controller:
    """Return the controller with the largest gain at which the peak sensitivity is at most `ms`.

    Looked for from 20 times its gain downwards in steps of 4 %: with integral action on an integrator the
    sensitivity has a minimum over the gain, so that a bisection may end on the wrong side of it.

    Raises
    ------
    ValueError
        If there is none.
    """
    omega = _grid(plant, controller, period)
    loop, integrators = _loop(omega, plant, controller, period), _integrators(plant, controller)
    for factor in np.geomspace(20, 0.05, 150):
        result = _judge(omega, loop * factor, integrators)
        if result.stable and result.ms <= ms:
            return replace(controller, kp=controller.kp * float(factor))
    raise ValueError(f"ms: {ms!r}, expected a peak sensitivity that this plant can have with this reset")
