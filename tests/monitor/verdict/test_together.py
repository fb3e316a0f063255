"""Loops that cycle together: who is named with whom, and who first."""

from __future__ import annotations

from typing import Any

from monitor.contract.records import LoopRow
from monitor.verdict.together import cycling_together


def row(name: str, period: float | None, amplitude: float = 1.0, noise: float = 0.1, **facts: Any) -> LoopRow:
    flags = () if period is None else ("oscillating",)
    return LoopRow(
        loop=name, reason="it oscillates", flags=flags, oscillation_period=period, oscillation_amplitude=amplitude,
        noise=noise, **facts,
    )  # fmt: skip


def said(*rows: LoopRow) -> dict[str, str]:
    return {r.loop: r.reason for r in cycling_together(rows)}


def test_the_one_that_is_largest_against_its_noise_comes_first():
    """Not the one with the largest amplitude in its own unit."""
    words = said(
        row("TIC-1", 300, 5.0, 1.0), row("FIC-2", 306, 2.0, 0.05), row("LIC-3", 900), row("PIC-4", None)
    )
    assert "cycles together with FIC-2 (period 5 min); look at FIC-2 first" in words["TIC-1"]
    assert "cycles together with TIC-1 (period 5.1 min); where the cycle is largest" in words["FIC-2"]
    assert words["LIC-3"] == words["PIC-4"] == "it oscillates"


def test_cycles_at_other_times_have_nothing_to_do_with_each_other():
    """The same period in the morning and in the afternoon; overlapping ones have."""
    morning = {"oscillation_start": 0.0, "oscillation_end": 1e4}
    noon = {"oscillation_start": 9e3, "oscillation_end": 2e4}
    evening = {"oscillation_start": 3e4, "oscillation_end": 4e4}
    words = said(row("A", 300, **morning), row("B", 300, **noon), row("C", 300, **evening))
    assert "together with B" in words["A"]
    assert words["C"] == "it oscillates"


def test_of_a_hundred_loops_some_are_named_and_all_are_counted():
    """And the order of the rows stays."""
    rows = [row(f"L{k:03}", 300 + 0.1 * k, 1.0 + k) for k in range(100)]
    found = cycling_together(rows)
    assert [r.loop for r in found] == [r.loop for r in rows]
    assert "and 95 more" in found[0].reason
    assert len(found[0].reason) < 300
