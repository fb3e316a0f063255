"""The benchmark of what lies outside the product's assumptions: fleets of many kinds, judged on the true loops.

``python -m tests.bench.mismatch [--loops N] [--case KIND ...] [--group GROUP ...] [--campaign N] [--seed S]
[--worst N] [--json FILE] [--jobs N]``: one table row for each kind, then the totals against their goals.

Kinds (`mismatch_fleet.KINDS`, in six groups: plant shape, loads, valve, recording and block, wrong tables, right
tables) take their draws from `retune_fleet`: dead time 1 to 100 s, 3 to 20 recorded samples in it, a third of the
plants self-regulating where the kind does not say, SIMC settings detuned by 0.13 to 2.2 times the gain and 0.4 to 5
times the reset, all forms, half set-point and half load steps after 100 to 150 quiet samples, the process declared
for half of the loops. Each kind breaks one assumption, with numbers drawn from a wide range; unstable loops are drawn
again.

Judge (`mismatch_plant`, `mismatch_truth`; independent of the product's models): Ms of the sampled loop with the
plant discretised exactly, dead time, execution period, PV filter, delay of the output and derivative filter
included; where the gain depends on OP, level or direction, the worst of where the loop rests. ``unst``: unstable by
Nyquist or swinging ever more in a simulation of the true loop, valve included; or an exception of the engine.
``1st``: first stages of the way above Ms 3.
``need``: true index of the event's kind below 0.5, or true Ms above 3, today. ``cured``: both true indices 0.6 or
more and Ms at most 2.75, by the first suggestion, and after the campaign; not asked where no half-rule model
says what the plant is. ``refused``: in need, and told nothing at any stage. ``accused``: flag ``settings_mismatch``;
``named``: accused, and the reason holds the cause's word (a PV filter or an execution period: the word, or the
number). ``gain in``: interval of an event's gain holds the truth. ``kp``, ``ti``: seen within 10 % of the truth, of
those seen. A campaign types in what is to be typed in now, and goes on with the same plant from where it is.

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

from tests.bench.fleet_run import judged, write  # noqa: E402
from tests.bench.mismatch_fleet import KINDS, RIGHT, TABLE  # noqa: E402
from tests.bench.mismatch_judge import NERVOUS, Outcome, judge_many  # noqa: E402

SEED = 20_111_128
"""Held out: named here and nowhere else."""
CHUNK = 10
GROUPS = tuple(dict.fromkeys(kind.group for kind in KINDS.values()))
NEEDLESS = ("clipped-output", "op-quantised", "op-rounded-by-historian", "feed-forward", "one-sample-late")
"""An engineer would advise here."""
HEAD = (
    f"{'kind':35}{'loops':>6}{'event':>6}{'need':>5}{'sugg':>5}{'unst':>6}{'Ms>3':>6}{'worst':>7}{'1st':>5}{'refused':>8}"
    f"{'cured':>7}{'at end':>7}{'accused':>8}{'named':>7}{'gain in':>8}{'kp':>6}{'ti':>6}{'ms 50':>7}{'99':>6}"
)


def main() -> None:
    """Run the kinds asked for, and print the table and the totals."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--loops", type=int, default=100, help="loops per kind")
    parser.add_argument("--case", nargs="+", choices=list(KINDS), default=[])
    parser.add_argument("--group", nargs="+", choices=GROUPS, default=[])
    parser.add_argument("--campaign", type=int, default=1, help="events of a loop, one after the other")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument(
        "--worst", type=int, default=0, help="describe this many of the worst loops of each kind"
    )
    parser.add_argument("--json", help="write every outcome to this file, one line each")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    names = [
        n
        for n, k in KINDS.items()
        if n in args.case or k.group in args.group or not (args.case or args.group)
    ]
    outcomes: list[Outcome] = []
    print(HEAD)
    for name, done in judged(judge_many, names, args.loops, CHUNK, args.jobs, args.seed, args.campaign):
        outcomes += done
        print(table_line(name, done), flush=True)
    print("\n" + "\n".join(totals(outcomes)))
    for name in names if args.worst else ():
        mine = [o for o in outcomes if o.case == name]
        print(f"\n{name}; in need and told nothing, by cause:")
        for cause, count in causes(mine).most_common(6):
            print(f"{count:6d}  {cause}")
        for outcome in worst(mine)[: args.worst]:
            print(describe(outcome))
    if args.json:
        write(outcomes, args.json)


# ---------------------------------------------------------------------------------------------------
# figures


