"""Configuration: a file, what overrides it, and one line that names what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.service.config import Config, ConfigError, load, problems


def written(folder: Path, text: str) -> Path:
    path = folder / "monitor.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_defaults_hold_without_a_file():
    """Nothing has to be set."""
    config = load(None)
    assert config == Config()
    assert (config.reorder_window, config.future, config.subscribe) == (2.0, 60.0, ["plant/**"])
    assert not config.auto_register


def test_the_command_line_overrides_the_file(tmp_path):
    """What is given there wins; what is not leaves the file's; a table lies beside the file that names it."""
    path = written(
        tmp_path, 'loops = "loops.csv"\nlisten = ["tcp/127.0.0.1:1"]\nreorder_window = 5\nstate = "s"\n'
    )
    config = load(path, listen=["tcp/127.0.0.1:2"], connect=None, state=None)
    assert (config.listen, config.reorder_window, config.state) == (["tcp/127.0.0.1:2"], 5.0, "s")
    assert Path(config.loops) == tmp_path / "loops.csv"
    assert load(path, loops="other.csv").loops == "other.csv"


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("reorder_window = -1", "reorder_window"), ("reorder_window = nan", "reorder_window"),
        ("reorder_window = 'a'", "reorder_window"), ("reorder_window = 3601", "reorder_window"),
        ("future = 0", "future"), ("future = inf", "future"), ("future = nan", "future"), ("tick = 0", "tick"),
        ("tick = 2", "tick"), ("view = 'tv'", "view"),
        ("subscribe = []", "subscribe"), ("subscribe = 'plant/**'", "subscribe"),
        ("listen = 'tcp/127.0.0.1:1'", "listen"), ("id = ''", "id"), ("id = 'a/b'", "id"),
        ('id = "a\\u001b[31m"', "id"), ("loops = 5", "loops"), ("auto_register = 1", "auto_register"),
        ("colour = 'blue'", "colour"), ("= 3", "line 1"), ("loops = [", "end of document"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, text, field):
    """One line: the file, the field, and what is accepted."""
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as error:
        load(path)
    line = str(error.value)
    assert line.startswith(str(path))
    assert field in line
    assert "\n" not in line
    assert line.isprintable()
    assert problems(path) == [line]


def test_files_that_cannot_be_read(tmp_path):
    """Missing, a folder, not UTF-8: one line each."""
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe")
    for path in (tmp_path / "missing.toml", tmp_path, tmp_path / "x.toml"):
        with pytest.raises(ConfigError) as error:
            load(path)
        assert str(error.value).startswith(f"{path}: ")


def test_where_the_state_lies(monkeypatch):
    """As configured, else systemd's folder, else the user's."""
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/x")
    assert Config(state="here").state_folder == Path("here")
    assert Config().state_folder == Path("/var/lib/x")
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", "/home/u/s")
    assert Config().state_folder == Path("/home/u/s/loopsight")
