"""What the view draws on: Rerun's picture is it, and so are the tests' own."""

from __future__ import annotations

import inspect

from monitor.adapters.rerun_view.picture import Picture
from monitor.view.drawing import Drawing


def test_the_picture_is_a_drawing() -> None:
    """Method by method, with the same parameters."""
    methods = [
        name for name, _ in inspect.getmembers(Drawing, inspect.isfunction) if not name.startswith("_")
    ]
    assert methods == ["answers", "fleet", "layout", "log", "page", "trend", "window"]
    for name in methods:
        wanted, offered = (inspect.signature(getattr(one, name)).parameters for one in (Drawing, Picture))
        assert [str(p) for p in wanted.values()] == [str(p) for p in offered.values()], name
