"""What is kept compiled on disk is of today's sources, all of them."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from monitor.detect import kernel
from tests.support.places import ROOT
from tuners import compiled
from tuners.compiled import fingerprint

LIMITS = "LIMIT = {limit}\n"
CALLEE = """from tuners.compiled import jit
from .limits import (
    LIMIT,
)
@jit
def twice(x):
    return {factor} * x + LIMIT
"""
CALLER = """from tuners.compiled import jit
from tuners.parts import callee
twice = callee.twice
@jit
def run(x):
    return twice(x)
"""
PROGRAM = "from tuners import caller; print(caller.run(3.0), sum(caller.run.stats.cache_hits.values()))"


def run(folder: Path) -> tuple[float, int]:
    """What the compiled function says, and how often it was taken from disk."""
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=folder, capture_output=True, text=True, check=True,
        env={"PYTHONPATH": str(folder)},
    )  # fmt: skip
    value, hits = found.stdout.split()
    return float(value), int(hits)


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A package of three files, compiled as ours are."""
    parts = tmp_path / "tuners" / "parts"
    parts.mkdir(parents=True)
    shutil.copy(ROOT / "tuners" / "compiled.py", parts.parent)
    for name, text in (
        ("__init__.py", ""),
        ("parts/__init__.py", ""),
        ("caller.py", CALLER),
        ("parts/callee.py", CALLEE.format(factor=2)),
        ("parts/limits.py", LIMITS.format(limit=0)),
    ):
        (parts.parent / name).write_text(text)
    return tmp_path


@pytest.mark.slow
def test_a_change_in_another_file_is_seen(copied: Path) -> None:
    """In a function that is called, and in a constant that this one holds; what did not change comes from disk."""
    assert run(copied) == (6.0, 0)
    assert run(copied) == (6.0, 1)
    (copied / "tuners" / "parts" / "callee.py").write_text(CALLEE.format(factor=5))
    assert run(copied) == (15.0, 0)
    (copied / "tuners" / "parts" / "limits.py").write_text(LIMITS.format(limit=1))
    assert run(copied) == (16.0, 0)
    assert run(copied) == (16.0, 1)
    kept = list((copied / "tuners" / "__pycache__").glob("caller.run*"))
    assert sorted(p.suffix for p in kept) == [".nbc", ".nbi"]  # in place of the old, not beside it


def test_the_kernel_rests_on_the_files_that_it_calls() -> None:
    """By way of others, too: baseline is called by phases, which the kernel calls."""
    path = ROOT / "monitor" / "detect" / "kernel.py"
    seen, new = {path}, [path]
    while new:
        other = compiled._read(new.pop())[1]
        new += [p for p in other if p not in seen]
        seen.update(other)
    names = {p.relative_to(ROOT).as_posix() for p in seen}
    assert {f"monitor/detect/{n}.py" for n in ("state", "phases", "baseline", "window")} <= names
    assert not any(
        name.startswith(("monitor/service/", "monitor/cli/", "monitor/verdict/")) for name in names
    )


def test_a_function_is_kept_by_all_that_it_rests_on() -> None:
    """numba's inner parts are as they were when this was written; otherwise its plain cache serves, and this tells."""
    stamp = kernel.run._cache._cache_file._source_stamp
    assert stamp[1] == fingerprint(Path(kernel.__file__))


def test_sources_that_are_no_files_leave_numbas_own_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    def unreadable(path: Path) -> str:
        raise OSError(path)

    monkeypatch.setattr(compiled, "fingerprint", unreadable)

    def plus_one(x: float) -> float:
        return x + 1

    assert compiled.jit(plus_one)(1.0) == 2.0


def test_a_numba_that_is_switched_off_leaves_the_function(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.config.DISABLE_JIT", 1)

    def plus_one(x: float) -> float:
        return x + 1

    assert compiled.jit(plus_one) is plus_one


@pytest.mark.parametrize("inside", [False, True])
def test_a_class_that_is_gone_makes_what_was_kept_of_it_old(copied: Path, inside: bool) -> None:
    """An index on disk names the classes of the arguments: one that was renamed, or its whole file, is no crash."""
    caller, shape = copied / "tuners" / "caller.py", copied / "tuners" / "parts" / "shape.py"
    record = "from typing import NamedTuple\nclass {name}(NamedTuple):\n    x: float\n"
    calls = (
        "from tuners.compiled import jit\nfrom tuners.parts.{file} import {name}\n"
        "@jit\ndef kept(p):\n    return {factor} * p.x\n"
        "def run(x):\n    return kept({name}(x))\nrun.stats = kept.stats\n"
    )
    shape.write_text(record.format(name="Old"))
    caller.write_text(calls.format(file="shape", name="Old", factor=2))
    assert run(copied) == (6.0, 0)
    file = "shape" if inside else "form"
    shape.unlink()
    (shape.parent / f"{file}.py").write_text(record.format(name="New"))
    caller.write_text(calls.format(file=file, name="New", factor=3))
    assert run(copied) == (9.0, 0)
    assert run(copied) == (9.0, 1)
