"""The layout: a tab for each loop, with the charts for which there is something."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import rerun.blueprint as rrb

from monitor.adapters.rerun_view.panes import GROUP_TABS, blueprint
from monitor.contract.evidence import Pane, Response

EVENT = Pane("A", 0, 10, "A: step")
RESPONSE = Response("load", 0, 10, "Predicted: load step")


def tabs(panes: list[Pane], active: str | None = None, modelled: tuple[str, ...] = ("A",)) -> rrb.Tabs:
    made = blueprint(panes, {}, modelled, active, started=True)
    found: rrb.Tabs = made.root_container.contents[1]  # type: ignore[assignment,union-attr]
    return found


def views(part: Any) -> Iterator[str]:
    """Names of all views inside."""
    if isinstance(part, rrb.Container):
        for one in part.contents:
            yield from views(one)
    else:
        yield str(part.name)


@pytest.mark.parametrize(
    ("pane", "modelled", "shown"),
    [
        (EVENT._replace(recent=(0, 0)), ("A",), ["A: step", "A: PV less model", "A: OP"]),
        (EVENT._replace(recent=(0, 0)), (), ["A: step", "A: OP"]),
        (EVENT, (), ["A: step", "A: OP", "A: now", "A: OP now"]),
        (Pane("A", 0, 0, recent=(0, 5)), (), ["A: newest samples", "A: OP newest samples"]),
        (EVENT._replace(responses=(RESPONSE,), recent=(0, 0)), (), ["A: step", "A: OP", RESPONSE.name]),
    ],
)
def test_a_tab_has_the_charts_for_which_there_is_something(
    pane: Pane, modelled: tuple[str, ...], shown: list[str]
) -> None:
    assert list(views(tabs([pane], modelled=modelled).contents[1])) == [*shown, "Advice"]


def test_the_fleet_lies_in_front_or_the_loop_that_is_new() -> None:
    panes = [EVENT, EVENT._replace(loop="B")]
    assert [part.name for part in tabs(panes).contents] == ["Fleet", "A", "B", "Side by side"]
    assert tabs(panes).active_tab == 0
    assert tabs(panes, "B").active_tab == 2
    assert [part.name for part in tabs([]).contents] == ["Fleet"]


def test_many_loops_come_by_the_dozen() -> None:
    """The one in front is open, and the dozen that holds it."""
    panes = [EVENT._replace(loop=f"L{k}") for k in range(2 * GROUP_TABS + 1)]
    found = tabs(panes, "L13")
    assert [part.name for part in found.contents[1:-1]] == ["1 to 12", "13 to 24", "25 to 25"]
    assert found.active_tab == 2
    assert found.contents[2].active_tab == 1  # type: ignore[union-attr]
