"""From an audit's folder to its report: the audit draws it, and it can be drawn again to the same bytes."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.adapters.tables import read_evidence, read_records
from monitor.audit.drawing import draw_report
from monitor.audit.run import run_audit
from monitor.contract.records import LoopRow

from .tools import step_test


@pytest.fixture(scope="module")
def audited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slow level, whose table says its settings."""
    folder = tmp_path_factory.mktemp("audited")
    step_test("LIC-1").to_parquet(folder / "data.parquet")
    (folder / "loops.csv").write_text("name,process,kp,ti,op_low,op_high\nLIC-1,integrating,8,40,0,100\n")
    assert run_audit([folder / "data.parquet"], folder / "loops.csv", folder / "out").exit_code == 0
    return folder / "out"


def test_it_is_drawn_again_to_the_same_bytes(audited: Path) -> None:
    before = (audited / "report.html").read_bytes()
    (audited / "report.html").unlink()
    assert draw_report(audited).read_bytes() == before


def test_evidence_is_kept_of_flagged_loops_alone(audited: Path) -> None:
    windows, answers = read_evidence(audited)
    (row,) = read_records(audited / "loops.parquet", LoopRow)
    assert bool(windows) == bool(answers) == (row.verdict != "good" or bool(row.flags))
    for window in windows:
        assert window.onset in window.time
        assert len(window.time) == len(window.pv) == len(window.model)


@pytest.mark.parametrize("name", ["loops.parquet", "events.parquet", "audit.json"])
def test_a_folder_without_an_audit_is_refused_in_one_line(audited: Path, tmp_path: Path, name: str) -> None:
    for file in audited.iterdir():
        if file.name != name:
            (tmp_path / file.name).write_bytes(file.read_bytes())
    with pytest.raises(ValueError, match=f"no {name}"):
        draw_report(tmp_path)
    (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(ValueError, match=name) as found:
        draw_report(tmp_path)
    assert "\n" not in str(found.value)


def test_an_audit_without_evidence_is_drawn_too(audited: Path, tmp_path: Path) -> None:
    for name in ("loops.parquet", "events.parquet", "audit.json"):
        (tmp_path / name).write_bytes((audited / name).read_bytes())
    assert "LIC-1" in draw_report(tmp_path).read_text()
