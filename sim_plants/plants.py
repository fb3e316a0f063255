"""Processes with dead time, and their exact discretisation under a zero-order hold."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Floats = NDArray[np.float64]
Process = Literal["integrating", "self-regulating"]

# A dead time this close to a multiple of the period [periods] counts as one: 0.3 / 0.1 is not quite 3.
GRID_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Plant:
    """Process with dead time, of any order.

    `gain * exp(-dead_time s) * prod(1 - z s) / (s * prod(lag s + 1))`, without the integrator where the
    process is self-regulating.

    Parameters
    ----------
    process : {'integrating', 'self-regulating'}
        Whether the process has an integrator.
    gain : float
        Process gain, signed, not 0 [PV/(OP s)] integrating, [PV/OP] self-regulating.
    dead_time : float
        Dead time between controller output and process, 0 or more [s].
    lags : tuple of float
        Time constants of the lags, each above 0 [s].
    inverse : tuple of float
        Time constants z of right-half-plane zeros (inverse response), each above 0 [s]. Fewer than the poles.

    Raises
    ------
    ValueError
        Naming the field, its value and what is accepted.
    """

    process: Process
    gain: float
    dead_time: float = 0.0
    lags: tuple[float, ...] = ()
    inverse: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.process not in get_args(Process):
            raise ValueError(f"process: {self.process!r}, expected one of {', '.join(get_args(Process))}")
        if not (np.isfinite(self.gain) and self.gain != 0):
            raise ValueError(f"gain: {self.gain!r}, expected a finite number other than 0")
        if not (np.isfinite(self.dead_time) and self.dead_time >= 0):
            raise ValueError(f"dead_time: {self.dead_time!r}, expected a number of seconds, 0 or more")
        for field, values in (("lags", self.lags), ("inverse", self.inverse)):
            if not all(np.isfinite(value) and value > 0 for value in values):
                raise ValueError(f"{field}: {list(values)!r}, expected numbers of seconds above 0")
        if self.order == 0:
            raise ValueError("lags: [], expected at least one lag for a self-regulating process")
        if len(self.inverse) >= self.order:
            raise ValueError(
                f"inverse: {list(self.inverse)!r}, expected fewer zeros than poles ({self.order})"
            )

    @property
    def integrating(self) -> bool:
        """Whether the process has an integrator."""
        return self.process == "integrating"

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.lags) + self.integrating

    @property
    def t0(self) -> float:
        """Sum of the lags, the dead time and the time constants of the zeros [s]."""
        return sum(self.lags) + self.dead_time + sum(self.inverse)

    def half_rule(self) -> tuple[float, float]:
        """Dead time and lag of the model with one retained lag, by the half rule.

        Returns
        -------
        dead_time, lag : float
            Effective dead time and retained lag [s]; their sum is `t0`.

        References
        ----------
        S. Skogestad, J. Process Control 13 (2003) 291-309, section 2.
        """
        first, second = (*sorted(self.lags, reverse=True), 0.0, 0.0)[:2]
        lag = first + second / 2
        return self.t0 - lag, lag

    def response(self, omega: Floats) -> NDArray[np.complex128]:
        """Frequency response at `omega` [rad/s], shape `(M,)`; [PV/OP], shape `(M,)`."""
        s = 1j * omega
        result = self.gain * np.exp(-self.dead_time * s)
        for zero in self.inverse:
            result = result * (1 - zero * s)
        for lag in self.lags:
            result = result / (lag * s + 1)
        return np.asarray(result / s if self.integrating else result, dtype=np.complex128)


@dataclass(frozen=True, eq=False)
class Discrete:
    """Exact step of a plant over one sample period: `x' = phi x + older w[k-delay-1] + newer w[k-delay]`.

    `w` is the input held since sample k, PV is the last state. `phi (n, n)` is lower triangular, `older`
    and `newer` have the shape `(n,)`; `delay` counts whole samples.
    """

    phi: Floats
    older: Floats
    newer: Floats
    delay: int


def state_space(plant: Plant) -> tuple[Floats, Floats]:
    """Continuous state space without dead time, as a chain whose last state is PV.

    Returns
    -------
    a : (n, n) array
        System matrix, lower triangular since each stage only sees those before it [1/s].
    b : (n,) array
        Input vector [PV/(OP s)].
    """
    n = plant.order
    a, b = np.zeros((n, n)), np.zeros(n)
    # Row and number that give the signal at the entry of the next stage from the states and the input.
    row, direct = np.zeros(n), plant.gain
    for i, lag in enumerate(plant.lags):
        a[i] = row / lag
        a[i, i] -= 1 / lag
        b[i] = direct / lag
        # Zeros sit on the first lags: (1 - z s)/(lag s + 1) passes -z/lag of its input straight through.
        through = -plant.inverse[i] / lag if i < len(plant.inverse) else 0.0
        row, direct = through * row, through * direct
        row[i] += 1 - through
    if plant.integrating:
        a[n - 1], b[n - 1] = row, direct
    return a, b


def hold(plant: Plant, seconds: float) -> tuple[Floats, Floats]:
    """Transition over `seconds` under a constant input, by the matrix exponential.

    Returns
    -------
    phi : (n, n) array
        Effect of the state at the start.
    gamma : (n,) array
        Effect of a unit input [PV/OP].

    References
    ----------
    C. F. Van Loan, Computing integrals involving the matrix exponential, IEEE TAC 23 (1978) 395-404.
    """
    a, b = state_space(plant)
    n = plant.order
    joint = np.zeros((n + 1, n + 1))
    joint[:n, :n], joint[:n, n] = a * seconds, b * seconds
    result = expm(joint)
    return np.tril(result[:n, :n]), result[:n, n]


def delay_of(seconds: float, period: float) -> tuple[int, float]:
    """Whole periods in `seconds` and the rest [s], with numbers a rounding error below a multiple lifted."""
    whole = int(np.floor(seconds / period + GRID_TOLERANCE))
    return whole, max(seconds - whole * period, 0.0)


def discretise(plant: Plant, period: float) -> Discrete:
    """Exact discretisation at `period` [s] of an input held between samples.

    A dead time of d whole periods and a rest splits each period in two: the older input acts during the
    rest, the newer one afterwards (Åström and Wittenmark, Computer-Controlled Systems, 3rd ed., section 2.3).
    """
    delay, rest = delay_of(plant.dead_time, period)
    phi, whole = hold(plant, period)
    if rest <= GRID_TOLERANCE * period:
        return Discrete(phi, np.zeros(plant.order), whole, delay)
    after, newer = hold(plant, period - rest)
    _, before = hold(plant, rest)
    return Discrete(phi, after @ before, newer, delay)
