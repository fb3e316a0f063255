"""Every module of the monitor that answers a question has its file of tests, in the folder of the same name."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.support.places import ROOT

MODULES = sorted(p for p in (ROOT / "monitor").rglob("*.py") if not p.name.startswith("__"))


def has_public_function(path: Path) -> bool:
    """Whether a module offers a function, or a class with a method of its own."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        inside = node.body if isinstance(node, ast.ClassDef) else [node]
        public = not isinstance(node, ast.ClassDef) or not node.name.startswith("_")
        if public and any(isinstance(n, ast.FunctionDef) and not n.name.startswith("_") for n in inside):
            return True
    return False


def named(path: Path) -> str:
    """A module as a path within the repository."""
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", [p for p in MODULES if has_public_function(p)], ids=named)
def test_every_module_has_its_tests(path: Path) -> None:
    tests = ROOT / "tests" / path.relative_to(ROOT).with_name(f"test_{path.name}")
    assert tests.is_file(), f"{named(path)}: expected its tests in {named(tests)}"
    assert "\ndef test_" in tests.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "monitor").rglob("test_*.py")), ids=named)
def test_every_file_of_tests_is_of_a_module(path: Path) -> None:
    """A file in a package's folder bears a module's name; what tests the whole lies above them."""
    inside = path.relative_to(ROOT / "tests" / "monitor")
    module = ROOT / "monitor" / inside.with_name(inside.name.removeprefix("test_"))
    assert len(inside.parts) == 1 or module.is_file(), f"{named(path)}: there is no {named(module)}"