def table_line(name: str, done: Sequence[Outcome]) -> str:
    """One row of the table."""
    kind, told = KINDS[name], [t for o in done for t in o.told]
    need = [o for o in done if o.needs]
    bad = sum(t.unstable for t in told) + sum(bool(o.crash) for o in done)
    over = sum(not t.unstable and t.ms_after > NERVOUS for t in told)
    most = max((t.ms_after for t in told), default=math.nan)
    steep = sum(t.ms_first > NERVOUS for t in told)
    ruled = [o for o in need if o.plant["half_rule"]]
    inside = [g for o in done for g in o.gains]
    accused = sum(o.accused for o in done)
    moved = [o for o in done if o.records]
    cost = [1e3 * o.cost for o in done if not math.isnan(o.cost)]
    middle, slow = np.percentile(cost, [50, 99]) if cost else (math.nan, math.nan)
    return (
        f"{name:35}{len(done):6d}{sum(o.events > 0 for o in done):6d}{len(need):5d}{len(told):5d}"
        f"{mark(bad, bad > 0, 'd'):>6}{mark(over, over > 0.01 * len(told), 'd'):>6}{mark(most, False, '.2f'):>7}"
        f"{steep:5d}{percent(not o.told for o in need):>8}{percent(o.cured_first for o in ruled):>7}"
        f"{percent(o.cured for o in ruled):>7}{mark(accused, kind.right and accused > 0.005 * len(done), 'd'):>8}"
        f"{percent((o.named for o in moved) if kind.word else (), 0.9):>7}{percent(inside, 0.9):>8}"
        f"{percent(seen('kp', done), 0.9):>6}{percent(seen('ti', done), 0.9):>6}{middle:7.1f}{slow:6.0f}"
    )


def seen(name: str, done: Sequence[Outcome]) -> list[bool]:
    """Whether a setting was seen within 10 %, in its own or in the standard form, of the loops where it was seen."""
    found = [(o, o.row.get(f"{name}_seen")) for o in done]
    return [
        any(value == truth or abs(value / truth - 1) <= 0.1 for truth in (o.today[name], o.standard[name]))
        for o, value in found
        if value is not None
    ]


def totals(outcomes: Sequence[Outcome]) -> list[str]:
    """All kinds together, against the goals."""
    told = [t for o in outcomes for t in o.told]
    unstable = sum(t.unstable for t in told)
    over = sum(not t.unstable and t.ms_after > NERVOUS for t in told)
    need = [o for o in outcomes if o.needs]
    right = [o for o in outcomes if KINDS[o.case].right]
    accused = sum(o.accused for o in right)
    named = [o for o in outcomes if KINDS[o.case].word and o.records]
    base = [o for o in outcomes if KINDS[o.case].group == RIGHT and o.needs]
    noisy = [o for o in outcomes if o.case == "noise-3pct" and o.needs]
    moved = sum("retuned on" in str(o.row.get("reason")) for o in outcomes)
    seen_loops = [o for o in outcomes if o.case == "no-table"]
    cost = [1e3 * o.cost for o in outcomes if not math.isnan(o.cost)]
    lines = [
        *(_group_line(g, [o for o in outcomes if KINDS[o.case].group == g]) for g in GROUPS),
        (
            f"suggestions {len(told)}: unstable {mark(unstable, unstable > 0, 'd')}, "
            f"Ms above 3 {mark(over, over > 0.01 * len(told), 'd')} ({percent(t.ms_after > NERVOUS for t in told)})"
        ),
        f"in need {len(need)}: told nothing {sum(not o.told for o in need)}",
        f"crashed {sum(bool(o.crash) for o in outcomes)}",
        f"accused falsely {mark(accused, accused > 0.005 * len(right), 'd')} of {len(right)} right tables",
        f"said to be retuned before anybody had {mark(moved, moved > 0, 'd')}",
        f"named {percent((o.named for o in named), 0.9)} of {len(named)} tables that say it wrong",
        (
            f"without a table: kp {percent(seen('kp', seen_loops), 0.9)}, ti {percent(seen('ti', seen_loops), 0.9)} of "
            f"{len(seen('kp', seen_loops))} of {len(seen_loops)} within 10 %"
        ),
        (
            f"inside the assumptions: cured {percent((o.cured for o in base), 0.95)}, by the first "
            f"{percent((o.cured_first for o in base), 0.5)}, refused {percent(not o.told for o in base)} "
            f"of {len(base)}; at 3 % noise cured {percent((o.cured for o in noisy), 0.9)}, "
            f"refused {percent(not o.told for o in noisy)}"
        ),
        "where an engineer would advise: suggestions "
        + ", ".join(f"{name} {sum(bool(o.told) for o in outcomes if o.case == name)}" for name in NEEDLESS),
        f"processor time of an event, median {np.median(cost) if cost else math.nan:.1f} ms",
    ]
    return [line for line in lines if "nan" not in line and " 0 kinds" not in line]


