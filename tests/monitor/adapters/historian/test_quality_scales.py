"""Scales of qualities."""

from __future__ import annotations

import pytest

from monitor.adapters.historian.quality_scales import quality_scale


@pytest.mark.parametrize(
    ("heading", "cells", "headings", "scale"),
    [
        ("Quality", ["0", "1", "133"], ["DateTime", "TagName"], "wonderware"),
        ("Quality", ["0", "16"], [], "wonderware"),
        ("OPCQuality", ["192", "0"], ["DateTime", "TagName"], "opc"),
        ("quality", ["100", "0", "50"], [], "percent"),
        ("confidence", ["0"], [], "percent"),
        ("Good", ["1", "0"], [], "bool"),
        ("Quality", ["Good", "Bad"], [], ""),
        ("q", ["64", "24"], [], "opc"),
    ],
)
def test_scales(heading: str, cells: list[str], headings: list[str], scale: str) -> None:
    assert quality_scale(heading, cells, headings) == scale


def test_zeros_alone_may_be_good_or_bad() -> None:
    with pytest.raises(ValueError, match=r"Quality: qualities 0 may be good or bad; .* quality_scale"):
        quality_scale("Quality", ["0", "0"], ["time", "tag"])
