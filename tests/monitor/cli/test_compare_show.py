"""What a comparison prints: worse before better, names that print, what is new, missing, and looks renamed."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.cli.compare_show import SHOWN_LOOPS, show
from monitor.compare.between import compare
from tests.monitor.compare.tools import audit, events, row

FILES = [Path("out/compare.html"), Path("out/compare.csv"), Path("out/compare.parquet")]
SLOW, FAST = [0.3] * 6, [0.8] * 6


def test_worse_comes_first_and_all_is_printable(capsys: pytest.CaptureFixture[str]) -> None:
    hostile = "\x1b[31m\u202eX"
    old = audit(
        [row("A"), row(hostile), row("TIC-3")],
        events(SLOW, "A") + events(FAST, hostile),
        lacks=("spells.parquet",),
    )
    new = audit([row("A"), row(hostile), row("U/TIC-3")], events(FAST, "A") + events(SLOW, hostile))
    show(compare(old, new), FILES)
    out, err = capsys.readouterr()
    assert out.index("worse") < out.index("better")
    assert "\x1b" not in out
    assert "\u202e" not in out
    assert "\\x1b[31m\\u202eX" in out
    assert "1 new: U/TIC-3" in out
    assert "1 missing: TIC-3" in out
    assert "1 look renamed: TIC-3 → U/TIC-3" in out
    assert "has no spells.parquet" in err


def test_of_many_loops_the_first_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    names = [f"L{k:03}" for k in range(SHOWN_LOOPS + 5)]
    rows = [row(n) for n in names]
    show(compare(audit(rows, [e for n in names for e in events(FAST, n)]),
                 audit(rows, [e for n in names for e in events(SLOW, n)])), FILES)  # fmt: skip
    assert "... and 5 more worse, in compare.csv" in capsys.readouterr().out
