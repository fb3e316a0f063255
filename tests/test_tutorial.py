"""The tutorial's commands and lines of Python, run one after the other as a reader does."""

from __future__ import annotations

import doctest
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.places import ROOT

TUTORIAL = ROOT / "docs" / "tutorial.md"


def blocks() -> list[tuple[str, str]]:
    """Language and text of each fenced block."""
    return re.findall(
        r"^```(\w+)\n(.*?)^```$", TUTORIAL.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


def said_by(command: str, folder: Path) -> str:
    """Run `loopsight ...` in a folder; return what it prints."""
    name, *words = shlex.split(command)
    assert name == "loopsight"
    done = subprocess.run(
        [sys.executable, "-m", "monitor", *words],
        cwd=folder,
        env=os.environ | {"COLUMNS": "160", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_tutorial_from_top_to_bottom(tmp_path, monkeypatch):
    """Each command succeeds and prints the lines that are shown; each line of Python gives what is shown."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    wrong: list[str] = []
    for number, (language, block) in enumerate(blocks()):
        if language == "console":
            command, *shown = block.splitlines()
            said = " ".join(said_by(command.removeprefix("$ "), tmp_path).split())
            for line in shown:
                assert " ".join(line.split()) in said
        else:
            test = doctest.DocTestParser().get_doctest(block, names, f"block {number}", str(TUTORIAL), 0)
            test.globs = names  # what one block defines the next one knows
            runner.run(test, out=wrong.append, clear_globs=False)
    assert not runner.failures, "".join(wrong)
    assert runner.tries > 15
