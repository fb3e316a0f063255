"""A wheel built from the tree works outside of it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from tests.support.places import ROOT

PACKAGES = ("tuners", "monitor", "sim_plants")


def files_of_the_tree() -> set[str]:
    """Every file of the packages that belongs into the wheel."""
    return {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".pyc"
    }


def done(*command: object, cwd: Path) -> str:
    """Run a command that must succeed; return what it prints."""
    environment = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "PYTHONHOME"}}
    found = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert found.returncode == 0, found.stderr
    return found.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built from a copy of the tree: what an earlier build has left beside it plays no part."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    done(
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--wheel-dir",
        folder,
        source,
        cwd=folder,
    )
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A fresh environment with the wheel in it; the libraries that it needs are those of this one."""
    folder = tmp_path_factory.mktemp("outside")
    venv.create(folder / "env", with_pip=True)
    python = folder / "env" / "bin" / "python"
    done(python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel, cwd=folder)
    (site,) = (folder / "env" / "lib").glob("python*/site-packages")
    # plain folders, behind its own: a tree that is installed to be edited is not found by way of them
    libraries = [path for path in sys.path if Path(path).name in {"site-packages", "dist-packages"}]
    (site / "libraries.pth").write_text("\n".join(libraries) + "\n", encoding="utf-8")
    return folder, python


@pytest.mark.slow
def test_all_of_the_tree_is_in_the_wheel(wheel):
    """Each module and each file of data, and nothing else but its metadata."""
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {name for name in names if ".dist-info/" not in name} == files_of_the_tree()


@pytest.mark.slow
def test_the_wheel_works_in_another_folder(installed):
    """The command, the module and the library."""
    folder, python = installed
    where = done(python, "-c", "import monitor.engine; print(monitor.engine.__file__)", cwd=folder)
    assert Path(where.strip()).is_relative_to(folder)
    loopsight = python.parent / "loopsight"
    assert "Usage: loopsight" in done(loopsight, "--help", cwd=folder)
    assert "Usage: loopsight" in done(python, "-m", "monitor", "--help", cwd=folder)
    words = "tune --gain 0.05 --dead-time 4 --rule simc-pi --block deltav-pid --json".split()
    assert json.loads(done(loopsight, *words, cwd=folder))["rule"] == "simc-pi"
