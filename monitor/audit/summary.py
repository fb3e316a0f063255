"""What an audit comes to: how many loops of each kind, the jobs in the order of their danger, what was not judged.

Facts in, facts out: plain records that a report draws, with nothing left to be found out.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from monitor.contract.danger import danger, kind_of
from monitor.contract.records import GOOD, RETUNE, LoopRow
from monitor.contract.summary import KINDS, Job, Remedy, Summary
from monitor.contract.text import duration

TUNER, VALVE_SHOP, OPERATOR, HISTORIAN, INSTRUMENTS = (
    *("tuner", "valve shop", "operator", "historian", "instrument shop"),
)
"""Who does a job."""
WHO = {
    "stiction": VALVE_SHOP,
    "no_response": VALVE_SHOP,
    "stuck_pv": INSTRUMENTS,
    "mapping_suspect": HISTORIAN,
    "undersampled": HISTORIAN,
    "two_valued_op": HISTORIAN,
    "settings_mismatch": TUNER,
    "offset": TUNER,
    "no_integral": TUNER,
    "saturated": OPERATOR,
    "oscillating": OPERATOR,
    "manual": OPERATOR,
    "stale": HISTORIAN,
    "compressed": HISTORIAN,
    "exception_reported": HISTORIAN,
}
"""By flag; the first that a loop has names its job, where it is not to be retuned."""
NO_RISK = {
    VALVE_SHOP: "little: the valve is stroked in manual for some minutes",
    OPERATOR: "none, or little: nothing is set",
    HISTORIAN: "none for the plant",
    INSTRUMENTS: "the loop is in manual meanwhile",
    TUNER: "none while nothing is typed in",
}
WORTH_OVERSHOOT = 0.1
"""By which an overshoot must shrink to be named, as a share of the step."""
WORTH_A_WORD = 1.05
"""Ratio of errors from which a loop that becomes slower is said to."""
MANY_JOBS = 3
"""Loops with one remedy from which that is one job, of the historian say."""
GROUPED = (HISTORIAN, "manual")
TITLES = {
    "valve": "Check the valve",
    "oscillating": "Find what makes it cycle",
    "manual": "Ask why it is in manual",
    "unclear": "Make it judgeable",
}
"""By kind."""
INTEGRAL_WORDS = "lengthen the integral time"
"""How the action begins where a cycle is the integral action's own."""
FLAG_TITLES = {
    "stuck_pv": "Check the transmitter",
    "mapping_suspect": "Check its tags",
    "undersampled": "Sample it faster",
    "compressed": "Export raw data",
    "exception_reported": "Export raw data",
    "stale": "Find out why its samples ended",
    "saturated": "Look for the bottleneck",
    "settings_mismatch": "Compare its settings with the faceplate",
    "two_valued_op": "Record the controller's demand",
    "offset": "Look for the integral action",
    "no_integral": "Look for the integral action",
}


def summary_of(rows: Sequence[LoopRow]) -> Summary:
    """Sum up an audit's rows, which come worst first."""
    kinds = {row.loop: kind_of(row) for row in rows}
    counted = Counter(kinds.values())
    covered = [row.coverage for row in rows if row.coverage is not None]
    return Summary(
        counts={kind: counted[kind] for kind in KINDS},
        kinds=kinds,
        jobs=tuple(_jobs(rows, kinds)),
        remedies=tuple(_remedies(row for row in rows if kinds[row.loop] == "unclear")),
        coverage=sum(covered) / len(covered) if covered else None,
        near_instability=sum("near_instability" in row.flags for row in rows),
    )


def _jobs(rows: Sequence[LoopRow], kinds: dict[str, str]) -> Iterable[Job]:
    """Return jobs by danger; retunes of one danger by what they bring; one remedy for many loops as one job."""
    every = [_retune(row) if row.verdict == RETUNE else _other(row, kinds[row.loop]) for row in rows]
    order = {row.loop: (danger(row), 0.0 if danger(row) == 0 else -_gain(row)) for row in rows}
    jobs = [job for job in every if job is not None]
    together: dict[tuple[str, str], list[Job]] = {}
    for job in jobs:
        if job.who in GROUPED or job.kind in GROUPED:
            together.setdefault((job.who, _same(job.what)), []).append(job)
    alike = {id(job): group for group in together.values() if len(group) >= MANY_JOBS for job in group}
    merged = [
        _merged(alike[id(job)]) if id(job) in alike else job
        for job in jobs
        if id(job) not in alike or job is alike[id(job)][0]
    ]
    return sorted(merged, key=lambda job: order[job.loops[0]])


def _merged(jobs: list[Job]) -> Job:
    """Return jobs that have one remedy as one."""
    return replace(jobs[0], loops=tuple(name for job in jobs for name in job.loops))


