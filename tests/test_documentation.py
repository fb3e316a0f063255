"""What the documentation shows works: commands of the README, files in config/, help of every command."""

from __future__ import annotations

import re
import tomllib

import click
import msgspec
import pytest
from click.testing import CliRunner

from monitor.adapters.loop_table import read_loop_table
from monitor.cli.main import COMMANDS, loopsight
from monitor.contract.figures import MEANINGS
from monitor.service.config import Config, load, problems
from tests.support.places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_configuration_shown_is_the_default():
    """config/monitor.toml names every key, each with its default (but for the table beside it)."""
    path = ROOT / "config" / "monitor.toml"
    assert problems(path) == []
    shown = tomllib.loads(path.read_text(encoding="utf-8"))
    assert list(shown) == list(Config.__struct_fields__)
    assert msgspec.structs.replace(load(path), loops="") == Config()


def test_the_loop_table_shown_is_read():
    """config/loops.csv is a valid table."""
    table = read_loop_table(ROOT / "config" / "loops.csv")
    assert [loop.name for loop in table][:2] == ["LIC-101", "LIC-102"]


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_an_example(name):
    """Every command's help ends in an example that calls it, and it has --version."""
    found = CliRunner().invoke(loopsight, [name, "--help"])
    assert found.exit_code == 0
    assert f"loopsight {name}" in found.output.split("xample")[-1]
    assert "--version" in found.output


def lines_of_readme() -> list[str]:
    """Indented command lines of the README."""
    return re.findall(r"^ {4}(?:\S*/)?loopsight (.+)$", README, flags=re.MULTILINE)


@pytest.mark.parametrize("line", lines_of_readme())
def test_commands_of_the_readme_are_understood(line):
    """Each command shown has only options that exist."""
    name, *words = line.split()
    command = loopsight.get_command(click.Context(loopsight), name)
    assert command is not None
    known = {option for parameter in command.params for option in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= known | {"--help"}


def test_the_picture_of_the_readme_is_there():
    """The README's picture exists and is a PNG."""
    for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", README):
        assert (ROOT / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", MEANINGS)
def test_the_readme_says_what_a_health_figure_means(name):
    """The words of the view and of the README are the same."""
    meaning = MEANINGS[name]
    assert f"| `{name}` | {meaning.unit} | {meaning.says} | {meaning.do} |" in README
