"""Vendor blocks as data."""

from __future__ import annotations

import pytest

from tuners.blocks import BLOCKS, Block, find_block


def test_rows_from_general_knowledge_are_not_verified():
    for block in BLOCKS.values():
        assert block.source
        if "general knowledge" in block.source or "to be checked" in block.source:
            assert not block.verified


def test_unknown_block_or_unit():
    with pytest.raises(ValueError, match="deltav-pid"):
        find_block("deltav")
    with pytest.raises(ValueError, match="unknown unit"):
        Block("x", "x", ["standard"], "K", "I", "hours", "D", "s", "x", True)
