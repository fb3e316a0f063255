"""CSV as others write it: separators, marks, torn lines."""

from __future__ import annotations

from pathlib import Path

from monitor.adapters.historian.rows import Tally
from tests.monitor.adapters.historian.tools import all_of, as_text, equal, frame, samples_of, write


def test_semicolons_decimal_commas_bom_and_crlf(tmp_path: Path) -> None:
    data = frame()
    path = write(
        data, tmp_path / "d.csv", "text", sep=";", decimal=",", lineterminator="\r\n", encoding="utf-8-sig"
    )
    assert b"," in path.read_bytes()
    tally = Tally()
    equal(all_of(path, tally=tally), samples_of(data))
    assert not tally.bad_texts
    dotted = path.read_text(encoding="utf-8-sig").replace("2026-03-01T", "01.03.2026 ").replace("Z;", ";")
    path.write_text(dotted, encoding="utf-16")
    equal(all_of(path), samples_of(data))


def test_lines_with_wrong_number_of_cells_are_counted_with_their_line(tmp_path: Path) -> None:
    data = frame()
    lines = as_text(data).to_csv(index=False).splitlines()
    lines[5] += ",9"
    torn = "\n".join(lines)[:-25]
    (tmp_path / "d.csv").write_text(torn)
    tally = Tally()
    equal(all_of(tmp_path / "d.csv", tally=tally), samples_of(data.drop(index=[4, 79])))
    assert tally.lost_lines == {"d.csv": 2}
    assert tally.lines["d.csv"] == {6: "8 cells, expected 7", 81: "3 cells, expected 7"}


def test_embedded_nul_costs_its_cell_only(tmp_path: Path) -> None:
    data = frame()
    text = as_text(data).to_csv(index=False)
    first = text.splitlines()[1]
    cells = first.split(",")
    cells[3] += "\0"
    (tmp_path / "d.csv").write_text(text.replace(first, ",".join(cells)))
    equal(all_of(tmp_path / "d.csv"), samples_of(data.assign(pv=data["pv"].where(data.index != 0))))
