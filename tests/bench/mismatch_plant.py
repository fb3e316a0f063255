"""True plants of the benchmark `mismatch`: any rational function behind a dead time, and what is true of a loop.

Nothing here rests on the product's models: state spaces are put together block by block, discretised by the matrix
exponential, and the loop is judged on the unit circle as its controller sees the plant: held output, execution
period, PV filter, derivative filter, delay of the output.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Floats = NDArray[np.float64]
INTEGRATING, SELF = "integrating", "self-regulating"


@dataclass(frozen=True)
class Space:
    """x' = a x + b u, y = c x + d u."""

    a: Floats
    b: Floats
    c: Floats
    d: float = 0.0

    def then(self, after: Space) -> Space:
        """Return this block followed by another."""
        n, m = len(self.b), len(after.b)
        a = np.zeros((n + m, n + m))
        a[:n, :n], a[n:, n:] = self.a, after.a
        a[n:, :n] = np.outer(after.b, self.c)
        b = np.concatenate([self.b, after.b * self.d])
        return Space(a, b, np.concatenate([after.d * self.c, after.c]), self.d * after.d)

    def beside(self, other: Space) -> Space:
        """Return the sum of two blocks."""
        n, m = len(self.b), len(other.b)
        a = np.zeros((n + m, n + m))
        a[:n, :n], a[n:, n:] = self.a, other.a
        return Space(
            a, np.concatenate([self.b, other.b]), np.concatenate([self.c, other.c]), self.d + other.d
        )

    def recycled(self, back: Space) -> Space:
        """Return the block whose output comes back to its input through another (positive feedback)."""
        n, m = len(self.b), len(back.b)
        if self.d or back.d:
            raise ValueError("both paths need to be strictly proper")
        a = np.zeros((n + m, n + m))
        a[:n, :n], a[n:, n:] = self.a, back.a
        a[:n, n:], a[n:, :n] = np.outer(self.b, back.c), np.outer(back.b, self.c)
        return Space(a, np.concatenate([self.b, np.zeros(m)]), np.concatenate([self.c, np.zeros(m)]))


def block(above: tuple[float, ...], below: tuple[float, ...]) -> Space:
    """Return a block as numerator over denominator in falling powers of s; the denominator of degree 1 or 2."""
    den = np.array(below, dtype=float)
    num = np.concatenate([np.zeros(len(den) - len(above)), np.array(above, dtype=float)]) / den[0]
    den = den / den[0]
    order = len(den) - 1
    a = np.zeros((order, order))
    a[0] = -den[1:]
    a[1:, :-1] = np.eye(order - 1)
    b = np.zeros(order)
    b[0] = 1.0
    return Space(a, b, num[1:] - num[0] * den[1:], float(num[0]))


def lag(seconds: float, zero: float = 0.0) -> Space:
    """Return (zero s + 1)/(lag s + 1); a negative zero is an inverse response."""
    return block((zero, 1.0), (seconds, 1.0))


def swing(omega: float, zeta: float, share: float = 1.0) -> Space:
    """Return share w^2/(s^2 + 2 zeta w s + w^2)."""
    return block((share * omega**2,), (1.0, 2 * zeta * omega, omega**2))


def chain(gain: float, integrates: bool, *blocks: Space) -> Space:
    """Return blocks one after the other, with an integrator in front or without."""
    parts = ([block((1.0,), (1.0, 0.0))] if integrates else []) + list(blocks)
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.then(part)
    return replace(whole, c=whole.c * gain, d=whole.d * gain)


@dataclass(frozen=True)
class Plant:
    """A true plant, what a table may say of it, and what is true of it by the words of the product."""

    process: str
    """What it is, in the product's words; where neither fits, the nearer."""
    space: Space
    dead_time: float
    theta: float
    """Half rule: effective dead time and lag [s] of the part that a rule can serve."""
    lag: float
    slope: float
    """Gain that the rule of the settings uses, integrating [PV/(OP s)], or self-regulating [PV/OP]."""
    gains: dict[str, tuple[float, float]] = field(default_factory=dict)
    """True gain by kind of process (least and largest); none where there is no such thing."""
    half_rule: bool = True
    """Whether the half-rule model says all: else `cured` is not asked."""
    ruled: str = ""
    """Process by which the settings are ruled, where that is not the process."""

    def __post_init__(self) -> None:
        if self.space.d:
            raise ValueError(
                "PV follows no input at once: neither `sampled` nor the simulation has that path"
            )

    @property
    def integrators(self) -> int:
        return int((np.abs(np.linalg.eigvals(self.space.a)) < 1e-12).sum())

    @property
    def swings(self) -> Floats:
        """Frequencies of poles that are not on the real axis [rad/s]."""
        poles = np.linalg.eigvals(self.space.a)
        return np.abs(poles[poles.imag > 1e-12])

    @property
    def slowest(self) -> float:
        """Least frequency of a pole other than an integrator [rad/s]."""
        sizes = np.abs(np.linalg.eigvals(self.space.a))
        return float(min(sizes[sizes > 1e-12], default=math.inf))


