"""What import says and writes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.adapters.historian.mapping import read_mapping
from monitor.adapters.loop_table import read_loop_table
from monitor.audit.inputs import find
from monitor.audit.run import run_audit
from monitor.audit.settings import AuditSettings
from monitor.contract.records import LoopRow
from monitor.contract.samples import Samples
from monitor.importing import Seen, loop_table_text, mapping_of, run_import, visible_lines
from sim_plants.export import write_export
from sim_plants.scenarios import demo
from tests.support.export_families import FAMILIES, ZONE, base
from tests.support.places import SHARED


def test_it_says_how_and_shows_samples(tmp_path: Path) -> None:
    done = run_import([FAMILIES["layout-deltav"].write(base(), tmp_path)], tmp_path / "plant", tz=ZONE)
    assert done.exit_code == 0
    assert "PV = TIC-7/PID1/PV.CV" in done.lines[0]
    assert any(
        line.startswith("loop LIC-42: 60 samples; at 2026-03-14T07:30:00.000Z SP 50,") for line in done.lines
    )
    assert any(line.endswith("manual") for line in done.lines)
    table = pd.read_csv(tmp_path / "plant" / "loops.csv").set_index("name")
    assert set(table["process"]) == {"auto"}  # a guess has no effect until someone confirms it
    assert table["#process_guess"].dropna().to_dict() == {"LIC-42": "integrating (the tag's first letter)"}
    assert done.lines[-1].startswith("loops.csv: what is guessed or seen")
    assert read_mapping(tmp_path / "plant" / "mapping.toml").kind == "wide"


def test_what_is_not_understood_ends_with_2_and_a_line(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("a,b\n1,2\n")
    done = run_import([tmp_path / "d.csv"], tmp_path / "plant")
    assert (done.exit_code, len(done.problems)) == (2, 1)
    assert not (tmp_path / "plant").exists()


def test_a_mapping_says_no_more_than_files_share(tmp_path: Path) -> None:
    path = FAMILIES["tag-files"].write(base(), tmp_path)
    said = mapping_of(find([path], None, tmp_path / "out").sources)
    assert said.columns["LIC-42.PV"] == ("LIC-42", "pv")
    assert (said.kind, said.value) == ("per tag", "")


def test_a_share_is_no_per_cent() -> None:
    seen = Seen()
    seen.take(Samples.of(0, [0, 1], 1.0, [1.0, np.nan], [0.3, 0.9]))
    assert (seen.n, seen.op) == (2, (0.3, 0.3))
    assert loop_table_text({"TIC-1": seen}).splitlines()[1].startswith("TIC-1,auto,,,,,,,,")


def test_hostile_names_do_no_harm(tmp_path: Path) -> None:
    """None is a formula in the table, and the audit finds the loop of that name (a tag may begin with = or +)."""
    assert "\x1b" not in visible_lines("a\x1b[2J\nb")
    (tmp_path / "loops.csv").write_text(loop_table_text({"=cmd()": Seen(), "+A1-LIC": Seen(), "LIC": Seen()}))
    assert "\n'=cmd()," in (tmp_path / "loops.csv").read_text()
    assert [loop.name for loop in read_loop_table(tmp_path / "loops.csv")] == ["=cmd()", "+A1-LIC", "LIC"]


# -- import, then audit ---------------------------------------------------------------------------
def judged(path: Path, out: Path, plant: Path | None = None) -> list[LoopRow]:
    """What an audit says of every loop, with or without what import wrote."""
    how = AuditSettings(tz=ZONE, map=None if plant is None else str(plant / "mapping.toml"))
    return run_audit([path], None if plant is None else plant / "loops.csv", out, how).rows


def test_settings_are_seen_and_guesses_change_no_verdict(tmp_path: Path) -> None:
    """The demo's levels: what import writes of them is right, and of no effect until it is confirmed."""
    levels = [loop for loop in demo(1) if loop.name in {"LIC-101", "LIC-102"}]
    write_export(levels, 1800.0, tmp_path)
    run_import([tmp_path / "data.parquet"], tmp_path / "plant", tz=ZONE)
    table, truth = (
        pd.read_csv(folder / "loops.csv").set_index("name") for folder in (tmp_path / "plant", tmp_path)
    )
    assert table["kp"].isna().all()
    assert table["#kp_seen"].to_numpy() == pytest.approx(truth["kp"], rel=0.02)
    assert table["#ti_seen"].to_numpy() == pytest.approx(truth["ti"], rel=0.05)
    alone = judged(tmp_path / "data.parquet", tmp_path / "a")
    assert judged(tmp_path / "data.parquet", tmp_path / "b", tmp_path / "plant") == alone
    assert {row.verdict for row in alone} == {"good", "retune"}


@pytest.mark.slow
@pytest.mark.skipif(
    not (SHARED / "exports").is_dir(), reason="the shared exports are not beside this repository"
)
def test_each_shared_export_is_audited_the_same_by_what_import_wrote(tmp_path: Path) -> None:
    made = [
        sys.executable,
        SHARED / "exports" / "make.py",
        SHARED / "exports" / "source.parquet",
        tmp_path / "exports",
    ]
    subprocess.run(made, check=True)
    for path in sorted((tmp_path / "exports").iterdir()):
        plant = tmp_path / path.name / "plant"
        assert run_import([path], plant, tz=ZONE).exit_code == 0
        alone = judged(path, plant.parent / "a")
        assert len(alone) == 6, path.name
        assert judged(path, plant.parent / "b", plant) == alone, path.name
