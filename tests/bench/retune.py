"""The benchmark of the whole: held-out random fleets, one event each, suggestions judged on the true plants.

``python -m tests.bench.retune [--loops N] [--case NAME ...] [--seed S] [--worst N] [--json FILE]``: one table
row for each case, what misses its goal marked with ``!``.

Fleets (`retune_fleet`; all draws logarithmic and of either sign where a sign makes sense):

- *integrating*: gain 1e-4 to 1, dead time 1 to 100 s, 0 to 3 lags of 0.1 to 6.3 dead times each, 3 to 20
  samples per dead time. Settings: SIMC with tc = theta of the half-rule model, then 0.13 to 2.2 times the gain and 0.4
  to 5 times the reset; series, standard or parallel form, b = c = 1, filter td/10. As declared PID: td none, half
  or right. As PI: the rule on the model without retained lag.
- *self-regulating*: lag 1 to 30 dead times, a second one of 0 to 0.3 of the first, PI detuned in the same way.

Unstable draws are drawn again. One event after 100 to 150 quiet samples: a set-point step, or a load step at any
instant between samples. Records end when the response, without noise, has lain still as long as it moved, but after
3000 samples: slow detuned loops are cut off by the end of the data. Sigma of the noise is a share of the largest
deviation of PV without noise; the controller sees it. Bad data: 1 % noise, 2 % of the rows lost, 2 % repeated, one
value of 1 % of the rows NaN, PV in steps of 1/500 of the response. ``unknown``: no settings in the table (the form
is); ``auto``: kind of process not given. The loop table has no ranges, so the noise on OP is not limited.

The truth (`retune_truth`): Ms of the sampled loop, plant discretised exactly, with the filter suggested; CI by the
contract's reference for the structure declared (tc = max(theta, 3 periods), theta by the half rule) over the IAE
simulated without noise and limits. A loop needs retuning if its true CI for the kind of event lies below 0.5, or,
with known settings, its Ms above 3; it is cured if the first suggestion, what is typed in
now, brings that CI to 0.6 (the way on, event by event, is followed by `mismatch --campaign`). What is said of gain and
T0 is judged over all events whose record gives numbers; ``verif`` counts those with a verdict, ``other`` events that
nobody made. Milliseconds are processor time of one event's assessment and advice: ``direct`` where a direct fit was
all, ``full`` where a closed loop was simulated or settings were checked against the worst model. ``unst`` counts true
loops made unstable, PI turned into PID, and exceptions of the engine.

Default seed: for nothing but this benchmark. Develop with another one.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
from collections import Counter
from collections.abc import Iterable, Sequence

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # one event, one core

import numpy as np  # noqa: E402 (after the threads)

from monitor.contract.records import GOOD  # noqa: E402
from tests.bench.fleet_run import judged, write  # noqa: E402
from tests.bench.retune_fleet import CASES  # noqa: E402
from tests.bench.retune_judge import NERVOUS, Outcome, judge_many, turns_pi_into_pid  # noqa: E402

SEED = 20_100_261
"""Held out: named here and nowhere else."""
CHUNK = 20
MOST_MS = 2.5
HEAD = (
    f"{'case':13}{'loops':>6}{'found':>7}{'verif':>6}{'other':>6}{'need':>5}{'sugg':>5}{'unst':>6}{'Ms>2.5':>8}"
    f"{'worst':>7}{'cured':>8}{'gain err 50/95 %':>18}{'cover':>8}{'half':>7}{'T0 15%':>8}"
    f"{'ms direct 50/99':>17}{'full 50/99':>13}"
)


def main() -> None:
    """Run the cases asked for and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--loops", type=int, default=1000, help="loops per case")
    parser.add_argument("--case", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument(
        "--worst", type=int, default=0, help="describe this many of the worst loops of each case"
    )
    parser.add_argument("--json", help="write every outcome to this file, one line each")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    outcomes: list[Outcome] = []
    print(HEAD)
    for name, done in judged(judge_many, args.case, args.loops, CHUNK, args.jobs, args.seed):
        outcomes += done
        print(table_line(name, done), flush=True)
    for name in args.case:
        mine = [o for o in outcomes if o.case == name]
        print(f"\n{name}: {aside(mine)}; not cured, by cause:")
        for cause, count in causes(mine).most_common(12):
            print(f"{count:6d}  {cause}")
        for outcome in worst(mine)[: args.worst]:
            print(describe(outcome))
    if args.json:
        write(outcomes, args.json)


# ---------------------------------------------------------------------------------------------------
# figures


def table_line(name: str, done: Sequence[Outcome]) -> str:
    """One row of the table."""
    case = CASES[name]
    need = [o for o in done if o.needs]
    given = [o for o in done if o.ms_after is not None]
    ms = np.array([o.ms_after for o in given], dtype=float)
    over = share(ms > MOST_MS)
    worst_said = max((o.row["new_ms_worst"] for o in given), default=math.nan)
    bad = int(np.isinf(ms).sum()) + sum(turns_pi_into_pid(o) for o in given)
    bad += sum(bool(o.crash) for o in done)
    cured = share(o.cured for o in need)
    shown = [o for o in done if o.record.get("gain") is not None]
    error = [abs(o.record["gain"] / o.plant["gain"] - 1) for o in shown]
    middle, most = np.percentile(error, [50, 95]) if error else (math.nan, math.nan)
    cover = share(o.record["gain_lo"] <= o.plant["gain"] <= o.record["gain_hi"] for o in shown)
    half = np.median([half_width(o) for o in shown]) if shown else math.nan
    t0 = share(abs(o.record["t0"] / o.plant["t0"] - 1) <= 0.15 for o in shown)
    pure, exact = case.noise == 0, case.noise == 0 and not case.bad_data
    widest = {0.01: 0.05, 0.03: 0.10}.get(case.noise, math.inf)
    return (
        f"{name:13}{len(done):6d}{sum(o.events > 0 for o in done):7d}{sum(o.verified for o in done):6d}"
        f"{sum(o.others for o in done):6d}{len(need):5d}{len(given):5d}"
        f"{mark(bad, bad > 0, 'd'):>6}{mark(over, over > 0.01, '.1%'):>8}{mark(worst_said, worst_said > 2.2, '.2f'):>7}"
        f"{mark(cured, case.cured is not None and cured < case.cured, '.1%'):>8}"
        f"{mark(middle, exact and middle > 0.01, '.2%'):>9}{mark(most, exact and most > 0.03, '.1%'):>9}"
        f"{mark(cover, not pure and cover < 0.9, '.1%'):>8}{mark(half, half > widest, '.1%'):>7}"
        f"{mark(t0, t0 < 0.95, '.1%'):>8}{cost(done, False, 5.0):>17}{cost(done, True, 25.0):>13}"
    )


def share(values: Iterable[object]) -> float:
    """Share of what is true; NaN of nothing."""
    array = np.array([bool(v) for v in values])
    return float(array.mean()) if len(array) else math.nan


def half_width(outcome: Outcome) -> float:
    """Half-width of the gain's interval, as a share of the gain found."""
    record = outcome.record
    return abs((record["gain_hi"] - record["gain_lo"]) / record["gain"]) / 2


def cost(done: Sequence[Outcome], full: bool, goal: float) -> str:
    """Median and 99 % of the milliseconds of an event, full ones (indirect fit or worst-case check) or the others."""
    times = [1e3 * o.cost for o in done if o.events and o.full == full]
    if not times:
        return "-"
    middle, most = np.percentile(times, [50, 99])
    return f"{mark(middle, middle > goal, '.1f')} {mark(most, most > 100, '.0f')}"


def mark(value: float, missed: bool, form: str) -> str:
    """Write a figure, with ``!`` where it misses its goal."""
    return ("-" if math.isnan(value) else format(value, form)) + "!" * bool(missed)


# ---------------------------------------------------------------------------------------------------
# why


def aside(done: Sequence[Outcome]) -> str:
    """Say what the table leaves out."""
    steep = sum((o.ms_stages or 0.0) > NERVOUS for o in done)
    trusted = sum(o.row["verdict"] == GOOD and o.ms_before > NERVOUS for o in done)
    crashed = sum(bool(o.crash) for o in done)
    return (
        f"{crashed} crashed, {steep} with a stage of Ms above 3, {trusted} called good in spite of Ms above 3"
    )


def causes(done: Sequence[Outcome]) -> Counter[str]:
    """Count why loops in need were not cured."""
    return Counter(cause(o) for o in done if o.needs and not o.cured)


def cause(outcome: Outcome) -> str:
    """Say in short what kept a loop from being cured."""
    if outcome.crash:
        return f"crash: {outcome.crash}"
    if not outcome.events:
        return "no event found"
    reason = re.sub(r"-?[\d.]+(e[-+]?\d+)?", "#", outcome.row["reason"])
    if outcome.ms_after is None:
        verdict = outcome.row["verdict"]
        return f"{verdict}: {reason.partition('no suggestion: ')[2] or reason}"[:150]
    if math.isinf(outcome.ms_after):
        return "made unstable"
    slow = "nearly " if outcome.ci_after[outcome.kind] > 0.5 else ""
    return f"suggestion {slow}too slow, bound by: {outcome.binding}"


def worst(done: Sequence[Outcome]) -> list[Outcome]:
    """Sort by how bad the outcome is: unstable, nervous, in need and not cured, gain outside its interval."""

    def badness(o: Outcome) -> tuple[float, float]:
        nervous = 0.0 if o.ms_after is None else o.ms_after
        lost = bool(o.crash) or (o.needs and not o.cured)
        return (nervous if nervous > MOST_MS else 0.0), lost * (1 - o.ci_after.get(o.kind, 0.0))

    return sorted((o for o in done if badness(o) != (0.0, 0.0)), key=badness, reverse=True)


def describe(o: Outcome) -> str:
    """All facts of a loop that a developer needs."""

    def line(names: Sequence[str], values: dict[str, object]) -> str:
        return "  ".join(f"{n} {_short(values.get(n))}" for n in names)

    def found(name: str) -> str:
        low, value, high = (o.record.get(name + end) for end in ("_lo", "", "_hi"))
        return f"{name} {_short(value)} [{_short(low)}, {_short(high)}]"

    lines = [
        f"\n  {o.case} loop {o.number}  period {o.period:.4g}  {o.samples} samples  needs: {o.needs}  cured: {o.cured}",
        "    true   " + line(("process", "gain", "t0", "theta", "lag", "dead_time", "lags"), o.plant),
    ]
    if o.record:
        facts = ("process", "method", "fit", "state", "ci", "ms", "amplitude", "onset_late")
        lines += [
            "    found  " + "  ".join(found(n) for n in ("gain", "t0", "dead_time", "lag")),
            "           " + line(facts, o.record),
        ]
    lines += [
        f"    today  {line(('form', 'kp', 'ti', 'td', 'tf'), o.controller)}  Ms {o.ms_before:.3g}  "
        + line(("setpoint", "load"), dict(o.ci_before)),
        f"    said   {o.row['verdict']}: {o.row['reason']}{o.crash}",
    ]
    if o.new:
        lines += [
            f"    new    {line(('kp', 'ti', 'td', 'tf'), o.new)}  tc {o.tc:.4g} (true model {o.tc_wanted:.4g})  "
            f"bound by {o.binding}  " + line(("new_ms", "new_ms_worst", "new_ci"), o.row),
            f"    then   Ms {_short(o.ms_after)}  stages {_short(o.ms_stages)}  CI "
            + line(("setpoint", "load"), dict(o.ci_after)),
        ]
    return "\n".join(lines)


def _short(value: object) -> str:
    if isinstance(value, (tuple, list)):
        return "(" + ", ".join(_short(v) for v in value) + ")"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.exit(main())
