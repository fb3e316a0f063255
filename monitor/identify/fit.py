"""A fit: a model of the process with its uncertainty; which of two is believed, and what several say together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from monitor.contract.samples import Array
from tuners.models import INTEGRATING, SELF_REGULATING

DIRECT, INDIRECT, JOINT = "direct", "indirect", "joint"

DECIDES_LN = 6.0
"""Difference of log-likelihoods (in effective samples) from which one kind of process is believed: 1 to 400."""
SIMPLER_LN = 2.0
"""The same for an integrating one: with a long lag a self-regulating one would explain as much, so the short lag
that was found for it is less likely yet."""
EXCLUDED_LN = 3.0
"""The same, by which a kind of process has to be less likely before settings need not be safe for it."""
ALIKE_DEAD_TIMES = 8.0
"""Lag, in dead times, from which SIMC's integral time is that for an integrating process (Skogestad 2003)."""
Z95 = 1.96


@dataclass(frozen=True, eq=False, slots=True)
class Valley:
    """Models of one window along which the likelihood falls off slowly, on a way that is not straight."""

    models: Array
    """(k, 4) gain, lag, dead time, second lag [s]."""
    deficit: Array
    """(k,) squared sigmas by which each is less likely than the best."""
    across: Array
    """(3, 3) covariance of (ln |gain|, lag, dead time) by the residuals, at each of them."""


@dataclass(frozen=True, eq=False, slots=True)
class Load:
    """A load at the process input that is no step at the event's begin."""

    size: float
    """[OP]"""
    onset: float
    """From the window's time zero [s]."""
    width: float
    """Time within which it comes [s]."""
    shape: int
    """`RAMP` or `LAG` of `response`."""


@dataclass(frozen=True, eq=False, slots=True)
class Wander:
    """Noise that goes on: white noise with a walk beside it, as a load that wanders makes it."""

    order: int
    """1: PV's level walks, 2: its trend."""
    ratio: float
    """Variance that the walk gains in a second, in variances of the white noise."""


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """A half-rule model with its uncertainty."""

    process: str
    gain: float
    """[PV/(OP s)] integrating, [PV/OP] self-regulating."""
    lag: float
    """[s]"""
    dead_time: float
    """Effective dead time [s]."""
    lag2: float
    """Second lag of a self-regulating process, else 0 [s]."""
    scatter: Array
    """(3, 3) covariance of (ln |gain|, lag, dead time) by the residuals."""
    floor: Array
    """(3,) variances to add for model mismatch, which more data do not reduce."""
    quality: float
    """1 - residual variance / PV variance over the window; the residuals are white where a load wanders (`Wander`)."""
    log_likelihood: float
    """-n_eff/2 ln(residual variance), of a model with two lags where there is one: to compare fits of a window."""
    sigma: float
    """Standard deviation of the residuals [PV]."""
    n_eff: float = 1.0
    """Independent points of which the likelihood is."""
    size: float | None = None
    """Size Ad of the load step at the process input [OP]; None for a set-point step."""
    onset: float | None = None
    """When the load stepped, from the window's time zero [s]."""
    other: Load | None = None
    """The load as it came, where that was not at once; of a set-point step: one that came beside it."""
    start: float = 0.0
    """What PV still moved by when the window began, where the loop was not at rest [PV]; it dies away with the lag."""
    wander: Wander | None = None
    """What PV's noise is beside white, where that was looked for and found."""
    leaves_more: bool = False
    """More is left of PV than the noise before the event, or was, before a load of another shape was found."""
    valley: Valley | None = None
    """Where no covariance describes the models that the data allow: of a self-regulating process."""
    method: str = DIRECT
    """``direct`` (from OP as measured), ``indirect`` (closed loop simulated) or ``joint`` (several events)."""
    extra_delay: float = 0.0
    """Dead time that the loop's controller adds to the process: PV filter, late OP, half of a slow execution [s]."""
    doubt: float = 0.0
    """Variance of ln |gain| to add to what is said of it, where process or load may be of another kind than the
    model's. Not part of `cov`: settings are kept safe against that by other means than the gain's interval."""

    @property
    def beside_loads(self) -> bool:
        """Whether part of PV's movement is that of a load: one of another shape, or one that wanders."""
        return self.other is not None or self.wander is not None

    @property
    def t0(self) -> float:
        """Sum of lags and dead time [s]."""
        return self.lag + self.lag2 + self.dead_time

    @property
    def cov(self) -> Array:
        """(3, 3) covariance of (ln |gain|, lag, dead time), mismatch included."""
        return self.scatter + np.diag(self.floor)

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of ``gain``, ``lag``, ``dead_time`` or ``t0``."""
        if name == "gain":
            return self._gain_within(Z95 * math.sqrt(self.cov[0, 0]))
        weights = {"lag": (0.0, 1.0, 0.0), "dead_time": (0.0, 0.0, 1.0), "t0": (0.0, 1.0, 1.0)}
        low, high = self._about(name, np.array(weights[name]))
        if name != "t0":  # neither part of T0 is below 0, so the other is not above it
            high = min(high, max(self._about("t0", np.array(weights["t0"]))[1] - self.lag2, low))
        return low, high

    def told(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of `interval`, of the gain with its doubt."""
        if name == "gain":
            return self._gain_within(Z95 * math.sqrt(self.cov[0, 0] + self.doubt))
        return self.interval(name)

    def _gain_within(self, half: float) -> tuple[float, float]:
        ends = self.gain * math.exp(-half), self.gain * math.exp(min(half, 700.0))
        return min(ends), max(ends)

    def _about(self, name: str, weights: Array) -> tuple[float, float]:
        half = Z95 * math.sqrt(max(float(weights @ self.cov @ weights), 0.0))
        value = float(getattr(self, name))
        return max(value - half, 0.0), value + half


