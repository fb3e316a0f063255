"""The directions of the house, read from the source, imports inside functions too: what may import what."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
OURS = ("tuners", "monitor", "sim_plants")
MOST_LINES = 400

CORE = ("contract", "health", "reporting", "detect", "identify", "assess", "advise", "verdict", "engine")
STATIONS: dict[str, tuple[str, ...]] = {
    "compiled": ("tuners",),
    "by_size": ("compiled",),
    "contract": ("tuners",),
    "health": ("compiled", "by_size"),
    "reporting": ("compiled", "contract"),
    "detect": ("compiled", "by_size", "contract", "health"),
    "identify": ("compiled", "by_size", "contract", "detect.event", "tuners"),
    "assess": ("by_size", "contract", "detect.event", "identify", "tuners"),
    "advise": ("compiled", "contract", "identify", "assess", "tuners"),
    "verdict": ("by_size", "contract", "detect.event", "health", "identify", "assess", "advise", "tuners"),
    "memory": (*(s for s in CORE if s != "engine"), "tuners"),
    "samples_seen": ("detect", "reporting", "verdict.stale"),
    "engine": (*(s for s in CORE if s != "engine"), "memory", "samples_seen", "compiled", "tuners"),
    "wire": ("contract",),
    "adapters": ("contract", "wire", "compiled"),
    "view": ("contract", "wire", "adapters"),
    "report": ("contract",),
    "service": (
        *(
            "compiled",
            "contract",
            "engine",
            "memory",
            "verdict.stale",
            "verdict.together",
            "wire",
            "adapters",
        ),
        "view.process",
    ),
    "compare": ("contract", "adapters", "report"),
    "audit": ("compiled", "contract", "engine", "verdict", "adapters", "report", "compare"),
    "importing": ("contract", "adapters", "audit", "check_controller"),
    "check": ("contract", "advise", "adapters", "service.config", "check_controller"),
    "check_controller": ("contract", "detect.event", "identify"),
    "cli": ("tuners", *CORE, "wire", "adapters", "service", "audit", "compare", "view", "check", "importing"),
    "__main__": ("cli",),
    "__init__": (*CORE, "adapters.loop_table", "audit"),
}
"""Package or module of `monitor`, and what of ours it may import beside itself."""
PLANTS_AT = {"monitor/cli/demo.py", "monitor/cli/simulate.py"}
"""What judges must not know the truth: only these start or make simulated plants."""

PURE = ("compiled", "by_size", "memory", "samples_seen", *CORE)
OUTSIDE = {
    *("time", "datetime", "os", "pathlib", "io", "logging", "threading", "subprocess", "socket", "random"),
    *("multiprocessing", "asyncio", "sqlite3", "click", "rich", "pyarrow", "pandas", "zenoh", "rerun"),
}
"""A station knows no clock, file, socket, thread and log."""
FOR_A_REASON = {
    "monitor/contract/times.py": {"datetime"},  # reads and writes times; looks at no clock
}

HOMES: dict[str, set[str]] = {
    "numba": {"tuners/compiled.py", "sim_plants/kernel.py"},
    "zenoh": {"monitor/adapters/zenoh_bus.py"},
    "sqlite3": {"monitor/adapters/store.py"},
    "rerun": {
        f"monitor/adapters/rerun_view/{n}.py" for n in ("fleet", "layout", "panes", "picture", "series")
    },
    "socket": {f"monitor/adapters/{n}.py" for n in ("http", "rerun_view/process", "systemd")},
    "prometheus_client": {"monitor/service/metrics.py"},
    "pyarrow": {
        *(f"monitor/wire/{n}.py" for n in ("arrow", "decode")),
        *(
            f"monitor/adapters/historian/{n}.py"
            for n in ("csv_files", "excel_files", "parquet", "reader", "source", "time_formats")
        ),
        "monitor/adapters/tables.py",
        "sim_plants/export.py",
        "sim_plants/payloads.py",
    },
    "pandas": {
        "monitor/adapters/loop_table.py",
        *(f"monitor/adapters/historian/{n}.py" for n in ("cells", "clock")),
        *(f"sim_plants/{n}.py" for n in ("export", "export_layouts")),
    },
    "python_calamine": {"monitor/adapters/historian/excel_files.py"},
    "click": {
        f"monitor/cli/{n}.py" for n in ("audit", "check", "common", "compare", "demo", "importing", "main")
    }
    | {f"monitor/cli/{n}.py" for n in ("monitor", "report", "simulate", "status", "tune", "view")},
    "rich": {f"monitor/cli/{n}.py" for n in ("audit_show", "compare_show", "demo_show", "tune")},
    "distributed": {"monitor/audit/tasks.py"},
    "matplotlib": {"monitor/cli/tune.py"},
    "jinja2": {"monitor/report/page.py"},
    "xlsxwriter": {"monitor/adapters/workbook.py"},
}
"""Where a library is at home: exactly there."""


def files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def module(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module(p): p for package in OURS for p in files(package)}


def station(name: str) -> str:
    """The package or single module of `monitor` to which a module belongs."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def names_of(path: Path) -> Iterator[str]:
    """Full names of all that a file imports, at any depth of nesting, relative imports resolved."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            start = ".".join(filter(None, (base, node.module)))
            yield from (f"{start}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from (a.value for a in node.args if isinstance(a, ast.Constant))


@cache
def imported(path: Path) -> frozenset[str]:
    """Modules of ours that a file imports, and the top names of all others."""
    out = set()
    for name in names_of(path):
        if name.split(".")[0] in OURS:
            out.add(name if name in MODULES else name.rpartition(".")[0])
        else:
            out.add(name.split(".")[0])
    return frozenset(out)


@pytest.mark.parametrize("path", files("monitor"), ids=named)
def test_every_import_is_in_the_table(path: Path) -> None:
    """No file lies outside of the table, and none imports what its station may not."""
    own = "__init__" if path == ROOT / "monitor" / "__init__.py" else station(module(path))
    assert own in STATIONS, f"{named(path)}: add its package to the table, on purpose"
    for name in sorted(n for n in imported(path) if n.split(".")[0] in OURS):
        if name.startswith("sim_plants"):
            assert named(path) in PLANTS_AT, f"{named(path)} imports {name}"
            continue
        what = name.removeprefix("monitor.")
        allowed = what.split(".")[0] == own or any(
            what == may or what.startswith(f"{may}.") for may in STATIONS[own]
        )
        assert allowed, (
            f"{named(path)} imports {name}: {own} may import {', '.join(STATIONS[own]) or 'nothing'}"
        )


def test_the_table_has_no_other_rows() -> None:
    """Nothing is left in the table of what is gone."""
    assert {station(m) for m in MODULES if m.startswith("monitor.")} | {"__init__"} == set(STATIONS)


def test_no_circles() -> None:
    """No file imports itself by way of others, imports inside functions counted."""
    done: set[str] = set()

    def visit(name: str, way: tuple[str, ...]) -> None:
        assert name not in way, " -> ".join((*way[way.index(name) :], name))
        if name in done:
            return
        for other in sorted(n for n in imported(MODULES[name]) if n in MODULES and n != name):
            visit(other, (*way, name))
        done.add(name)

    for name in MODULES:
        visit(name, ())


@pytest.mark.parametrize("path", [p for p in files("monitor") if station(module(p)) in PURE], ids=named)
def test_a_station_is_pure(path: Path) -> None:
    assert imported(path) & OUTSIDE == FOR_A_REASON.get(named(path), set())


@pytest.mark.parametrize("library", HOMES)
def test_a_library_is_exactly_at_home(library: str) -> None:
    found = {named(p) for package in OURS for p in files(package) if library in imported(p)}
    assert found == HOMES[library]


def test_tuners_need_numpy_scipy_and_numba_only() -> None:
    tops = {name.split(".")[0] for path in files("tuners") for name in imported(path)}
    assert tops - set(sys.stdlib_module_names) <= {"tuners", "numpy", "scipy", "numba", "__future__"}


def test_simulated_plants_take_names_only() -> None:
    """They publish through wire and adapters, and integrate their plants themselves."""
    for path in files("sim_plants"):
        ours = {n for n in imported(path) if n.split(".")[0] == "monitor"}
        assert {station(n) for n in ours} <= {"wire", "adapters", "contract"}, named(path)


@pytest.mark.parametrize("path", [p for package in OURS for p in files(package)], ids=named)
def test_a_file_answers_one_question(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


@pytest.mark.parametrize("path", [p for package in OURS for p in files(package)], ids=named)
def test_a_function_fits_a_screen(path: Path) -> None:
    """Sixty lines, eight parameters (the compiled ones take as many columns as there are)."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef):
            continue
        compiled = any("jit" in ast.unparse(d) for d in node.decorator_list)
        assert (node.end_lineno or 0) - node.lineno + 1 <= 60, f"{node.name}: too long"
        parameters = len(node.args.args) + len(node.args.kwonlyargs) + len(node.args.posonlyargs)
        own = parameters - (bool(node.args.args) and node.args.args[0].arg in {"self", "cls"})
        assert compiled or own <= 8, f"{node.name}: {own} parameters"


def test_a_wrong_import_would_be_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test itself: relative, nested and plain imports are found."""
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    path = tmp_path / "monitor" / "adapters" / "a.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        "from . import kernel\nimport time\n"
        "def f():\n    import zenoh\n    from ..x import y\n    import_module('dask')\n"
    )
    assert {"monitor.adapters.kernel", "time", "zenoh", "monitor.x.y", "dask"} <= set(names_of(path))
