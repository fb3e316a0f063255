"""What import says and writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from monitor.adapters.historian.mapping import read_mapping
from monitor.audit.inputs import find
from monitor.contract.samples import Samples
from monitor.importing import Seen, loop_table_text, mapping_of, run_import, visible_lines
from tests.support.export_families import FAMILIES, ZONE, base


def test_it_says_how_and_shows_samples(tmp_path: Path) -> None:
    done = run_import([FAMILIES["layout-deltav"].write(base(), tmp_path)], tmp_path / "plant", tz=ZONE)
    assert done.exit_code == 0
    assert "PV = TIC-7/PID1/PV.CV" in done.lines[0]
    assert any(
        line.startswith("loop LIC-42: 60 samples; at 2026-03-14T07:30:00.000Z SP 50,") for line in done.lines
    )
    assert any(line.endswith("manual") for line in done.lines)
    table = pd.read_csv(tmp_path / "plant" / "loops.csv").set_index("name")
    assert table["process"].to_dict() == {"TIC-7": "auto", "LIC-42": "integrating", "FIC-310": "auto"}
    assert table.loc["LIC-42", "#process_is"].startswith("a guess")
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
    assert loop_table_text({"TIC-1": seen}).splitlines()[1].startswith("TIC-1,auto,,,")


def test_hostile_names_do_no_harm() -> None:
    assert "\x1b" not in visible_lines("a\x1b[2J\nb")
