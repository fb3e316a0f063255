"""The command `loopsight monitor`: what it refuses."""

from __future__ import annotations

from tests.monitor.cli.tools import refused, run
from tests.support.waiting import free_port


def test_a_bad_configuration_names_file_and_field(tmp_path):
    """TOML that is none, a field that is unknown, a value that is wrong."""
    path = tmp_path / "m.toml"
    for text, names in (
        ("reorder_window = -1", "reorder_window"),
        ("colour = 1", "colour"),
        ("a b", "line 1"),
        ("loops = 5", "loops"),
        ('http = "9464"', "http: '9464', expected a host and a port"),
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