def decide(fits: list[Fit], span: float) -> tuple[Fit | None, bool]:
    """Return the better of the fits of one window, and whether it is better beyond doubt.

    A self-regulating model with a long lag is an integrating one, so it never explains less: it is believed
    only where it explains more. Where it does not, and its lag is so long that it would be tuned as an
    integrating process anyway, the process is called integrating.

    Parameters
    ----------
    fits
        One for each kind of process.
    span
        Length of the window [s]: a self-regulating process whose lag is longer than two of them has shown
        nothing but its slope.
    """
    if len(fits) < 2:
        return (fits[0], True) if fits else (None, False)
    integrating = max((f for f in fits if f.process == INTEGRATING), key=lambda f: f.log_likelihood)
    regulating = max((f for f in fits if f.process == SELF_REGULATING), key=lambda f: f.log_likelihood)
    better = better_by(
        regulating.log_likelihood, regulating.n_eff, integrating.log_likelihood, integrating.n_eff
    )
    if better >= DECIDES_LN and regulating.lag <= 2.0 * span:
        return regulating, True
    alike = regulating.lag > min(2.0 * span, ALIKE_DEAD_TIMES * (regulating.dead_time + regulating.lag2 / 2))
    if better <= -SIMPLER_LN or alike:
        return integrating, True
    return (integrating if better < 0 else regulating), False


def better_by(one: float, n_one: float, other: float, n_other: float) -> float:
    """By how much one log-likelihood exceeds another, each of so many points, over those of the poorer one."""
    return min(n_one, n_other) * (one / n_one - other / n_other)


def rivals_of(fit: Fit, others: list[Fit]) -> tuple[Fit, ...]:
    """Return the models of the other kind of process that a window does not exclude beside the one believed.

    Their gain is of the same sign, and they are not clearly less likely.

    Parameters
    ----------
    fit
        The one believed.
    others
        Those of the other kind of process, of the same window.
    """
    return tuple(
        other
        for other in others
        if other.process != fit.process
        and other.gain * fit.gain > 0
        and better_by(other.log_likelihood, other.n_eff, fit.log_likelihood, fit.n_eff) > -EXCLUDED_LN
    )


def combine(fits: list[Fit]) -> Fit:
    """Return one model for several events of a loop: the information-weighted mean of (ln |gain|, lag, dead time).

    All fits are of one kind of process and one sign of gain. Scatter shrinks with the number of events, the
    floor for model mismatch does not. A weighted mean, not a fit to all windows together.
    """
    if len(fits) == 1:
        return fits[0]
    weights = [np.linalg.inv(f.cov) for f in fits]
    together = np.linalg.inv(np.sum(weights, axis=0))
    # half a second lag counts as lag, half as dead time, as in the covariance
    each = [np.array([math.log(abs(f.gain)), f.lag + f.lag2 / 2, f.dead_time + f.lag2 / 2]) for f in fits]
    mean = together @ np.sum([w @ x for w, x in zip(weights, each, strict=True)], axis=0)
    half = min(float(np.mean([f.lag2 for f in fits])) / 2, max(mean[1] / 2, 0.0), max(mean[2], 0.0))
    # how much each event counts for each figure, so that one which knows little takes nothing from the others
    shares = np.array([np.clip(np.diag(together @ w), 0.0, None) for w in weights])
    floor = (np.sum(shares * [np.sqrt(f.floor) for f in fits], axis=0) / np.sum(shares, axis=0)) ** 2
    doubt = float(shares[:, 0] @ [math.sqrt(f.doubt) for f in fits] / np.sum(shares[:, 0])) ** 2
    best = max(fits, key=lambda f: f.quality)
    return replace(
        best,
        gain=math.copysign(math.exp(mean[0]), best.gain),
        lag=max(float(mean[1]) - half, 0.0),
        dead_time=max(float(mean[2]) - half, 0.0),
        lag2=2.0 * half,
        scatter=together,
        floor=floor,
        doubt=doubt,
        valley=None,
        method=JOINT,
        extra_delay=fits[-1].extra_delay,
    )


def contradictory(fits: list[Fit], joint: Fit) -> bool:
    """Whether an event's gain lies so far from the joint model that chance cannot explain it (4 sigma, 20 %)."""
    for fit in fits:
        if fit.gain * joint.gain < 0:
            return True
        sigma = math.sqrt(fit.cov[0, 0] + joint.cov[0, 0])
        if abs(math.log(fit.gain / joint.gain)) > max(4.0 * sigma, 0.2):
            return True
    return False


SAME_LN, SAME_T0_SHARE = 0.15, 0.25
"""Difference in ln gain, and of T0 as a share of it, within which two models are the same process."""


def same_process(one: Fit, other: Fit) -> bool:
    """Whether two models of a loop, of one kind, confirm each other: their gains and their T0 are alike."""
    if one.gain * other.gain <= 0:
        return False
    longest = max(one.t0, other.t0)
    alike = abs(one.t0 - other.t0) <= SAME_T0_SHARE * longest
    return alike and abs(math.log(one.gain / other.gain)) <= SAME_LN
