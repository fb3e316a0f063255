"""The bad-data matrix is whole: no row without a test, no test that is not there."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

from tests.bad_data.matrix import INSTEAD, ROWS
from tests.support.places import ROOT


@cache
def functions(path: Path) -> frozenset[str]:
    """Names of the tests in a file, or in all files of a folder."""
    if path.is_dir():
        return frozenset().union(*(functions(p) for p in path.rglob("test_*.py")))
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return frozenset(
        n.name for n in tree.body if isinstance(n, ast.FunctionDef) and n.name.startswith("test")
    )


def test_no_row_is_missing() -> None:
    """64 rows, each with its trouble in words and at least one test."""
    assert list(ROWS) == list(range(1, 65))
    assert all(trouble and tests for trouble, tests in ROWS.values())
    assert set(INSTEAD) <= set(ROWS)
    assert all(said.endswith(".") for said in INSTEAD.values())


@pytest.mark.parametrize("row", ROWS)
def test_the_tests_of_a_row_exist(row: int) -> None:
    """Each named test stands somewhere."""
    assert set(ROWS[row][1]) <= functions(ROOT / "tests")


def test_no_test_of_the_matrix_is_forgotten() -> None:
    """What is tested here belongs to a row."""
    named = {name for _, tests in ROWS.values() for name in tests}
    here = {f for p in Path(__file__).parent.glob("test_*.py") if p != Path(__file__) for f in functions(p)}
    assert here - named == {"test_every_refused_sample_has_one_cause"}
