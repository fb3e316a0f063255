"""Tuning rules by name, each with its source: `RULES`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tuners.classic import cluett_wang, di_ruscio, fruehauf, shinskey
from tuners.imc import (
    first_order_time,
    imc_pi,
    imc_pid,
    imc_pid_filter,
    imc_pid_first_order,
    imc_pid_series,
    imc_pid_series_filter,
    lambda_pi,
    lambda_time,
    rice_cooper_time,
)
from tuners.kaya import chakraborty, kaya_ist2e, kaya_ist2e_exact, kaya_iste, kaya_iste_exact
from tuners.levels import averaging
from tuners.models import INTEGRATING, SELF_REGULATING, FloatOrArray, Model
from tuners.reaction_curve import (
    amigo,
    amigo_pi,
    cohen_coon,
    cohen_coon_pi,
    ziegler_nichols_step,
    ziegler_nichols_step_pi,
)
from tuners.settings import Settings
from tuners.simc import simc_pd, simc_pi, simc_pi_improved, simc_pid
from tuners.ultimate import luyben_pid, tyreus_luyben, ziegler_nichols, ziegler_nichols_pi

BOTH = (INTEGRATING, SELF_REGULATING)


@dataclass(frozen=True, slots=True)
class Rule:
    """A tuning rule: ``function(model, **parameters) -> Settings``.

    Parameters
    ----------
    function
        The rule; a model first, then the extra parameters by name.
    source
        Author, year, place; "derived" where a formula was derived again.
    structure
        'PI', 'PD', 'PID' or 'I-PD'.
    form
        Form of the settings that the function returns.
    processes
        Kinds of process that it takes.
    parameters
        Names of the extra parameters.
    required
        Those of them that have no default.
    arrays
        Whether the rule takes models with array fields.
    default_time
        The closed-loop time that its source gives it [s], of the model; None where there is none, or where it is the
        dead time, as with SIMC.

    Examples
    --------
    >>> from tuners.models import IntegratingModel
    >>> rule = RULES["simc-pi"]
    >>> rule.structure, rule.form, rule.parameters
    ('PI', 'standard', ('closed_loop_time',))
    >>> rule.function(IntegratingModel(gain=0.05, dead_time=4.0), closed_loop_time=6.0).kp
    2.0
    """

    function: Callable[..., Settings]
    source: str
    structure: str
    form: str
    processes: tuple[str, ...]
    parameters: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    arrays: bool = True
    default_time: Callable[[Model], FloatOrArray] | None = None


SIMC = "Skogestad 2003, J. Process Control 13, 291-309"
VV10 = "Veronesi & Visioli 2010, J. Process Control 20, 261-269"
RC02 = "Rice & Cooper 2002, ISA (after Chien & Fruehauf 1990)"
ZN42 = "Ziegler & Nichols 1942, Trans. ASME 64, 759-768"
KA18 = "Kaya 2018, IFAC PID'18"
AH06 = "Åström & Hägglund 2006, Advanced PID Control"
CC53 = "Cohen & Coon 1953, Trans. ASME 75, 827-834"
BY_TIME = ("closed_loop_time",)


def _rule(
    function: Callable[..., Settings],
    source: str,
    structure: str,
    form: str = "standard",
    processes: tuple[str, ...] = (INTEGRATING,),
    parameters: tuple[str, ...] = (),
    required: tuple[str, ...] = (),
    arrays: bool = True,
) -> Rule:
    return Rule(function, source, structure, form, processes, parameters, required, arrays)


def _rice_cooper(function: Callable[..., Settings], form: str = "standard", structure: str = "PID") -> Rule:
    return Rule(function, RC02, structure, form, (INTEGRATING,), BY_TIME, default_time=rice_cooper_time)


RULES: dict[str, Rule] = {
    "simc-pi": _rule(simc_pi, f"{SIMC}; {VV10}", "PI", processes=BOTH, parameters=BY_TIME),
    "simc-pid": _rule(simc_pid, f"{SIMC}; {VV10}", "PID", "series", BOTH, BY_TIME),
    "simc-pd": _rule(simc_pd, VV10, "PD", "series", BOTH, BY_TIME),
    "simc-pi-improved": _rule(
        simc_pi_improved,
        "Grimholt & Skogestad 2012, IFAC PID'12",
        "PI",
        processes=(SELF_REGULATING,),
        parameters=BY_TIME,
    ),
    "imc-pi": _rice_cooper(imc_pi, structure="PI"),
    "imc-pid": _rice_cooper(imc_pid),
    "imc-pid-series": _rice_cooper(imc_pid_series, "series"),
    "imc-pid-filter": _rice_cooper(imc_pid_filter),
    "imc-pid-series-filter": _rice_cooper(imc_pid_series_filter, "series"),
    "imc-pid-first-order": Rule(
        imc_pid_first_order,
        "Rivera, Morari & Skogestad 1986, IEC Proc. Des. Dev. 25, 252-265",
        "PID",
        "standard",
        (SELF_REGULATING,),
        BY_TIME,
        default_time=first_order_time,
    ),
    "lambda-pi": Rule(
        lambda_pi,
        f"Dahlin 1968; Chien & Fruehauf 1990; default {AH06}",
        "PI",
        "standard",
        BOTH,
        BY_TIME,
        default_time=lambda_time,
    ),
    "di-ruscio": _rule(
        di_ruscio,
        "Di Ruscio 2010, Modeling, Identification and Control 31, 145-164 (derived)",
        "PI",
        parameters=("delta", "c"),
    ),
    "kaya-iste": _rule(kaya_iste, f"{KA18} (ti, td derived)", "I-PD"),
    "kaya-ist2e": _rule(kaya_ist2e, f"{KA18} (derived)", "I-PD"),
    "kaya-iste-exact": _rule(
        kaya_iste_exact, f"{KA18}, its optimum computed anew (derived)", "I-PD", arrays=False
    ),
    "kaya-ist2e-exact": _rule(
        kaya_ist2e_exact, f"{KA18}, its optimum computed anew (derived)", "I-PD", arrays=False
    ),
    "chakraborty": _rule(
        chakraborty, f"Chakraborty et al. 2017, inferred from examples in {KA18} (derived)", "I-PD"
    ),
    "tyreus-luyben": _rule(
        tyreus_luyben, "Tyreus & Luyben 1992, IEC Res. 31, 2625-2628", "PI", processes=BOTH
    ),
    "luyben-pid": _rule(luyben_pid, "Luyben 1996, IEC Res. 35, 3480-3483", "PID", processes=BOTH),
    "ziegler-nichols": _rule(ziegler_nichols, f"{ZN42}, ultimate gain", "PID", processes=BOTH),
    "ziegler-nichols-pi": _rule(ziegler_nichols_pi, f"{ZN42}, ultimate gain", "PI", processes=BOTH),
    "ziegler-nichols-step": _rule(ziegler_nichols_step, f"{ZN42}, reaction curve", "PID", processes=BOTH),
    "ziegler-nichols-step-pi": _rule(
        ziegler_nichols_step_pi, f"{ZN42}, reaction curve", "PI", processes=BOTH
    ),
    "cohen-coon": _rule(cohen_coon, CC53, "PID", processes=(SELF_REGULATING,)),
    "cohen-coon-pi": _rule(cohen_coon_pi, CC53, "PI", processes=(SELF_REGULATING,)),
    "amigo": _rule(
        amigo, f"Åström & Hägglund 2004, J. Process Control 14, 635-650; {AH06}", "PID", processes=BOTH
    ),
    "amigo-pi": _rule(amigo_pi, f"{AH06}, eq. 7.5", "PI", processes=BOTH),
    "fruehauf": _rule(fruehauf, "Fruehauf, Chien & Lauritsen 1993, ISA", "PI"),
    "shinskey": _rule(shinskey, "Shinskey 1994, Feedback Controllers for the Process Industries", "PI"),
    "cluett-wang": _rule(cluett_wang, "Wang & Cluett 1997, IEE Proc. CTA 144, 385-392", "PID"),
    "averaging": _rule(
        averaging,
        "Cheung & Luyben 1979, IEC Fundam. 18, 15-21; damping derived",
        "PI",
        parameters=("max_load", "max_deviation"),
        required=("max_load", "max_deviation"),
    ),
}
