"""What the documentation shows works: commands, files in config/, help of every command, words, links, pictures."""

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
from monitor.contract.records import WORST_FIRST
from monitor.contract.status import NOT_READY
from monitor.detect.event import STATES
from monitor.service.config import Config, load, problems
from monitor.service.metrics import COUNTERS
from monitor.verdict.stale import STALE
from monitor.verdict.tree import TREE
from tests.support.places import ROOT
from tests.test_imports import STATIONS

PAGES = sorted(
    str(path.relative_to(ROOT)) for folder in (ROOT, ROOT / "docs") for path in folder.glob("*.md")
)


def text(page: str) -> str:
    """Read a page."""
    return (ROOT / page).read_text(encoding="utf-8")


README = text("README.md")
VERDICTS = text("docs/verdicts.md")


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


def commands_shown() -> list[str]:
    """Command lines of all pages: indented, or after a prompt."""
    found = (
        line
        for page in PAGES
        for line in re.findall(r"^(?: {4}|\$ )(?:\S*/)?loopsight (.+)$", text(page), re.MULTILINE)
    )
    return list(dict.fromkeys(found))


@pytest.mark.parametrize("line", commands_shown())
def test_commands_shown_are_understood(line):
    """Each command shown has only options that exist."""
    name, *words = line.split()
    command = loopsight.get_command(click.Context(loopsight), name)
    assert command is not None
    known = {option for parameter in command.params for option in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= known | {"--help"}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    """Each file that a page links to, or shows, is there; a picture is one."""
    for mark, name in re.findall(r"(!?)\[[^]]*\]\(([^)#\s]+)[^)]*\)", text(page)):
        if "://" in name:
            continue
        target = (ROOT / page).parent / name
        assert target.exists(), name
        if mark:
            picture = target.read_bytes()
            assert picture.startswith((b"\x89PNG", b"<svg "))


@pytest.mark.parametrize("name", MEANINGS)
def test_the_readme_says_what_a_health_figure_means(name):
    """The words of the view and of the README are the same."""
    meaning = MEANINGS[name]
    line = f"| `{name}` | {meaning.unit} | {meaning.says} | {meaning.do} |"
    assert line in README
    assert line in VERDICTS


# ---- verdicts and flags


def rows_of(page: str) -> dict[str, list[str]]:
    """Rows of a page's tables by what stands in backticks in their first cell."""
    rows = re.findall(r"^\| `([^`]+)` \|(.+)\|$", page, re.MULTILINE)
    return {name: [cell.strip() for cell in rest.split("|")] for name, rest in rows}


def test_every_flag_is_explained():
    """docs/verdicts.md has each flag once, and none that there is not."""
    flags = re.findall(
        r"^\| `([^`]+)` \|",
        VERDICTS.split("## Flags")[1].split("## The verdict of an event")[0],
        re.MULTILINE,
    )
    assert sorted(flags) == sorted({b.flag for b in TREE if b.flag} | {STALE})


@pytest.mark.parametrize("branch", [b for b in TREE if b.flag], ids=lambda b: f"{b.flag}-{b.effect}")
def test_a_flag_is_explained_as_it_is(branch):
    """Its effect and its action are those of the tree."""
    effect, _, _, action = rows_of(VERDICTS.split("## The figures")[0])[branch.flag]
    assert branch.effect in effect
    assert branch.action in action


@pytest.mark.parametrize("verdict", WORST_FIRST)
def test_every_verdict_is_explained(verdict):
    """docs/verdicts.md defines each verdict."""
    assert re.search(rf"^`{verdict}`\n: ", VERDICTS, re.MULTILINE)


@pytest.mark.parametrize("state", [s for s in STATES if s])
def test_every_end_of_an_event_is_explained(state):
    """So are the words for how an event ended."""
    assert f"`{state}`" in VERDICTS.split("`state` says")[1]


# ---- operation


def test_every_alarm_and_counter_is_explained():
    """docs/operation.md has each reason why a monitor is not ready, and each counter, and none that there is not."""
    alarms = text("docs/operation.md").split("## Alarms")[1].split("## Backup")[0]
    assert set(rows_of(alarms)) == {*NOT_READY, "starting", "stalled", *COUNTERS}


# ---- the layers, drawn and listed


def stations() -> dict[str, tuple[str, ...]]:
    """What `test_imports.py` allows."""
    return {name: may for name, may in STATIONS.items() if not name.startswith("__")}


def test_the_architecture_shows_the_table_of_imports():
    """Each station stands in docs/architecture.md, in the table's order; where names are given, all of them."""
    rows = {
        n.removeprefix("monitor."): r
        for n, r in rows_of(text("docs/architecture.md")).items()
        if "monitor." in n
    }
    assert list(rows) == list(stations())
    for name, may in stations().items():
        shown = rows[name][-1]
        if shown.startswith("`"):
            assert sorted(re.findall(r"[\w.]+", shown)) == sorted(may), name


def test_contributing_names_every_station():
    """Each layer has its sentence."""
    said = re.findall(r"`monitor/(\w+)(?:\.py)?`", text("CONTRIBUTING.md").split("## How to add")[0])
    assert set(said) == set(stations())


def test_the_drawing_shows_what_there_is():
    """Each station and file named in docs/way.svg exists, and the stations of the engine stand in their order."""
    bold = re.findall(r'<text class="b[^"]*"[^>]*>([^<]+)</text>', text("docs/way.svg"))
    names = [name for line in bold for name in line.split(" → ") if re.fullmatch(r"[a-z_/]+(\.py)?", name)]
    for name in names:
        home = ROOT / name if name == "tuners" else ROOT / "monitor" / name
        assert home.exists() or home.with_suffix(".py").exists(), name
    drawn = [
        name
        for name in names
        if name in stations() and name in {"detect", "identify", "assess", "advise", "verdict"}
    ]
    assert drawn == [name for name in stations() if name in drawn]
    assert len(drawn) == 5


# ---- what is called where


def test_the_hooks_and_the_workflow_call_what_ci_calls():
    """The workflow runs .ci/run on every Python that the project names; a hook's tool is one of its tools."""
    script = text(".ci/run")
    workflow = text(".github/workflows/ci.yml")
    assert "run: bash .ci/run" in workflow
    project = tomllib.loads(text("pyproject.toml"))["project"]
    pythons = [c.rsplit(" ", 1)[1] for c in project["classifiers"] if re.search(r":: 3\.\d+$", c)]
    assert f"{{PYTHONS:-{' '.join(pythons)}}}" in script
    assert set(pythons) <= set(re.findall(r"\"(3\.\d+)\"", workflow))
    hooks = re.findall(r"entry: (.+)$", text(".pre-commit-config.yaml"), re.MULTILINE)
    assert hooks
    for hook in hooks:
        tool, *words = hook.split()
        assert re.search(rf'\$bin/{tool}" ?{" ".join(words)}', script), hook


def test_programs_shown_are_there():
    """What a page calls by `python -m` or `python ...py` exists."""
    said = "\n".join(text(page) for page in PAGES)
    for name in re.findall(r"python3? -m ((?:tests|monitor)[\w.]*)", said):
        home = ROOT.joinpath(*name.split("."))
        assert home.with_suffix(".py").exists() or (home / "__main__.py").exists(), name
    for name in re.findall(r"python3? ([\w/]+\.py)", said):
        assert (ROOT / name).exists(), name


def test_the_one_command_that_builds_the_documentation_is_said():
    """CONTRIBUTING has it as the test of the site runs it."""
    assert "sphinx-build -W --keep-going docs docs/_build/html" in text("CONTRIBUTING.md")
