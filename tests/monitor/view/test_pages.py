"""Pages of text: figures, old and new settings, names as they are."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from monitor.contract.evidence import Scale
from monitor.contract.figures import MEANINGS
from monitor.view import pages
from tests.support.fake_monitor import Loop, assessment, row


def test_pages_of_rows_without_figures() -> None:
    """A row may have nothing but a name: every figure that is not there is a dash."""
    bare = {"loop": "X", "verdict": "retune"}
    assert "No new settings" in pages.loop_page(bare)
    assert "cannot carry a model" in pages.loop_page({**bare, "gain": None})
    assert "withheld" not in pages.loop_page({**bare, "new_kp": None})
    assert "–" in pages.overview([bare], {"retune": 1}, [])
    assert "No loop is flagged" in pages.overview(
        [], {}, [pages.health_line({"id": "m", "samples_ok": None})]
    )
    assert "Waiting" in pages.health_line(None)
    assert pages.log_line({})[1] == "INFO"


def test_page_tells_old_and_new(loop: Loop) -> None:
    """Settings, indices and the model's intervals stand side by side, with units."""
    page = pages.loop_page(row(loop), assessment(loop))
    for part in (
        "| Kp \\[OP/PV\\] | 9.00 | **23.8** |",
        "| GAIN | – | **23\\.8** |",
        "\\[PV/(OP s)\\]",
        "1. Kp",
        "2. Kp",
    ):
        assert part in page, page
    none = pages.loop_page({**row(loop), "ti": None, "new_ti": None})
    assert "| Ti \\[s\\] | none | **none** |" not in none  # neither had it: no line
    assert "| Ti \\[s\\] | none | **84.0** |" in pages.loop_page({**row(loop), "ti": None})


def test_page_shows_health_and_what_it_means(loop: Loop) -> None:
    """The figures that the data carry, each with unit and meaning; flags in words; nothing of what is not known."""
    sick = {**row(loop), "oscillation_period": 155.0, "stiction": None, "flags": ("oscillating", "noisy_op")}
    page = pages.loop_page(sick)
    assert "oscillating, noisy op" in page.replace("\\", "")
    assert f"- **oscillation period** 155 \\[s\\]: {MEANINGS['oscillation_period'].says}" in page
    assert MEANINGS["stiction"].says not in page
    assert "Health" not in pages.loop_page({"loop": "A", "verdict": "retune"})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.00123456, "0.00123"),
        (1234.5, "1234"),
        (0.0, "0.00"),
        (1e-9, "1.00e-09"),
        (None, "–"),
        (np.nan, "–"),
    ],
)
def test_number(value: float | None, text: str) -> None:
    assert pages.number(value) == text


def test_a_disturbance_is_shown_with_its_own_figures(loop: Loop) -> None:
    """Neither index nor model: how far, how long, beyond, ringing."""
    figures = {"kind": "disturbance", "ci": None, "fit": None, "amplitude": -4.2}
    upset = {**assessment(loop), **figures, "recovery": 720.0, "overshoot": 0.4, "damping": 0.15}
    page = pages.loop_page(row(loop), upset)
    page = page.replace("\\", "")
    assert (
        "Upset that is no clean step of -4.20 PV, 2026-03-02 08:02:00 UTC, back within 720 s, overshoot"
        in page
    )
    assert "overshoot 40.0 %, damping 0.15." in page
    text, _ = pages.log_line(upset)
    assert "upset that is no clean step" in text
    assert "CI" not in text.split("(")[0]


def test_the_most_dangerous_loop_is_named_as_such(loop: Loop) -> None:
    """What is to be done with each, in a word or two, and the loops of each kind."""
    near = {**row(loop), "flags": ["near_instability"]}
    valve = {"loop": "V", "verdict": "inconclusive", "flags": ["stiction"]}
    page = pages.overview([near, valve], {"retune": 1, "valve": 1}, ["That is all."])
    assert "**1** to retune · **1** valve" in page
    assert "| LIC\\-101 | **near instability** |" in page
    assert "| V | valve |" in page
    assert page.rstrip().endswith("*That is all\\.*")


def test_units_of_the_table(loop: Loop) -> None:
    """Wherever a figure has one: settings, model, event, health; and what the charts are given."""
    facts = {**row(loop), "unit": "m3/h", "op_unit": "%", "noise": 0.3}
    page = pages.loop_page(facts, assessment(loop)).replace("\\", "")
    for part in ("Kp [%/(m3/h)]", "[(m3/h)/(% s)]", "step of 5.00 m3/h", "0.300 [m3/h]"):
        assert part in page, page
    assert pages.scale_of(facts) == Scale("m3/h", "%", 0.3)
    assert pages.scale_of({"unit": 7, "noise": None}) == Scale()


@pytest.mark.parametrize("kind", ["setpoint", "load", "disturbance"])
def test_an_event_in_words(kind: str) -> None:
    title = pages.event_title(
        {"kind": kind, "amplitude": 2.0, "start": "1970-01-01T00:25:00Z"}, Scale("bar", "%")
    )
    assert title.endswith(f" of 2.00 {'%' if kind == 'load' else 'bar'}, 00:25:00 from the start")


def test_what_is_no_row_is_refused() -> None:
    with pytest.raises(msgspec.ValidationError):
        pages.as_record({"loop": "A", "ms": "high"})
