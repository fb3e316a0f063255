"""Which module may import what: the directions of the design, read from the source, lazy imports included."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
OURS = {"tuners", "monitor", "sim_plants"}
STDLIB = set(sys.stdlib_module_names)

# Where a library may appear, by the file's path; everywhere else it may not.
HOME = {
    "zenoh": {"monitor/adapters/zenoh_bus.py"},
    "sqlite3": {"monitor/adapters/store.py"},
    "rerun": {f"monitor/adapters/{n}.py" for n in ("rerun_view", "rerun_process", "rerun_layout")},
    "socket": {"monitor/adapters/rerun_process.py"},  # looks for a free port
}
ARROW = {
    *(f"monitor/{n}.py" for n in ("wire", "frames", "view_data")),
    *(
        f"monitor/adapters/{n}.py"
        for n in ("historian", "layouts", "tables", "batches", "cells", "rows", "merge", "times")
    ),
}
CONTRACT = {"samples", "records", "loops", "wire", "frames", "quality"}
CORE = {
    *(
        "state",
        "windows",
        "kernel",
        "judge",
        "detect",
        "response",
        "fitting",
        "fits",
        "closedloop",
        "identify",
        "reference",
        "assess",
        "health",
        "harris",
        "oscillation",
        "sensor",
        "stiction",
        "resting",
        "travel",
        "wiring",
        "wild",
        "verdict",
        "case",
        "advise",
        "candidates",
        "region",
        "scan",
        "stages",
        "rows",
    ),
    *("engine", "order"),
}
OUTSIDE = {
    *("time", "socket", "sqlite3", "pyarrow", "rerun", "zenoh", "pandas", "threading", "os", "pathlib", "io"),
    *("datetime", "random", "logging", "subprocess", "multiprocessing", "asyncio", "click", "rich"),
}


def files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imported(path: Path) -> Iterator[str]:
    """Full names of all that a file imports, at any depth of nesting, relative imports resolved."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            base += node.module.split(".") if node.module else []
            yield ".".join(base)
            # ``from . import kernel`` imports a module too
            yield from (".".join([*base, alias.name]) for alias in node.names)
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if (
                name in {"import_module", "__import__"}
                and node.args
                and isinstance(node.args[0], ast.Constant)
            ):
                yield str(node.args[0].value)


def tops(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(path)}


def of_monitor(path: Path) -> set[str]:
    """Modules of `monitor` that a file imports (``adapters`` for any of them)."""
    return {
        parts[1] for name in imported(path) if (parts := name.split("."))[0] == "monitor" and len(parts) > 1
    } & {p.stem for p in (ROOT / "monitor").glob("*.py")} | (
        {"adapters"} if any(n.startswith("monitor.adapters") for n in imported(path)) else set()
    )


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", files("tuners"), ids=named)
def test_tuners_import_numbers_only(path):
    """numpy, scipy, the standard library and themselves."""
    assert tops(path) <= {"tuners", "numpy", "scipy"} | STDLIB


@pytest.mark.parametrize("path", files("monitor"), ids=named)
def test_what_judges_does_not_know_the_truth(path):
    """Only the command line, for its demo and simulation, imports the simulated plants."""
    if named(path) != "monitor/cli.py":
        assert "sim_plants" not in tops(path)


@pytest.mark.parametrize("name", sorted(CONTRACT & {p.stem for p in (ROOT / "monitor").glob("*.py")}))
def test_the_contract_imports_tuners_and_itself(name):
    """What comes in and goes out knows no engine and no driver."""
    path = ROOT / "monitor" / f"{name}.py"
    assert of_monitor(path) <= CONTRACT
    assert tops(path) & OURS <= {"tuners", "monitor"}


@pytest.mark.parametrize("name", sorted(CORE & {p.stem for p in (ROOT / "monitor").glob("*.py")}))
def test_the_core_is_pure(name):
    """No clock, file, socket, thread or library of the outside; no driver and no adapter."""
    path = ROOT / "monitor" / f"{name}.py"
    assert not tops(path) & OUTSIDE
    bytes_too = {"wire"} if name == "order" else set()  # it sorts the entries that payloads are decoded to
    assert of_monitor(path) <= CORE | CONTRACT - {"wire", "frames"} | bytes_too


@pytest.mark.parametrize("path", [p for package in sorted(OURS) for p in files(package)], ids=named)
def test_each_library_has_one_home(path):
    """zenoh, sqlite3, rerun and sockets in their adapter; pyarrow in the contract's bytes and the tables."""
    for library, homes in HOME.items():
        if library in tops(path):
            assert named(path) in homes or path.parts[-2] == "sim_plants", library
    if "pyarrow" in tops(path) and path.parts[-2] != "sim_plants":
        assert named(path) in ARROW


def test_the_reader_of_imports_is_not_fooled(tmp_path, monkeypatch):
    """Imports inside functions, relative ones and calls of the import machinery are all seen."""
    source = "def f():\n from . import kernel\n import time as t\n __import__('zenoh')\n from ..x import y\n"
    path = tmp_path / "monitor" / "adapters" / "a.py"
    path.parent.mkdir(parents=True)
    path.write_text(source)
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    assert {"monitor.adapters.kernel", "time", "zenoh", "monitor.x"} <= set(imported(path))
