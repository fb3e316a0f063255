"""I-PD rules: Kaya's ISTE and IST2E, fitted and exact, and Chakraborty's; Ali & Majhi's printed settings.

Models and results are scalars or arrays of one shape (L,): kp [OP/PV], times [s].
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.polynomial import polyval

from tuners.imc import ipdt
from tuners.models import Array, FloatOrArray, IntegratingModel, Model, as_integrating
from tuners.settings import Settings, plain, with_filter

Powers = tuple[float, ...]
Fit = tuple[tuple[Powers, Powers], Powers, tuple[Powers, Powers]]

FITTED_RATIOS = (0.1, 3.0)  # theta/T of the fit

# Coefficients in x = theta/T, lowest power first: (kp K T: numerator, denominator), ti/T, (td/T: both).
# td/tf that we add. The designs have Ms of 5 to 7 without a filter; one of td/10 would make those with
# dead_time/lag below 0.5 all but unstable.
KAYA_FILTER_RATIO = 100.0

ISTE: Fit = (
    ((0.3373, 0.8669, 0.08409), (0.001124, -0.02375, 1.0)),
    (0.02802, 3.578, -0.8113, 0.2323, -0.02669),
    ((0.0001, 1.92084, 1.15035, 0.42737), (0.83409, 1.78338, 1.0)),
)
IST2E: Fit = (
    ((0.26817, 0.78172, 0.08203), (0.001349, -0.02867, 1.0)),
    (0.0401, 4.20108, -1.07446, 0.31499, -0.03662),
    ((0.00026, 1.57923, 0.92635, 0.38437), (0.66892, 1.53781, 1.0)),
)


def _ifopdt(model: Model) -> IntegratingModel:
    """Return the model if the fit holds for it; raise ValueError otherwise."""
    model = as_integrating(model)
    lag = np.asarray(model.lag, dtype=float)
    ratio = np.divide(
        model.dead_time, lag, out=np.full(np.broadcast(model.dead_time, lag).shape, np.inf), where=lag > 0
    )
    wrong = (ratio < FITTED_RATIOS[0]) | (ratio > FITTED_RATIOS[1])
    if np.any(wrong):
        raise ValueError(f"dead_time/lag = {ratio[wrong].flat[0]:.4g}: this rule holds for 0.1 to 3")
    return model


def _fitted(model: Model, fit: Fit) -> Settings:
    """Evaluate the fitted formulas; all of the settings scale with the lag."""
    process = _ifopdt(model)
    x = np.asarray(process.dead_time / process.lag)
    gain, ti, td = fit
    kp = polyval(x, gain[0]) / polyval(x, gain[1]) / (process.gain * process.lag)
    td_value = process.lag * polyval(x, td[0]) / polyval(x, td[1])
    settings = Settings(plain(kp), plain(process.lag * polyval(x, ti)), plain(td_value), b=0.0, c=0.0)
    return with_filter(settings, KAYA_FILTER_RATIO)


def kaya_iste(model: Model) -> Settings:
    """Kaya's I-PD for the least ISTE, ``int (t e)^2 dt``, of a set-point step: fitted formula.

    kp as printed; ti and td recovered by repeating the paper's fit to the optima (derived). The formulas miss
    the optimum by up to 1.4 % in kp and 2.5 % in ti; `kaya_optimum` has it exactly. tf = td/100 is added:
    the loop has Ms above 5, and a slower filter takes what margin is left.

    Parameters
    ----------
    model
        Integrating process with a lag, dead_time/lag from 0.1 to 3.

    Returns
    -------
    Settings
        Standard form, set-point weights b = c = 0.

    Raises
    ------
    ValueError
        For a self-regulating process, or dead_time/lag outside 0.1 to 3.

    References
    ----------
    Kaya 2018, IFAC PID'18.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = kaya_iste(IntegratingModel(gain=1.0, dead_time=3.0, lag=1.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 0.4138, ti = 7.571 s, td = 1.821 s'
    """
    return _fitted(model, ISTE)


def kaya_ist2e(model: Model) -> Settings:
    """Kaya's I-PD for the least IST2E, ``int (t^2 e)^2 dt``, of a set-point step: fitted formula.

    All formulas recovered by repeating the paper's fit to the optima (derived); accuracy and filter as in
    `kaya_iste`. Of the two examples with printed settings the second, ``e^-6.667s/(s (10.141 s + 1))`` identified
    for a fourth-order plant, contradicts the paper's own formula: kp is printed as .191 (and was simulated so: its
    overshoot and settling time are those of .191), the formula gives .1944 and the optimum .1940; ti and td agree.
    The text there also swaps the labels ISTE and IST2E.

    Parameters
    ----------
    model
        Integrating process with a lag, dead_time/lag from 0.1 to 3.

    Returns
    -------
    Settings
        Standard form, set-point weights b = c = 0.

    Raises
    ------
    ValueError
        For a self-regulating process, or dead_time/lag outside 0.1 to 3.

    References
    ----------
    Kaya 2018, IFAC PID'18.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = kaya_ist2e(IntegratingModel(gain=1.0, dead_time=3.0, lag=1.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 0.3759, ti = 8.512 s, td = 1.642 s'
    """
    return _fitted(model, IST2E)


def kaya_optimum(model: Model, power: int = 1) -> Settings:
    """I-PD (without filter) with the least ``int (t^power e)^2 dt`` after a set-point step, computed anew.

    The integral is taken in the frequency domain (Parseval), ``1/pi int_0^inf abs(d^n E/ds^n)^2 domega``,
    with exact dead time, and minimised over ln kp, ln ti, ln td (derived).

    Parameters
    ----------
    model
        Integrating process with a lag; scalar fields, any dead_time/lag from 0.05 to 10.
    power
        n: 1 for ISTE, 2 for IST2E.

    Returns
    -------
    Settings
        Standard form, tf = 0, set-point weights b = c = 0.

    Raises
    ------
    ValueError
        For another power, a self-regulating process, or dead_time/lag outside 0.05 to 10.
    """
    if power not in {1, 2}:
        raise ValueError(f"power = {power}: must be 1 (ISTE) or 2 (IST2E)")
    model = as_integrating(model)
    lag = float(model.lag)
    x = float(model.dead_time) / lag if lag > 0 else math.inf
    if not 0.05 <= x <= 10:
        raise ValueError(f"dead_time/lag = {x:.4g}: the optimum is computed for 0.05 to 10")
    unit = IntegratingModel(1.0, x, 1.0)
    inside = min(max(x, FITTED_RATIOS[0]), FITTED_RATIOS[1])
    start = _fitted(IntegratingModel(1.0, inside, 1.0), ISTE if power == 1 else IST2E)
    logs = np.log(np.array([start.kp, start.ti, start.td], dtype=float))
    # Outside the fit's range walk from its edge to x, each optimum being the start of the next.
    steps = 1 + math.ceil(abs(math.log(x / inside)) / 0.2)
    for ratio in np.geomspace(inside, x, steps) if steps > 1 else (x,):
        logs = _minimise(ratio, logs, power)
    from tuners.robustness import peak_sensitivity  # noqa: PLC0415 (compiled: who names the rules need not import numba)

    kp, ti, td = np.exp(logs)
    if not math.isfinite(float(peak_sensitivity(unit, Settings(kp, ti, td)))):
        # Parseval's integral knows nothing of stability, but grows without bound on the way out.
        raise ArithmeticError(f"dead_time/lag = {x:.4g}: the search has left the stable region")
    return Settings(float(kp / (model.gain * lag)), float(ti * lag), float(td * lag), b=0.0, c=0.0)


def _minimise(x: float, start: Array, power: int) -> Array:
    """Return ln kp, ln ti, ln td of the optimum for ``e^(-x s)/(s (s + 1))``, from a start near by."""
    omega, weight = _quadrature(1 / (x + 1))

    def cost(logs: Array) -> float:
        kp, ti, td = np.exp(logs)
        return float(np.log(weight @ np.abs(_error(omega, x, kp, ti, td, power)) ** 2))

    # Newton's method; the start is within a few per cent. (scipy.optimize takes 0.6 s to import alone.)
    logs, h = start, 1e-4
    steps = h * np.eye(3)
    for _ in range(30):
        here = cost(logs)
        ahead = np.array([cost(logs + step) for step in steps])
        behind = np.array([cost(logs - step) for step in steps])
        both = np.array([[cost(logs + one + other) for one in steps] for other in steps])
        slope = (ahead - behind) / (2 * h)
        bend = (both - ahead[:, np.newaxis] - ahead + here) / h**2
        move = -_positive_definite_solve(bend, slope)
        move *= min(1.0, 0.1 / np.abs(move).max())
        while cost(logs + move) > here and np.abs(move).max() > 1e-9:
            move /= 2
        logs = logs + move
        if np.abs(move).max() < 1e-7:
            break
    return logs


def _positive_definite_solve(matrix: Array, vector: Array) -> Array:
    """Solve with the eigenvalues made positive, so that the step always leads downhill."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray(vectors @ ((vectors.T @ vector) / np.maximum(np.abs(values), 1e-6)))


