"""The search for safe settings: a rule's settings from fast to slow, and the first of them that keep to all limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.assess.reference import LEAST_TC_PERIODS, reference_settings, reference_structure
from monitor.contract.loops import Loop
from monitor.contract.records import SETPOINT
from monitor.contract.samples import Array
from tuners.models import Model
from tuners.robustness import peak_sensitivity
from tuners.rules import RULES
from tuners.settings import FILTER_RATIO, Settings

from .region import fastest_safe
from .stages import rounded

SLOWEST_RATIO = 64.0
"""The closed-loop time is raised at most by this factor in search of a safe suggestion."""
TIME_COUNT = 97
"""Closed-loop times that are looked at: 4.4 % from one to the next."""
FURTHEST_RATIO = 10.0
"""A suggestion changes the gain by at most this factor: the evidence was seen with the settings of today."""
RESET_SHARES = [1.0, 0.85, 0.7, 0.6]
"""Factors on the rule's integral time. ``Kc K Ti`` is 4 by the rule and so 2.4 at least, as in the tightest
well-damped published rules (Fruehauf 1993: 2.5); below 2 an integrator rolls."""
LEAD_SHARES = [0.5, 0.25, 0.1]
"""Factors on the rule's derivative time, where noise on OP limits a suggestion."""
LEAST_TD_PERIODS = 0.1
"""Sample periods below which a derivative time does nothing."""
TOO_NOISY = "PV's noise"
"""How the limit of noise begins to be said."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What every suggestion for a loop has to keep to."""

    loop: Loop
    region: Model
    """Models that the evidence allows, sampled as the loop is; fields (M, 1)."""
    noise: float
    """Standard deviation of PV's noise [PV]."""
    period: float
    """[s]"""

    def broken(self, many: Settings) -> list[tuple[str, NDArray[np.bool_]]]:
        """Return for each limit but Ms what is wrong where it is broken, and where that is: like ``many``'s fields."""
        limits = []
        if self.loop.op_span is not None:
            allowed = self.loop.op_noise_max / 100.0 * self.loop.op_span
            loud = op_noise(many, self.noise, self.period) > allowed
            limits.append((f"{TOO_NOISY} would put more than {self.loop.op_noise_max:g} % on OP", loud))
        if self.loop.kp is not None:
            ratio = np.abs(np.asarray(many.kp) / self.loop.kp)
            far = (ratio > FURTHEST_RATIO) | (ratio < 1.0 / FURTHEST_RATIO)
            limits.append((f"the gain would change more than {FURTHEST_RATIO:g} times at once", far))
        return limits

    def too_sensitive(self) -> str:
        """Say that no settings are safe."""
        return f"Ms stays above {self.loop.ms_max:g} for the worst model inside the intervals"

    def worst(self, settings: Settings) -> tuple[float, float]:
        """Ms on the model found and on the worst one, exact."""
        peaks = np.ravel(peak_sensitivity(self.region, settings))
        return float(peaks[0]), float(np.max(peaks))

    def kept_by(self, settings: Settings, peaks: tuple[float, float]) -> bool:
        """Whether settings, with Ms on the model found and on the worst one, keep to all limits."""
        return not peaks[1] > self.loop.ms_max and not self.breaks(settings)

    def breaks(self, settings: Settings) -> bool:
        """Whether settings break another limit than Ms."""
        return any(np.any(where) for _, where in self.broken(settings))


@dataclass(eq=False, slots=True)
class Search:
    """Candidates of a rule, (R, T) from fast to slow along T, and how far along each row the search has come."""

    limits: Limits
    times: Array
    """tc (T,) [s]; NaN for a rule without."""
    many: Settings
    at: dict[int, int]
    """Row to column of the first candidate that keeps to all limits; rows without one are left out."""
    failing: str
    """Which limits leave nothing over, where ``at`` is empty."""
    loud: bool
    """Noise on OP keeps a row from its fastest safe candidate."""

    def typed(self) -> dict[int, Settings]:
        """Return the candidates where the rows stand, as one types them."""
        loop, period = self.limits.loop, self.limits.period
        return {row: typed(loop, pick(self.many, row, k), period) for row, k in self.at.items()}

    def slower(self, row: int) -> None:
        """Go on to the next candidate of a row; a row at its end is given up."""
        self.at[row] += 1
        if self.at[row] >= len(self.times):
            del self.at[row]
            self.failing = self.limits.too_sensitive()


def search(limits: Limits, times: Array, rule: Settings) -> Search:
    """Find in each row of a rule's settings (R, T) the first that keep to all limits."""
    many = in_form(limits.loop, rule)
    first = fastest_safe(limits.region, many, limits.loop.ms_max)
    columns = np.arange(len(times))
    unsafe = columns[None, :] < first[:, None]
    reasons = [(limits.too_sensitive(), unsafe), *limits.broken(many)]
    fits = ~np.any([broken for _, broken in reasons], axis=0)
    at = {row: int(np.argmax(fits[row])) for row in range(len(fits)) if fits[row].any()}
    never = [why for why, broken in reasons if broken.all()]
    failing = "; ".join(never or [why for why, broken in reasons if broken.any()])
    loud = any(bool(np.any(broken & ~unsafe)) for why, broken in reasons if why.startswith(TOO_NOISY))
    return Search(limits, times, many, at, failing, loud)