def _same(text: str) -> str:
    """Return words without their figures: two jobs that differ in those alone are alike."""
    return re.sub(r"\d[\d.,e+-]*", "#", text)


def _retune(row: LoopRow) -> Job:
    close = "near_instability" in row.flags
    title = "Slow it down: near instability" if close else "Retune"
    if row.new_kp is None:
        title, benefit, risk = f"{title}, by hand", "not known: no safe settings were found", "not known"
    else:
        benefit, risk = benefit_of(row), risk_of(row)
    return Job((row.loop,), RETUNE, TUNER, title, row.action, row.reason, benefit, risk)


def _other(row: LoopRow, kind: str) -> Job | None:
    flag = next((f for f in WHO if f in row.flags), None)
    if flag is None or kind == GOOD or not row.action or row.action.startswith("none"):
        return None
    who, title = WHO[flag], TITLES[kind] if kind != "unclear" else FLAG_TITLES.get(flag, TITLES[kind])
    if kind == "oscillating" and row.action.startswith(INTEGRAL_WORDS):
        who, title = TUNER, "Lengthen its integral time"
    return Job((row.loop,), kind, who, title, row.action, row.reason, _worth_of(row, flag), NO_RISK[who])


def _gain(row: LoopRow) -> float:
    """Return which share of the predicted error a retune takes away; the larger of both kinds of step."""
    return max((1.0 - new / now for _, now, new in _errors(row)), default=0.0)


def benefit_of(row: LoopRow) -> str:
    """Say what a retune is predicted to bring: errors after steps today and then, or the way from instability."""
    said = []
    if "near_instability" in row.flags and row.ms is not None and row.new_ms is not None:
        today = f"{row.ms:.2f}" if math.isfinite(row.ms) else "unstable"
        said.append(f"safe again: Ms {today} → {row.new_ms:.2f}")
    if row.overshoot is not None and (row.new_overshoot or 0.0) < row.overshoot - WORTH_OVERSHOOT:
        said.append(f"overshoot {row.overshoot:.0%} → {row.new_overshoot or 0.0:.0%}")
    said += [f"error after a {name} {_change(now, new)}" for name, now, new in _errors(row) if new < now]
    return "; ".join(said) or ("not known" if row.new_ci is None else f"index about {row.new_ci:.2f}")


def _errors(row: LoopRow) -> list[tuple[str, float, float]]:
    """Return the predicted errors, today and after the retune, that are known: kind of step, both."""
    pairs = (
        ("load step", row.iae_load, row.new_iae_load),
        ("set-point step", row.iae_setpoint, row.new_iae_setpoint),
    )
    return [(n, a, b) for n, a, b in pairs if a and b is not None and math.isfinite(a) and math.isfinite(b)]


def _change(now: float, new: float) -> str:
    """Say how an error changes."""
    times = (
        f"{new / now:.2g} times"
        if new >= 2.0 * now
        else f"{'−' if new < now else '+'}{abs(new / now - 1):.0%}"
    )
    return f"{times} ({now:.3g} → {new:.3g})"


def risk_of(row: LoopRow) -> str:
    """Say what a retune risks, by the worst model that the evidence allows."""
    worst = (
        "low"
        if row.new_ms_worst is None
        else f"low: Ms at most {row.new_ms_worst:.2f} for all that the data allow"
    )
    parts = (
        "; a part of the way, the rest after an event confirms it"
        if (row.stages or "").count("kp") > 1
        else ""
    )
    slower = [f"error after a {n} {_change(a, b)}" for n, a, b in _errors(row) if b > WORTH_A_WORD * a]
    price = f"costs speed: {', '.join(slower)}; " if slower else ""
    return f"{price}{worst}{parts}"


def _worth_of(row: LoopRow, flag: str) -> str:
    """Say what is won by a job that is no retune."""
    period = row.oscillation_period
    if flag in {"stiction", "oscillating"} and period:
        wear = "" if row.travel_per_hour is None else f"; OP travels {row.travel_per_hour:.3g} [OP/h] now"
        return f"ends a cycle of {duration(period)}{wear}"
    if flag == "manual":
        return "the loop controls again"
    if flag == "saturated" and row.saturation is not None:
        return f"control for the {row.saturation:.0%} of the time at the limit"
    return "the loop can be judged, and tuned where it needs it"


def _remedies(rows: Iterable[LoopRow]) -> list[Remedy]:
    """Return what would make loops judgeable, the remedy for the most first."""
    alike: dict[str, list[LoopRow]] = {}
    for row in rows:
        alike.setdefault(_same(row.action) or "none", []).append(row)
    found = [Remedy(g[0].action or "none", g[0].reason, tuple(r.loop for r in g)) for g in alike.values()]
    return sorted(found, key=lambda r: (-len(r.loops), r.what))