def _quadrature(scale: float) -> tuple[Array, Array]:
    """Nodes [rad/s] and weights for an integral over 0 to inf: Gauss-Legendre in omega = scale v/(1 - v).

    Forty panels of 16 nodes on 0 < v < 1: as good as one of 600, whose nodes alone take 0.3 s.
    """
    nodes, weights = np.polynomial.legendre.leggauss(16)
    edges = np.linspace(0.0, 1.0, 41)
    v = (edges[:-1, np.newaxis] + (nodes + 1) / 80).ravel()
    return scale * v / (1 - v), np.tile(weights / 80, 40) * scale / (1 - v) ** 2


def _error(omega: Array, x: float, kp: float, ti: float, td: float, power: int) -> Array:
    """Return the derivative of order `power` of E(s) = A/B at s = j omega, for ``e^(-x s)/(s (s + 1))``."""
    s = 1j * omega
    delay = kp * np.exp(-x * s)
    q, q1, q2 = 1 + ti * s + ti * td * s**2, ti + 2 * ti * td * s, 2 * ti * td
    b = ti * (s**3 + s**2) + delay * q
    b1 = ti * (3 * s**2 + 2 * s) + delay * (q1 - x * q)
    b2 = ti * (6 * s + 2) + delay * (q2 - 2 * x * q1 + x**2 * q)
    # s E = 1 - kp e^(-x s)/B, so A = (B - kp e^(-x s))/s, a polynomial plus delay terms without the pole.
    p, p1 = ti + ti * td * s, ti * td
    a = ti * (s**2 + s) + delay * p
    a1 = ti * (2 * s + 1) + delay * (p1 - x * p)
    a2 = 2 * ti + delay * (-2 * x * p1 + x**2 * p)
    e, ratio = a / b, b1 / b
    e1 = a1 / b - e * ratio
    if power == 1:
        return np.asarray(e1)
    return np.asarray(a2 / b - 2 * e1 * ratio - e * b2 / b)


