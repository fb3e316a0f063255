"""docs/nomenclature.md and the code use the same names and units."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import pytest

from monitor.contract.loops import Loop
from monitor.contract.records import Assessment, LoopRow
from tests.support.places import ROOT

PAGE = (ROOT / "docs" / "nomenclature.md").read_text(encoding="utf-8")
NAMES = set(re.findall(r"`([a-z_][a-z_0-9]*)`", PAGE))
UNIT = r"\[([^\[\]]+)\]"


class Use(NamedTuple):
    """A parameter where it stands in a public signature."""

    name: str
    where: str
    said: str
    """What its docstring says."""


def documented(docstring: str) -> dict[str, str]:
    """Texts of a docstring's section of parameters (numpydoc), by name."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w.*\n-+\n|\Z)", docstring, re.MULTILINE | re.DOTALL)
    found: dict[str, str] = {}
    names: list[str] = []
    for line in section.group(1).splitlines() if section else ():
        if re.match(r"\S", line):
            names = [name.strip() for name in line.split(" : ")[0].split(",")]
            found.update(dict.fromkeys(names, ""))
        for name in names if line.startswith(" ") else ():
            found[name] = f"{found[name]} {line.strip()}".strip()
    return found


def public(body: list[ast.stmt], where: str) -> Iterator[Use]:
    """Parameters of the public functions and methods of a module or class."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public(node.body, f"{where}.{node.name}")
            # a dataclass documents its fields as parameters
            yield from (
                Use(name, f"{where}.{node.name}", said)
                for name, said in documented(inspect.cleandoc(ast.get_docstring(node) or "")).items()
            )
        if isinstance(node, ast.FunctionDef) and (
            not node.name.startswith("_") or node.name in {"__init__", "__call__"}
        ):
            taken = node.args
            every = [*taken.posonlyargs, *taken.args, *taken.kwonlyargs, taken.vararg, taken.kwarg]
            said = documented(inspect.cleandoc(ast.get_docstring(node) or ""))
            names = [a.arg for a in every if a is not None]
            yield from (
                Use(name, f"{where}.{node.name}", said.get(name, ""))
                for name in names
                if name not in {"self", "cls"} and not name.startswith("_")
            )


@cache
def uses() -> list[Use]:
    """Every parameter of every public function of `tuners` and `monitor`."""
    found: list[Use] = []
    for package in ("tuners", "monitor"):
        for path in sorted((ROOT / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            found += public(tree.body, ".".join(path.relative_to(ROOT).with_suffix("").parts))
    return found


def units() -> dict[str, set[str]]:
    """Units of each quantity by the page's tables of three columns; of names that have one."""
    found: dict[str, set[str]] = {}
    for names, unit in re.findall(r"^\| (`[^|]+) \| ([^|]*)\| [^|]+ \|$", PAGE, re.MULTILINE):
        for name in re.findall(r"`(\w+)`", names):
            if unit.strip():
                found.setdefault(name, set()).update(re.findall(UNIT, unit))
    return found


def columns() -> set[str]:
    """Columns of the loop table and of the results, without what marks an interval or a suggestion."""
    names = (*Loop.__struct_fields__, *LoopRow.__struct_fields__, *Assessment.__struct_fields__)
    return {re.sub(r"^new_|_lo$|_hi$|_seen$", "", name) for name in names}


def test_every_public_parameter_has_its_place():
    """A new name is looked up on the page first, and put there on purpose."""
    strange = {use.name: use.where for use in uses() if use.name not in NAMES}
    assert not strange, f"not in docs/nomenclature.md: {strange}"


def test_every_column_has_its_place():
    """So is every column of loop table and results."""
    assert columns() <= NAMES


def identifiers() -> set[str]:
    """Names and words that the code uses for anything, its folders among them."""
    found = columns() | {folder.name for folder in (ROOT / "monitor").iterdir()}
    for package in ("tuners", "monitor"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.arg | ast.keyword):
                    found.add(str(node.arg))
                elif isinstance(node, ast.Name | ast.Attribute):
                    found.add(node.id if isinstance(node, ast.Name) else node.attr)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.add(node.value)
    return found


def test_the_page_names_nothing_that_is_gone():
    """A name whose last use went goes, too."""
    gone = {name for name in NAMES if not name.startswith("_") and not name.endswith("_")} - identifiers()
    assert not gone, f"in docs/nomenclature.md, and nowhere else: {sorted(gone)}"


@pytest.mark.parametrize("name", sorted(units()))
def test_a_quantity_has_one_unit(name):
    """Where a docstring gives a unit, it is one of the page's."""
    for use in uses():
        said = re.findall(UNIT, use.said) if use.name == name and re.search(rf"{UNIT}\.?$", use.said) else []
        # what is said of several names at once gives a unit for each of them
        given = {unit.split(",")[0] for unit in said}  # "[s, monotonic]" is in seconds
        assert not said or units()[name] & given, f"{use.where}: {name} in {said}"
