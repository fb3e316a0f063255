"""Numbers, times and facts as a reader wants them."""

from __future__ import annotations

import pytest

from monitor.report.words import clock, facts_of, first_clauses, number, percent

from .tools import ABOUT, START


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"),
        (12345.6, "12300"),
        (99999.0, "100000"),
        (1.5e-7, "1.5e−7"),
        (float("-inf"), "−∞"),
        (7, "7"),
        (True, "True"),
    ],
)
def test_numbers(value: float, said: str) -> None:
    assert number(value) == said


def test_times_and_shares() -> None:
    assert (clock(START), clock(None), clock(0)) == ("2026-03-01 00:00:00", "", "second 0")
    assert percent(0.1234, 1) == "12.3 %"
    assert first_clauses("a; b; c", 1) == "a"


def test_facts_of_an_audit_and_of_none() -> None:
    facts = facts_of(ABOUT)
    assert (facts["first"], facts["inputs"], facts["table"]) == (
        "2026-03-01 00:00",
        ["week.parquet"],
        "loops.csv",
    )
    assert facts_of({})["inputs"] == []
    many = facts_of({"inputs": [{"name": str(k)} for k in range(9)], "first_sample": "1970-01-01T00:00:00Z"})
    assert (len(many["inputs"]), many["more_inputs"], many["first"]) == (6, 3, "00:00:00 from the start")
