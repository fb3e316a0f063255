"""An audit's folder is read; what it lacks is named, what is no audit is one line."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from monitor.adapters.audit_folder import read_audit
from monitor.adapters.tables import write_spells, write_tables
from monitor.contract.records import Assessment, LoopRow, Spell

EVENT = Assessment(loop="A", id="1", event=1, kind="load", start=10**18, end=2 * 10**18, state="settled", amplitude=1.0,
                   verdict="good", reason="")  # fmt: skip
SPELL = Spell(loop="A", start=10**18, seconds=600.0, error=0.1, error_rms=0.2, op_path=3.0)


@pytest.fixture(params=[False, True], ids=["timestamps", "seconds"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    write_tables(tmp_path, [EVENT], [LoopRow(loop="A", ti=float("inf"))], seconds=request.param)
    write_spells(tmp_path, [SPELL], seconds=request.param)
    (tmp_path / "audit.json").write_text('{"versions": {"loopsight": "0.1.0"}}')
    return tmp_path


def test_it_is_read_as_it_was_written(folder: Path) -> None:
    found = read_audit(folder)
    assert (found.rows, found.events, found.spells) == (
        [LoopRow(loop="A", ti=float("inf"))],
        [EVENT],
        [SPELL],
    )
    assert found.about == {"versions": {"loopsight": "0.1.0"}}
    assert found.lacks == ()


def test_an_earlier_version_is_read_and_what_it_lacks_is_named(folder: Path) -> None:
    (folder / "spells.parquet").unlink()
    for name, column in (("loops.parquet", "oscillating_share"), ("events.parquet", "ms")):
        table = pq.read_table(folder / name).drop_columns([column])
        pq.write_table(table, folder / name)
    found = read_audit(folder)
    assert found.lacks == ("oscillating_share", "ms", "spells.parquet")
    assert found.spells == []


@pytest.mark.parametrize("text", ["nothing", "[1]", ""])
def test_what_is_no_audit_is_one_line(folder: Path, text: str) -> None:
    (folder / "audit.json").write_text(text)
    with pytest.raises(ValueError, match=r"audit\.json") as found:
        read_audit(folder)
    assert "\n" not in str(found.value)
