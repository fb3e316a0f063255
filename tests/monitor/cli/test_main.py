"""The command line: every command explains itself at once, and every error is one line with exit code 2."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from importlib.metadata import version

import pytest

from monitor.cli.main import COMMANDS
from tests.monitor.cli.tools import refused, run, started

HEAVY = ("numpy", "scipy", "numba", "pandas", "pyarrow", "zenoh", "rerun", "dask", "matplotlib", "sqlite3")
LIGHT = {"status", "check", "tune"}
"""Commands with a promise for their own run, not only for their help."""
LOADED = """
import sys
from monitor.cli import main as cli
sys.argv = ["loopsight", *{arguments!r}]
try:
    cli.main()
except SystemExit as end:
    code = end.code
print([m for m in {heavy!r} if m in sys.modules], code)
"""


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_has_an_example_and_loads_nothing_heavy(command):
    """At once: no numerical, network or drawing library is imported for it."""
    arguments = [command, "--help"] if command else ["--help"]
    began = time.perf_counter()
    done = started(*arguments)
    took = time.perf_counter() - began
    print(f"{command or 'loopsight'} --help: {took:.2f} s")
    assert done.returncode == 0
    assert re.search(rf"Examples?:\s+loopsight {command or 'demo'}", done.stdout)
    assert "\\b" not in done.stdout
    assert done.stderr == ""
    code = LOADED.format(arguments=arguments, heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[] 0"


def test_help_lists_every_command():
    """In the order of the contract's table, each with a line."""
    text = run("--help").stdout
    assert [line.split()[0] for line in text.partition("Commands:")[2].splitlines() if line.startswith("  ")][
        : len(COMMANDS)
    ] == list(COMMANDS)


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_version(command):
    """Of the program and of every command."""
    done = run(*([command] if command else []), "--version")
    assert (done.returncode, done.stdout.strip()) == (0, f"loopsight {version('loopsight')}")


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_an_unknown_option_is_one_line(command):
    """Exit 2, and the option is named."""
    refused(*([command] if command else []), "--colour", names="--colour")


def test_an_unknown_command_is_one_line():
    """Exit 2, and it is named."""
    refused("dance", names="dance")