def kaya_iste_exact(model: Model) -> Settings:
    """Optimum behind `kaya_iste`, computed anew by `kaya_optimum`; tf = td/100 is added.

    Parameters
    ----------
    model
        Integrating process with a lag; scalar fields, dead_time/lag from 0.05 to 10.

    Returns
    -------
    Settings
        Standard form, set-point weights b = c = 0.

    Raises
    ------
    ValueError
        For a self-regulating process, or dead_time/lag outside 0.05 to 10.

    References
    ----------
    Criterion: Kaya 2018, IFAC PID'18; computation derived.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = kaya_iste_exact(IntegratingModel(gain=1.0, dead_time=3.0, lag=1.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 0.4084, ti = 7.575 s, td = 1.821 s'
    """
    return with_filter(kaya_optimum(model, 1), KAYA_FILTER_RATIO)


def kaya_ist2e_exact(model: Model) -> Settings:
    """Optimum behind `kaya_ist2e`, computed anew by `kaya_optimum`; tf = td/100 is added.

    Parameters
    ----------
    model
        Integrating process with a lag; scalar fields, dead_time/lag from 0.05 to 10.

    Returns
    -------
    Settings
        Standard form, set-point weights b = c = 0.

    Raises
    ------
    ValueError
        For a self-regulating process, or dead_time/lag outside 0.05 to 10.

    References
    ----------
    Criterion: Kaya 2018, IFAC PID'18; computation derived.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = kaya_ist2e_exact(IntegratingModel(gain=1.0, dead_time=3.0, lag=1.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 0.3706, ti = 8.519 s, td = 1.642 s'
    """
    return with_filter(kaya_optimum(model, 2), KAYA_FILTER_RATIO)


def chakraborty(model: Model) -> Settings:
    """Chakraborty's I-PD for IPDT: ``kp = 0.8435/(K theta)``, ``ti = 3.555 theta``, ``td = 0.483 theta``.

    Inferred from the source's printed examples (derived); tf = td/10 is added.

    Parameters
    ----------
    model
        Integrating process; half of a lag counts as dead time.

    Returns
    -------
    Settings
        Standard form, set-point weights b = c = 0.

    Raises
    ------
    ValueError
        For a self-regulating process, or one without dead time.

    References
    ----------
    Chakraborty, Ghosh and Naskar 2017, as compared in Kaya 2018, IFAC PID'18.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> settings = chakraborty(IntegratingModel(gain=0.05, dead_time=4.0))
    >>> f"kp = {settings.kp:.4g}, ti = {settings.ti:.4g} s, td = {settings.td:.4g} s"
    'kp = 4.218, ti = 14.22 s, td = 1.932 s'
    """
    process = ipdt(model)
    theta: FloatOrArray = process.dead_time
    return with_filter(Settings(0.8435 / (process.gain * theta), 3.555 * theta, 0.483 * theta, b=0.0, c=0.0))
