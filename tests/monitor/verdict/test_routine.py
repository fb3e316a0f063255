"""Words for a loop that no step has shown."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.contract.loops import Loop
from monitor.contract.records import NOT_ASSESSED
from monitor.contract.samples import Samples
from monitor.health.loop_health import Health
from monitor.health.regulation import Regulation
from monitor.verdict.in_force import InForce
from monitor.verdict.parts import Tuning
from monitor.verdict.routine import NOTHING_SEEN, routine
from monitor.verdict.row import loop_row
from tests.support.plants import pi_loop, times
from tests.support.runs import run

LOOP = Loop(name="LIC-1")
SLOW = Regulation(error_sd=0.8, memory=720.0, seen=2000.0, cycle=None, tight_from=math.inf)


def said(found: Regulation | None, loop: Loop = LOOP, **facts: object) -> tuple[str, str]:
    return routine(loop, Health(**{"noise": 0.1, "pv_moving": 0.9, "regulation": found} | facts))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("found", "facts", "words", "action"),
    [
        (
            SLOW,
            {},
            "8 times as wide as PV's noise (0.8 [PV]), and takes 12 min to die away: slow, or disturbed",
            "4.8",
        ),
        (
            replace(SLOW, memory=math.inf),
            {},
            "lasts longer than 33 min: slow, or disturbed",
            "shows which",
        ),
        (
            replace(SLOW, tight_from=90.0),
            {},
            "pays only if the process's dead time is below 90 s",
            "longer; else",
        ),
        (
            replace(SLOW, error_sd=0.11),
            {},
            "1.1 times as wide as PV's noise (0.11 [PV]): regulation leaves",
            "none",
        ),
        (
            replace(SLOW, tight_from=0.0),
            {"noise": None},
            "0.8 [PV]: regulation leaves nothing to gain",
            "none",
        ),
        (replace(SLOW, cycle=30.0), {}, "comes back every 30 s: a cycle", "sample it faster"),
        (SLOW, {"quantum": 1.0}, "within its own resolution (1 [PV])", "none"),
        (SLOW, {"pv_moving": 0.0}, "PV rests at 100% of the samples", "why PV rests"),
        (replace(SLOW, tight_from=0.0), {}, "takes 12 min to die away", "none; a set-point step"),
        (SLOW, {"mean_abs_e": 0.2}, "comes of single upsets (mean size 0.2 [PV])", "none; a set-point step"),
        (SLOW, {"mean_abs_e": 0.6}, "slow, or disturbed", "shows which"),
        (SLOW, {"sp_moving": 0.3}, NOTHING_SEEN, "none; a set-point step"),
        (None, {}, NOTHING_SEEN, "none; a set-point step"),
    ],
)
def test_what_is_said_and_what_would_tell_more(found, facts, words, action):
    """Size against noise, time to die away, and what cannot be known without a step."""
    reason, then = said(found, **facts)
    assert reason.startswith(NOTHING_SEEN)
    assert words in reason
    assert action in then


def test_the_span_is_named_where_it_is_known():
    assert "(0.8 [PV], 0.4 % of PV's span)" in said(SLOW, Loop(name="L", pv_low=0.0, pv_high=200.0))[0]


def test_it_is_no_verdict():
    """What a loop's health says of its control comes first; nothing is suggested."""
    health = Health(coverage=1.0, manual=0.0, noise=0.1, pv_moving=0.9, regulation=SLOW)
    row = loop_row(InForce(LOOP), Tuning(), health)
    assert (row.verdict, row.new_kp) == (NOT_ASSESSED, None)
    assert "slow, or disturbed" in row.reason
    assert loop_row(InForce(LOOP), Tuning(), replace(health, manual=0.9)).reason.startswith("in manual")


@pytest.mark.parametrize(
    ("noise", "load", "words"), [(0.2, 0.0, "leaves nothing to gain"), (0.01, 0.4, "slow, or disturbed")]
)
def test_from_samples_to_words(noise, load, words):
    """A loop in white noise that hardly answers it; and one that a wandering load moves."""
    rng = np.random.default_rng(5)
    pushes = np.cumsum(rng.normal(0.0, load, 4000))
    pushes -= np.linspace(0.0, pushes[-1], 4000)
    pv, op = pi_loop(
        np.full(4000, 50.0), kp=0.1, ti=400.0, noise=noise, load=lambda k: 0.02 * float(pushes[k])
    )
    engine, _ = run(Loop(name="L"), Samples.of(0, times(4000), np.full(4000, 50.0), pv, op))
    row = engine.row(0)
    assert row.verdict == NOT_ASSESSED
    assert words in row.reason