@dataclass(frozen=True)
class Law:
    """A controller as it runs: settings in its own form, and what its block adds."""

    kp: float
    ti: float
    td: float
    tf: float
    form: str = "standard"
    b: float = 1.0
    c: float = 1.0
    filter: float = 0.0
    """Time constant of the PV filter [s]."""
    late: int = 0
    """Executions by which the output acts late."""
    kind: str = "linear"
    """Or ``squared`` (gain grows with the error), ``gap`` (less gain near the set point)."""
    width: float = math.inf
    """Error at which a squared law has its nominal gain; half the gap [PV]."""
    inside: float = 1.0
    """Share of the gain inside the gap."""

    @property
    def lead(self) -> float:
        """Factor of the filtered derivative [s]."""
        return self.td - self.tf if self.form == "series" and self.td > 0 else self.td

    @property
    def standard(self) -> dict[str, float]:
        """kp, ti and td in the standard form, under the same filter (derived)."""
        if self.form != "series" or math.isinf(self.ti):
            return {"kp": self.kp, "ti": self.ti, "td": self.td}
        kp = self.kp * (1 + self.lead / self.ti)
        ti = self.ti + self.lead
        return {"kp": kp, "ti": ti, "td": self.lead * (self.ti - self.tf) / ti}

    def response(self, omega: Floats, scan: float) -> NDArray[np.complex128]:
        """From -PV to OP on the unit circle [OP/PV]."""
        z = np.exp(1j * omega * scan)
        back = 1 - 1 / z
        lead = self.lead * back / (self.tf * back + scan)
        reset = scan / self.ti / back
        share = scan / (self.filter + scan)
        filtered = share / (1 - (1 - share) / z)
        law = (1 + lead) * (1 + reset) if self.form == "series" else 1 + lead + reset
        return np.asarray(self.kp * law * filtered * z**-self.late, dtype=np.complex128)


def held(space: Space, seconds: float) -> tuple[Floats, Floats]:
    """Transition and input vector over a time under a constant input (Van Loan 1978)."""
    n = len(space.b)
    joint = np.zeros((n + 1, n + 1))
    joint[:n, :n], joint[:n, n] = space.a * seconds, space.b * seconds
    whole = expm(joint)
    return whole[:n, :n], whole[:n, n]


def sampled(plant: Plant, omega: Floats, scan: float) -> NDArray[np.complex128]:
    """Return the plant between a held output and a sample of PV, both once a scan, dead time included [PV/OP]."""
    space = plant.space
    whole = math.floor(plant.dead_time / scan + 1e-9)
    rest = max(plant.dead_time - whole * scan, 0.0)
    phi, _ = held(space, scan)
    after, newer = held(space, scan - rest)
    older = after @ held(space, rest)[1]
    z = np.exp(1j * omega * scan)
    drive = newer[None, :] + older[None, :] / z[:, None]
    states = np.linalg.solve(z[:, None, None] * np.eye(len(phi)) - phi, drive[..., None])[..., 0]
    return np.asarray(states @ space.c * z**-whole)


def grid(plant: Plant, law: Law, scan: float) -> Floats:
    """Frequencies from far below everything to the controller's Nyquist frequency, dense where a plant swings."""
    top = math.pi / scan
    low = 0.003 * min(1 / law.ti or math.inf, plant.slowest, 1 / (plant.theta + scan), top)
    parts = [np.geomspace(low, top, 1200), np.linspace(0.02 * top, top, 600)]
    parts += [w * np.linspace(0.8, 1.2, 400) for w in plant.swings]
    omega = np.unique(np.concatenate(parts))
    return omega[omega <= top]


def peak(plant: Plant, law: Law, scan: float, factor: float = 1.0) -> float:
    """Peak sensitivity of the true loop, plant's gain times a factor; inf where unstable (Nyquist)."""
    if plant.slope * law.kp <= 0:
        return math.inf
    omega = grid(plant, law, scan)
    distance = 1 + factor * sampled(plant, omega, scan) * law.response(omega, scan)
    angle = np.unwrap(np.angle(distance))
    integrators = plant.integrators + int(math.isfinite(law.ti))
    turned = angle[-1] - angle[0] - integrators * math.pi / 2
    return float(1 / np.abs(distance).min()) if abs(turned) < math.pi else math.inf
