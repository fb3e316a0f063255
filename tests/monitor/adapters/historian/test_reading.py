"""How an export was understood, in words."""

from __future__ import annotations

from pathlib import Path

from monitor.adapters.historian.reader import inspect
from monitor.adapters.historian.reading import reading_of, same_readings, settled, tag_of, unused_of


def tag_file(path: Path, value: str = "1") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"Time,Value\n2026-03-14 08:00:00,{value}\n2026-03-14 08:00:05,{value}\n")
    return path


def test_the_reading_names_time_separator_and_a_loop(tmp_path: Path) -> None:
    path = tmp_path / "d.csv"
    path.write_text("Zeit;A.SV;A.PV;A.MV;x\n14.03.2026 08:00;1,5;1,5;3;7\n14.03.2026 08:01;1,5;1,5;3;7\n")
    source = inspect(path, "d.csv")
    said = reading_of(source)
    for part in ("wide", "'Zeit'", "local", "semicolon", "decimal comma", "SP = A.SV", "OP = A.MV"):
        assert part in said
    assert unused_of(source.layout) == "not used: x"
    assert same_readings([source]) == [f"d.csv: read as {said}"]


def test_the_tags_of_a_loop_come_together_from_their_files(tmp_path: Path) -> None:
    files = [tag_file(tmp_path / f"LIC-1.{r}.csv") for r in ("SP", "PV", "OP")]
    sources = settled([inspect(f, f.name) for f in files])
    assert all(s.loops == ["LIC-1"] for s in sources)
    assert tag_of(sources[1], "Value") == "LIC-1.PV"
    assert len(same_readings(sources)) == 1


def test_a_loop_that_lacks_a_tag_is_left_out_and_named(tmp_path: Path) -> None:
    files = [tag_file(tmp_path / f"LIC-1.{r}.csv") for r in ("SP", "PV")]
    sources = settled([inspect(f, f.name) for f in files])
    assert [s.layout.incomplete for s in sources] == [{"LIC-1": "no column or tag of its OP"}, {}]
    assert not any(s.loops for s in sources)


def test_loops_of_one_name_in_two_areas_stay_apart(tmp_path: Path) -> None:
    files = [tag_file(tmp_path / f"{a}%2FLIC-1.{r}.csv") for a in "XY" for r in ("SP", "PV", "OP")]
    sources = settled([inspect(f, f.name) for f in files])
    assert {n for s in sources for n in s.loops} == {"X/LIC-1", "Y/LIC-1"}