def reference_candidates(
    loop: Loop, model: Model, structure: str, times: Array, loud: bool = False
) -> Settings:
    """Return the reference rule for closed-loop times (T,) with several integral, and derivative, times (R, T).

    The rule ties its integral time to tc: ``Ti = 4 (tc + theta)``, or the lag where that is shorter. What makes a
    suggestion slow is mostly an uncertain gain or dead time, for which tc is raised; the integral action is not what
    endangers the worst model then, but a load's error is ``Ti/|Kc|`` and so grows with the *square* of tc + theta.
    So the integral time may be shorter than the rule's by the factors `RESET_SHARES` (derived: a coarse form of
    maximising ``Kc/Ti`` under a limit on Ms, Åström, Panagopoulos & Hägglund 1998). A set-point step gains nothing by
    it.

    The derivative time is the lag that it cancels; its action is also what carries most of PV's noise to OP. Where
    that limits a suggestion (``loud``), less of the lag is cancelled, by the factors `LEAD_SHARES`, for more gain.
    """
    rule = reference_settings(model, structure, times)
    resets = [1.0] if structure in {"p", "pd"} or loop.objective == SETPOINT else RESET_SHARES
    ways = [(reset, 1.0) for reset in resets]
    if loud and structure in {"pd", "pid"}:
        ways += [(reset, lead) for lead in LEAD_SHARES for reset in resets[::2]]
    reset, lead = (column[:, None] for column in np.array(ways).T)
    kp, ti, td, tf = np.broadcast_arrays(rule.kp, reset * rule.ti, lead * rule.td, lead * rule.tf)
    return Settings(kp, ti, td, tf, rule.form)


def named_candidates(limits: Limits, name: str, model: Model, times: Array) -> tuple[Array, Settings]:
    """Return a rule of `RULES` by name: closed-loop times (T,) and settings (1, T); T = 1 for a rule without tc.

    The times begin at the one that the loop table asks for, else at the rule's own: a paper's settings are those at
    its closed-loop time, and one who names the rule means these.
    """
    rule = RULES[name]
    if "closed_loop_time" in rule.parameters:
        if rule.default_time is not None and limits.loop.closed_loop_time is None:
            fastest = max(float(rule.default_time(model)), LEAST_TC_PERIODS * limits.period)
            times = times * (fastest / times[0])
        made = rule.function(model, closed_loop_time=times)
    else:
        times, made = np.array([math.nan]), rule.function(model)
    kp, ti, td, tf = (np.broadcast_to(x, (1, len(times))) for x in (made.kp, made.ti, made.td, made.tf))
    return times, Settings(kp, ti, td, tf, made.form)


def rule_mismatch(loop: Loop, process: str) -> str:
    """Say why the rule that the loop table names is not for this loop; empty where it is, or where none is named.

    Parameters
    ----------
    process
        Kind of process; ``auto`` where it is not known.
    """
    if not loop.rule or (loop.rule == "averaging" == loop.objective):
        return ""
    rule, structure = RULES[loop.rule], reference_structure(loop)
    if loop.objective == "averaging":
        return "the objective averaging has a rule of its own"
    if rule.required:
        return f"it is for loops whose objective is {loop.rule}"
    # an I-PD is a PID with weights 0
    kind = "pid" if rule.structure == "I-PD" and loop.b == loop.c == 0.0 else rule.structure.lower()
    if kind != structure:
        known = loop.controller or loop.kp is not None
        this = "this loop is" if known else "a loop without settings is taken for"
        return f"it is for {rule.structure}, {this} a {structure.upper()}"
    if process != "auto" and process not in rule.processes:
        return f"it is for {' or '.join(rule.processes)} processes, this one is {process}"
    return ""


def in_form(loop: Loop, rule: Settings) -> Settings:
    """Return a rule's settings in the loop's form, with its filter ratio (ten where it has none) and weights."""
    made = rule.to(loop.canonical_form)
    ratio = loop.td / loop.filter_time if loop.td > 0 and loop.filter_time > 0 else FILTER_RATIO
    return Settings(made.kp, made.ti, made.td, made.td / ratio, made.form, loop.b, loop.c)


def typed(loop: Loop, settings: Settings, period: float) -> Settings:
    """Return settings, in the loop's form already, to the digits that one types; a useless derivative is none.

    Parameters
    ----------
    period
        Of the samples [s].
    """
    kp, ti, td = (rounded(float(x)) for x in (settings.kp, settings.ti, settings.td))
    td = td if td >= LEAST_TD_PERIODS * period else 0.0
    return in_form(loop, Settings(kp, ti, td, form=settings.form))


def pick(many: Settings, row: int, column: int) -> Settings:
    """Return one of the settings (R, T)."""
    kp, ti, td, tf = (float(np.asarray(x)[row, column]) for x in (many.kp, many.ti, many.td, many.tf))
    return Settings(kp, ti, td, tf, many.form, many.b, many.c)


def op_noise(settings: Settings, noise: float, period: float) -> Array:
    """Return the standard deviation of OP [OP] that white noise of PV [PV] causes through P and filtered D (derived).

    With the backward difference, ``g = td/(tf + period)`` and ``a = tf/(tf + period)``, the controller's
    response to one sample of noise is ``1 + g``, then ``-g (1 - a) a^(j-1)``; its squares sum to
    ``(1 + g)^2 + g^2 (1 - a)/(1 + a)``. The integral's share is small and left out.
    """
    standard = settings.to("standard")
    td, tf = np.asarray(standard.td), np.asarray(standard.filter_time)
    g, a = td / (tf + period), tf / (tf + period)
    power = (1.0 + g) ** 2 + g**2 * (1.0 - a) / (1.0 + a)
    return np.asarray(np.abs(standard.kp) * np.sqrt(power) * noise)
