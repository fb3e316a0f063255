"""What does not fit into memory goes through disk, to the same samples."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.adapters.historian import merge
from monitor.adapters.historian.clock import zone_of
from monitor.adapters.historian.merge import Span, sorted_samples
from monitor.adapters.historian.rows import Tally
from monitor.adapters.historian.tall_store import TagStore
from monitor.audit.inputs import find
from tests.monitor.adapters.historian.tools import by_loop, equal
from tests.support.export_families import FAMILIES, ZONE, base
from tests.support.samples import join


@pytest.mark.parametrize("family", ["ip21", "tag-files", "layout-wonderware"])
def test_in_parts_or_whole_it_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, family: str
) -> None:
    inputs = find([FAMILIES[family].write(base(), tmp_path)], None, tmp_path / "out")
    wanted = {loop.name: k for k, loop in enumerate(inputs.loops)}
    span, whole, parts = Span(zone=zone_of(ZONE)), Tally(), Tally()
    once = by_loop(join(list(sorted_samples(inputs.sources, wanted, span, whole))))
    monkeypatch.setattr(merge, "MOST_JOINED_VALUES", 1)
    equal(by_loop(join(list(sorted_samples(inputs.sources, wanted, span, parts)))), once)
    assert (parts.rows, parts.loop_rows, parts.texts) == (whole.rows, whole.loop_rows, whole.texts)


def test_a_part_is_read_once(tmp_path: Path) -> None:
    inputs = find([FAMILIES["ip21"].write(base(), tmp_path)], None, tmp_path / "out")
    (tmp_path / "store").mkdir()
    names = [loop.name for loop in inputs.loops]
    store = TagStore(
        tmp_path / "store", inputs.sources, [{names[0]: 0}, {n: k for k, n in enumerate(names) if k}], Tally()
    )
    assert [len(series.tag) for k in (0, 1) for _, series in store.part(k)] == [240, 480]
    assert not list((tmp_path / "store").iterdir())
