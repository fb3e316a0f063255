"""The command line: every command explains itself at once, and every error is one line with exit code 2."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from importlib.metadata import version

import pytest

from monitor.cli.main import COMMANDS
from tests.support.waiting import PATIENCE, free_port

HEAVY = ("numpy", "scipy", "numba", "pandas", "pyarrow", "zenoh", "rerun", "dask", "matplotlib", "sqlite3")
LIGHT = {"status", "check", "tune"}
"""Commands with a promise for their own run, not only for their help."""


def run(*arguments: str, timeout: float = PATIENCE) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "monitor", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )


def refused(*arguments: str, names: str = "") -> str:
    """Run what is wrong; return its one line."""
    done = run(*arguments)
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("loopsight: ")
    assert "Traceback" not in line
    assert names in line
    return line


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
    done = run(*arguments)
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
        :8
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


@pytest.mark.parametrize(
    "arguments",
    [
        ("demo", "--seconds", "soon"), ("demo", "--view", "tv"), ("demo", "--scenario", "x"),
        ("demo", "--speed", "0"),
        ("simulate", "--scenario", "x"), ("simulate", "--loops", "-1"),
        ("simulate", "--loops", "2", "--scenario", "demo"),
        ("simulate", "--plant", "missing.toml"), ("simulate", "--payload", "x"),
        ("monitor", "--config", "missing.toml"), ("monitor", "--loops", "missing.csv", "--state", "{tmp}"),
        ("monitor", "--listen", "nonsense", "--state", "{tmp}"), ("monitor", "--state", "{tmp}/file"),
        ("audit", "missing", "--loops", "missing.csv", "--out", "{tmp}"), ("check", "missing.csv"),
        ("view", "missing.rrd"),
        ("tune", "--rule", "x", "--gain", "1", "--dead-time", "1"),
    ],
    ids=" ".join,
)  # fmt: skip
def test_wrong_use_is_one_line(tmp_path, arguments):
    """Values that are none, files that are missing: exit 2, on stderr, no traceback."""
    (tmp_path / "file").write_text("")
    done = run(*(a.replace("{tmp}", str(tmp_path)) for a in arguments))
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "Traceback" not in done.stderr


def test_a_bad_configuration_names_file_and_field(tmp_path):
    """TOML that is none, a field that is unknown, a value that is wrong."""
    path = tmp_path / "m.toml"
    for text, names in (
        ("reorder_window = -1", "reorder_window"),
        ("colour = 1", "colour"),
        ("a b", "line 1"),
        ("loops = 5", "loops"),
    ):
        path.write_text(text)
        assert names in refused("monitor", "--config", str(path), names=str(path))


def test_a_key_expression_that_is_none_is_one_line(tmp_path):
    """Found when it is declared: the field and the value."""
    path = tmp_path / "m.toml"
    path.write_text('subscribe = ["plant/***"]\n')
    line = refused(
        "monitor", "--config", str(path), "--state", str(tmp_path), "--listen", f"tcp/127.0.0.1:{free_port()}"
    )
    assert "subscribe: 'plant/***'" in line


def test_a_bad_loop_table_names_each_row(tmp_path):
    """A line for each problem: file, row, field, value."""
    path = tmp_path / "loops.csv"
    path.write_text("name,kp,form\nA,x,standard\nB,1,odd\nA,1,standard\nC,1,standard\nC,1,standard\n")
    done = run(
        "monitor", "--loops", str(path), "--state", str(tmp_path), "--listen", f"tcp/127.0.0.1:{free_port()}"
    )
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    assert len(lines) == 3
    assert all(str(path) in line for line in lines)
    assert [n for n in ("kp", "form", "taken") if n in done.stderr] == ["kp", "form", "taken"]


def test_nobody_answers():
    """No router, and a router without a monitor: one line with the endpoint, exit 2."""
    from monitor.adapters.zenoh_bus import open_session  # noqa: PLC0415

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    refused("status", "--connect", endpoint, names=endpoint)
    session = open_session("router", listen=[endpoint])
    try:
        assert "no monitor answers" in refused("status", "--connect", endpoint, names=endpoint)
    finally:
        session.close()


def test_a_plant_without_a_monitor_is_one_line():
    """Nothing listens."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    refused("simulate", "--connect", endpoint, "--seconds", "1", names=endpoint)


def test_an_export_that_cannot_be_written_is_one_line(tmp_path):
    """A file where the folder should be."""
    (tmp_path / "x").write_text("")
    refused("simulate", "--scenario", "pumped-tank", "--hours", "0.01", "--out", str(tmp_path / "x"))
    refused("simulate", "--scenario", "pumped-tank", "--hours", "0.01", "--out", str(tmp_path / "x" / "y"))


def test_an_export_is_written(tmp_path):
    """Data, table and truth, with what the contract says of their columns."""
    out = tmp_path / "out"
    done = run("simulate", "--scenario", "pumped-tank", "--hours", "0.1", "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert {p.name for p in out.iterdir()} == {"data.parquet", "loops.csv", "truth.csv", "truth_events.csv"}
    assert (out / "truth.csv").read_text().startswith("loop,process,gain,t0,dead_time,lag")
    assert (out / "truth_events.csv").read_text().startswith("loop,kind,onset,amplitude")


def test_output_that_nobody_reads_is_no_error():
    """`loopsight tune --list | true`."""
    command = [sys.executable, "-m", "monitor", "tune", "--list"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        assert started.stderr is not None
        started.stdout.close()
        assert started.stderr.read() == ""
    assert started.returncode in {0, 1}  # click's own answer to a broken pipe