def _group_line(group: str, done: Sequence[Outcome]) -> str:
    told, need = [t for o in done for t in o.told], [o for o in done if o.needs]
    unstable = sum(t.unstable for t in told)
    over = sum(not t.unstable and t.ms_after > NERVOUS for t in told)
    return (
        f"{group}: {len({o.case for o in done})} kinds, {len(done)} loops, in need {len(need)}, "
        f"told nothing {percent(not o.told for o in need)}, suggestions {len(told)}, unstable {unstable}, "
        f"above Ms 3 {over}, gain inside {percent(g for o in done for g in o.gains)}"
    )


def percent(values: Iterable[object], goal: float = 0.0) -> str:
    """Share of what is true, with ``!`` below its goal; a dash of nothing."""
    array = np.array([bool(v) for v in values])
    return f"{array.mean():.0%}" + "!" * bool(array.mean() < goal) if len(array) else "-"


def mark(value: float, missed: bool, form: str) -> str:
    """Write a figure, with ``!`` where it misses its goal."""
    return ("-" if math.isnan(value) else format(value, form)) + "!" * bool(missed)


# ---------------------------------------------------------------------------------------------------
# why


def causes(done: Sequence[Outcome]) -> Counter[str]:
    """Count why loops in need were told nothing."""
    silent = [o for o in done if o.needs and not o.told]
    return Counter(re.sub(r"-?[\d.]+(e[-+]?\d+)?", "#", str(o.row.get("reason")))[:150] for o in silent)


def worst(done: Sequence[Outcome]) -> list[Outcome]:
    """Sort by how bad the outcome is: crashed, unstable, above Ms 3, falsely accused, in need and told nothing."""

    def badness(o: Outcome) -> float:
        harm = max((1e6 if t.unstable else t.ms_after for t in o.told), default=0.0)
        blamed = KINDS[o.case].right and o.accused
        missed = KINDS[o.case].group == TABLE and bool(KINDS[o.case].word) and not o.named
        harm = harm if harm > NERVOUS else 0.0
        return 1e9 * bool(o.crash) + harm + 2.0 * (blamed or missed) + (o.needs and not o.told)

    return sorted((o for o in done if badness(o) > 0), key=badness, reverse=True)


def describe(o: Outcome) -> str:
    """All facts of a loop that a developer needs."""

    def line(names: Iterable[str], values: dict[str, object]) -> str:
        return "  ".join(f"{n} {_short(values.get(n))}" for n in names if values.get(n) or values.get(n) == 0)

    settings = "form kp ti td tf filter late".split()
    found = "kind state process method fit gain gain_lo gain_hi t0 dead_time lag ci verdict".split()
    eyes = "settings_source settings_explained kp_seen ti_seen td_seen pv_filter_seen op_delay_seen scan_seen".split()
    said = f"{o.samples} samples  needs {o.needs}  cured {o.cured}  flags {','.join(o.flags)} {o.crash}"
    before = f"Ms {o.ms_before:.3g}  CI {_short(tuple(o.ci_before.values()))}"
    lines = [
        f"\n  {o.case} loop {o.number}  {o.event}  period {o.period:.4g}  scan {o.scan:.4g}  " + said,
        "    true   " + line(("process", "slope", "gains", "dead_time", "theta", "lag", "poles"), o.plant),
        f"    today  {line(settings, o.today)}  " + before,
        "    table  " + line(("process", *settings), o.table),
        *("    found  " + line(found, r) for r in o.records),
        "    seen   " + line(eyes, o.last_row),
        f"    said  {o.reasons}",
    ]
    for t in o.told:
        then = f"Ms {t.ms_after:.3g} {'grows ' * t.grows}CI {_short(tuple(t.ci_after.values()))}"
        lines += [f"    new[{t.stage}] {line(t.new, dict(t.new))}: {then}  first stage's Ms {t.ms_first:.3g}"]
    return "\n".join(lines)


def _short(value: object) -> str:
    if isinstance(value, (tuple, list)):
        return "(" + ", ".join(_short(v) for v in value) + ")"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.exit(main())
