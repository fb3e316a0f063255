"""Every family of exports is read to the samples that were written, by itself and by the mapping that import writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from monitor.adapters.historian.clock import zone_of
from monitor.adapters.historian.mapping import NO_MAPPING, ExportMapping, read_mapping
from monitor.adapters.historian.merge import Span, sorted_samples
from monitor.adapters.historian.rows import Tally
from monitor.audit.inputs import find
from monitor.check import check_file
from monitor.importing import run_import
from tests.support.export_families import FAMILIES, LOOPS, ZONE, base
from tests.support.samples import join


def plain(name: str) -> str:
    return "".join(c for c in name if c.isalnum()).upper()


def read(path: Path, given: ExportMapping = NO_MAPPING) -> tuple[pd.DataFrame, list[str]]:
    """Samples of an export, by loop and time."""
    inputs = find([path], None, path.parent / "out", None, given)
    assert not inputs.problems
    assert not inputs.files_left, [str(e) for e in inputs.files_left]
    wanted = {loop.name: k for k, loop in enumerate(inputs.loops)}
    parts = list(sorted_samples(inputs.sources, wanted, Span(zone=zone_of(ZONE)), Tally()))
    found = join(parts)
    names = np.array([loop.name for loop in inputs.loops])
    table = pd.DataFrame(
        {"loop": [plain(n) for n in names[found.loop]], "time": found.time, "sp": found.sp, "pv": found.pv}
    ).assign(op=found.op, auto=found.auto, quality=found.quality)
    unused = [u for s in inputs.sources for u in s.layout.unused]
    return table.sort_values(["loop", "time"], ignore_index=True), unused


def same(found: pd.DataFrame, data: pd.DataFrame, mode: bool) -> None:
    """What was read is what was written; samples that are bad there (text) are left out."""
    wanted = data.assign(
        loop=data["loop"].astype(str).map(plain), time=data["time"].dt.as_unit("ns").astype("int64")
    )
    wanted = wanted.sort_values(["loop", "time"], ignore_index=True)
    assert found["loop"].tolist() == wanted["loop"].tolist()
    assert (found["time"] - wanted["time"]).abs().max() <= 1_000_000
    for role in ("sp", "pv", "op"):
        good = found[role].notna()
        assert good.mean() > 0.9
        assert np.allclose(found.loc[good, role], wanted.loc[good, role], atol=1e-9), role
    assert found["auto"].tolist() == (wanted["auto"].tolist() if mode else [True] * len(wanted))
    assert (found.loc[found["pv"].notna(), "quality"] >= 192).all()


@pytest.mark.parametrize("family", FAMILIES)
def test_each_family_is_read_as_it_was_written(tmp_path: Path, family: str) -> None:
    kind = FAMILIES[family]
    data = base(start=kind.start, step_s=kind.step_s)
    found, unused = read(kind.write(data, tmp_path))
    same(found, data, kind.mode)
    assert len(LOOPS) == 3
    if family == "extra-columns":
        assert {"ambient", "comment"} <= set(unused)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_mapping_that_import_writes_reads_the_same(tmp_path: Path, family: str) -> None:
    """The way out and in again: what import understood, audit understands by --map."""
    kind = FAMILIES[family]
    data = base(start=kind.start, step_s=kind.step_s)
    path = kind.write(data, tmp_path)
    done = run_import([path], tmp_path / "plant", tz=ZONE)
    assert done.exit_code == 0
    same(read(path, read_mapping(tmp_path / "plant" / "mapping.toml"))[0], data, kind.mode)
    table = pd.read_csv(tmp_path / "plant" / "loops.csv")
    assert {plain(n) for n in table["name"]} == {plain(n) for n in LOOPS}
    assert not check_file(tmp_path / "plant" / "loops.csv").problems
