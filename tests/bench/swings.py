"""The benchmark of what one record shows: oscillation, an output without an answer, tracking.

``python -m tests.bench.swings [--loops N] [--seed S]``. The records are those of `swings_fleet`; what misses its goal
is marked with ``!``.

``span``: share of the swings that are found: a span that counts, of the right period within 15 % (for a sawtooth or a
square too), over more than half of the true time. ``flag``: such spans take 30 % of the record. ``length``: median of
the span's length over the true one. Of healthy loops: share with any span, and with the flag.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from monitor.health.episodes import TIME_SHARE, Episode, Episodes, episodes_of
from monitor.health.response import no_response_of
from monitor.health.tracking import tracking_of, tracking_verdict
from tests.bench.swings_fleet import (
    LOADS,
    MOVES,
    SHAPES,
    Array,
    Swing,
    bursts,
    healthy,
    moves,
    ramped_load,
    shut,
    swing,
)

SEED = 20_261_128
"""Held out: named here and nowhere else."""
CYCLES = (5, 6, 8, 12)
SHARES = (0.15, 0.25, 0.5)
NEAR_PERIOD, OVER = 0.15, 0.5
RECALL, FALSE = 0.95, 0.01
"""Goals: least share found from six cycles on, most healthy loops that are flagged."""


def is_right(one: Episode, truth: Swing, span: tuple[int, int]) -> bool:
    """Whether a span found is a true one."""
    both = min(one.end, span[1]) - max(one.start, span[0])
    near = abs(one.period / truth.period - 1.0) <= NEAR_PERIOD
    return one.strong and near and both > OVER * (span[1] - span[0])


def flagged(found: list[Episode] | None, n: int) -> bool:
    """Whether the record by itself is called oscillating."""
    own = Episodes()
    own.add(found, 0, n, 1.0)
    return (own.oscillating_share or 0.0) >= TIME_SHARE


def score(drawn: list[Swing]) -> tuple[float, float, float]:
    """Return shares of spans found and of records flagged, and the median length of what was found over the truth."""
    right, lengths, flags = [], [], []
    for one in drawn:
        found = episodes_of(one.error, 1.0) or []
        flags.append(flagged(found, len(one.error)))
        for span in one.spans:
            own = [f for f in found if is_right(f, one, span)]
            right.append(bool(own))
            lengths += [(f.end - f.start) / (span[1] - span[0]) for f in own[:1]]
    return float(np.mean(right)), float(np.mean(flags)), float(np.median(lengths)) if lengths else np.nan


def swings(loops: int, seed: int) -> None:
    """Print how many swings are found, by cycles and shape."""
    print(f"{'cycles':22}" + "".join(f"{shape + ': span':>16}{'flag':>6}{'length':>8}" for shape in SHAPES))
    kinds: list[tuple[str, bool, Callable[[np.random.Generator, str], Swing]]] = [
        (f"{c} {'within a record' if w else 'and no more'}", c >= 6, lambda r, s, c=c, w=w: swing(r, s, c, w))  # type: ignore[misc]
        for w in (False, True)
        for c in CYCLES
    ]
    kinds += [
        (f"bursts, {share:.0%} of it", True, lambda r, s, p=share: bursts(r, s, p))  # type: ignore[misc]
        for share in SHARES
    ]
    for k, (name, counts, drawn) in enumerate(kinds):
        line = f"{name:22}"
        for j, shape in enumerate(SHAPES):
            rng = np.random.default_rng([seed, k, j])
            span, flag, length = score([drawn(rng, shape) for _ in range(loops)])
            missed = "!" if counts and span < RECALL else " "
            line += f"{100 * span:13.1f} %{missed}{100 * flag:5.0f} {length:8.2f}"
        print(line)


def false_alarms(loops: int, seed: int) -> None:
    """Print what is said of healthy loops."""
    fleet = {
        load: [healthy(np.random.default_rng([seed, 100, j, i]), load) for i in range(loops)]
        for j, load in enumerate(LOADS)
    }
    print(f"\n{'healthy under':22}{'spans':>8}{'flags':>8}{'without SP':>12}{'no response':>13}")
    for load, records in fleet.items():
        found = [episodes_of(r.sp - r.pv, 1.0, r.sp) or [] for r in records]
        blind = [episodes_of(r.sp - r.pv, 1.0) or [] for r in records]
        spans, flags, worst = (
            float(np.mean(x))
            for x in (
                [bool(f) for f in found],
                [flagged(f, len(r.sp)) for f, r in zip(found, records, strict=True)],
                [flagged(f, len(r.sp)) for f, r in zip(blind, records, strict=True)],
            )
        )
        silent = float(np.mean([no_response_of(r.sp, r.pv, r.op, 1.0) is not None for r in records]))
        mark, silence = "!" if flags > FALSE else " ", "!" if silent > FALSE else " "
        print(f"{load:22}{spans:8.1%}{flags:7.1%}{mark}{worst:12.1%}{silent:12.1%}{silence}")


def answers(loops: int, seed: int) -> None:
    """Print how many outputs without an answer are found, and what a ramping load makes of it."""
    for j, (name, drawn) in enumerate({"shut": shut, "ramping load": ramped_load}.items()):
        rng = np.random.default_rng([seed, 200, j])
        kinds: Counter[str] = Counter()
        for _ in range(loops):
            r = drawn(rng)
            found = no_response_of(r.sp, r.pv, r.op, 1.0)
            kinds[found.kind if found else "-"] += 1
        print(f"no response, {name:14}" + "  ".join(f"{k}: {v / loops:.1%}" for k, v in kinds.most_common()))


def tracking(loops: int, seed: int) -> None:
    """Print what is said of moves of the set point."""
    print()
    for j, kind in enumerate(MOVES):
        rng = np.random.default_rng([seed, 300, j])
        said: Counter[str] = Counter()
        for _ in range(loops):
            r = moves(rng, kind)
            said[tracking_verdict(tracking_of(r.sp, r.pv, 1.0, r.noise)) or "-"] += 1
        print(f"tracking, {kind:14}" + "  ".join(f"{k}: {v / loops:.1%}" for k, v in said.most_common()))


def cost() -> None:
    """Print the time for a block of 1024 samples [us]."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=1024)
    signals: dict[str, Array] = {
        "white": white,
        "walk": np.cumsum(white),
        "sine": np.sin(np.arange(1024) / 4) + 0.2 * white,
    }
    for name, x in signals.items():
        took = []
        for _ in range(100):
            start = time.process_time()
            episodes_of(x, 1.0)
            took.append(time.process_time() - start)
        print(f"{name}: {1e6 * min(took):.0f} us", end="  ")
    print()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--loops", type=int, default=100, help="records of each kind")
    parser.add_argument("--seed", type=int, default=SEED)
    args = parser.parse_args()
    swings(args.loops, args.seed)
    false_alarms(args.loops, args.seed)
    answers(args.loops, args.seed)
    tracking(args.loops, args.seed)
    cost()


if __name__ == "__main__":
    sys.exit(main())
