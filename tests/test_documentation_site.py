"""The documentation is built by its one command, without a warning."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support.places import ROOT

pytest.importorskip("sphinx", reason="needs the extra [docs]")
pytest.importorskip("furo", reason="needs the extra [docs]")
pytest.importorskip("myst_parser", reason="needs the extra [docs]")


@pytest.mark.slow
def test_the_site_is_built_without_warnings(tmp_path):
    """Every page is there, and every module has one."""
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-d", str(tmp_path / "doctrees")]
    done = subprocess.run(
        [*command, "docs", str(tmp_path / "html")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    html = tmp_path / "html"
    for page in (ROOT / "docs").glob("*.md"):
        assert (html / f"{page.stem}.html").exists()
    for package in ("tuners", "monitor", "sim_plants"):
        for file in (ROOT / package).rglob("*.py"):
            if file.name.startswith("__"):
                continue
            name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            assert (html / "api" / f"{name}.html").exists(), name
    assert (html / "_images" / "way.svg").exists()
