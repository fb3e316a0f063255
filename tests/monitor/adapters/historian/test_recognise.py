"""Which column is what; what is refused, in one line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest

from monitor.adapters.historian.cell_kinds import column_kind
from monitor.adapters.historian.layout import Layout
from monitor.adapters.historian.look import Look
from monitor.adapters.historian.mapping import NO_MAPPING, ExportMapping
from monitor.adapters.historian.recognise import file_tag, recognise

TIME = ["2026-03-14 08:00:00", "2026-03-14 08:00:05"]
TWO = ["1.5", "2.5"]


def look(columns: dict[str, Sequence[str]], path: str = "d.csv", given: ExportMapping = NO_MAPPING) -> Look:
    def different(names: tuple[str, ...]) -> Iterable[tuple[str, ...]]:
        return list(dict.fromkeys(zip(*(columns[n] for n in names), strict=True)))

    kinds = {name: column_kind(cells) for name, cells in columns.items()}
    return Look(Path(path), tuple(columns), kinds, columns, different, (), given)


def layout(
    columns: dict[str, Sequence[str]], path: str = "d.csv", given: ExportMapping = NO_MAPPING
) -> Layout:
    return recognise(look(columns, path, given))


def wide(*names: str, **more: Sequence[str]) -> dict[str, Sequence[str]]:
    return {"Time": TIME, **dict.fromkeys(names, TWO), **more}


def test_each_shape_by_its_headings() -> None:
    assert layout(wide("A.SV", "A.PV", "A.MV")).kind == "wide"
    assert layout(wide("SP", "PV", "OUT"), "LIC-7.csv").columns == {
        "LIC-7": {"sp": "SP", "pv": "PV", "op": "OUT"}
    }
    long = layout(wide("SP", "PV", "OUT", asset=["A", "B"]))
    assert (long.kind, long.loop) == ("long", "asset")
    tall = layout({"Time": ["2026-03-14"] * 3, "Tag": ["A.SP", "A.PV", "A.OP"], "Value": ["1", "2", "3"]})
    assert (tall.kind, tall.tags, tall.value) == ("tall", ("Tag",), "Value")
    assert layout({"Time": TIME, "Value": TWO}, "LIC-7.PV.csv").columns == {"LIC-7": {"pv": "Value"}}
    assert layout(wide("A.SP", "B.SP")).kind == "per tag"


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (wide("A.SP", "A.PV", "A.OUT", "A.MV"), "A.OUT and A.MV may both be the OP of A"),
        (wide("A.SP", "A.PV", "A.OP", "A.MAN"), "A.MAN may say that A is in manual"),
        (wide("x", "y"), "no set point, PV and output"),
        ({"A.SP": TWO, "A.PV": TWO}, "no column of times"),
        (wide("SP", "PV", "OP", site=["a", "b"], block=["c", "d"], area=["e", "f"]), "block"),
        ({"Time": TIME, "Tag": ["A.PV", "A.SP"], "x": TWO, "y": TWO}, "x and y may be the values"),
        ({"Time": TIME, "Tag": ["A.PV", "A.SP"], "Point": ["A.PV", "A.SP"], "Value": TWO}, ""),
    ],
)
def test_what_has_no_one_reading_is_refused(columns: dict[str, Sequence[str]], says: str) -> None:
    if not says:
        assert layout(columns).tags == ("Tag",)
        return
    try:
        found = layout(columns)
    except ValueError as error:
        assert says in str(error)  # noqa: PT017 (one case is read)
        assert "\n" not in str(error)  # noqa: PT017 (likewise)
    else:
        assert found.loop == says


def test_the_mapping_decides() -> None:
    columns = wide("A.SP", "A.PV", "A.OUT", "A.MV")
    said = {h: ("A", r) for h, r in (("A.SP", "sp"), ("A.PV", "pv"), ("A.MV", "op"))}
    found = layout(columns, given=ExportMapping(kind="wide", columns=said))
    assert found.columns["A"]["op"] == "A.MV"
    assert found.unused == ("A.OUT",)
    with pytest.raises(ValueError, match="no column 'When'"):
        layout(columns, given=ExportMapping(time=("When",)))


def test_what_is_not_used_is_named() -> None:
    assert layout(wide("A.SP", "A.PV", "A.OP", "ambient")).unused == ("ambient",)
    lacking = layout(wide("A.SP", "A.PV", "A.OP", "B.PV", "B.SP"))
    assert lacking.incomplete == {"B": "no column or tag of its OP"}


def test_a_file_is_called_like_its_tag_or_its_folder() -> None:
    assert file_tag(Path("x/LIC-7.PV.csv")) == "LIC-7.PV"
    assert file_tag(Path("LIC-7/PV.csv")) == "LIC-7.PV"
