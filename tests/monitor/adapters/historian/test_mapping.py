"""What a user says of an export."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.adapters.historian.mapping import (
    NO_MAPPING,
    ExportMapping,
    given_mapping,
    mapping_text,
    read_mapping,
)

TEXT = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=20)


@given(name=TEXT, loop=TEXT, mode=TEXT.map(lambda t: t.strip().lower()))
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, name: str, loop: str, mode: str
) -> None:
    """Names of any characters, hostile ones among them."""
    path = tmp_path_factory.mktemp("m") / "mapping.toml"
    said = ExportMapping(
        kind="wide", time=(name,), columns={name: (loop, "pv")}, modes={mode: 1}, data_row=3, separator="\t"
    )
    path.write_text(mapping_text(said, "about\nit"), encoding="utf-8", newline="")
    assert read_mapping(path) == said


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("kind = 'tall", "mapping.toml: "),
        ("knd = 'tall'", "knd: expected one of kind, time"),
        ("kind = 'round'", "kind: 'round', expected one of long"),
        ("time = 3", "time: 3, expected a heading"),
        ("data_row = -1", "data_row: -1, expected the number of a line"),
        ("[columns]\nA = 'pv'", "columns: A: 'pv', expected"),
        ("[modes]\n3 = 'ON'", "modes: 3: 'ON', expected AUTO or MAN"),
        ("quality_scale = 'x'", "quality_scale: 'x', expected one of opc"),
        ("columns = 3", "columns: 3, expected a table"),
        ("loop = 3", "loop: 3, expected a text"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "mapping.toml").write_text(text)
    with pytest.raises(ValueError, match=r"mapping\.toml") as error:
        read_mapping(tmp_path / "mapping.toml")
    assert says in str(error.value)


def test_options_make_a_mapping() -> None:
    assert given_mapping(None, None) is NO_MAPPING
    assert given_mapping(None, "%d/%m/%Y").time_format == "%d/%m/%Y"
    with pytest.raises(ValueError, match="--time-format"):
        given_mapping(None, "soon")


def test_lines_are_counted_from_one() -> None:
    assert (ExportMapping(header_row=2, data_row=4).head.header, ExportMapping(header_row=0).head.header) == (
        1,
        -1,
    )
