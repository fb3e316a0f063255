"""The unit and the container file in config/: what they start exists, as little of the machine as they can do with."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import click
import pytest

from monitor.cli.main import loopsight
from monitor.service.vitals import LIVE_WITHIN_S
from tests.support.places import ROOT

UNIT = ROOT / "config" / "loopsight.service"
CONTAINER = ROOT / "config" / "Containerfile"
ANALYZE = shutil.which("systemd-analyze")
MOST_EXPOSURE = 2.5
"""By `systemd-analyze security`, from 0 (nothing) to 10."""


def unit() -> dict[str, list[str]]:
    """The unit's settings by name."""
    found: dict[str, list[str]] = {}
    for name, value in re.findall(r"^(\w+)=(.*)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE):
        found.setdefault(name, []).append(value)
    return found


def instructions() -> list[tuple[str, str]]:
    """The container file's instructions, lines that go on put together."""
    text = re.sub(r"^#.*\n", "", CONTAINER.read_text(encoding="utf-8"), flags=re.MULTILINE)
    lines = text.replace("\\\n", " ").splitlines()
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines if line.strip()]


def understood(words: list[str]) -> None:
    """Fail where the command line knows an option not."""
    command = loopsight.get_command(click.Context(loopsight), words[1])
    assert command is not None
    command.make_context(words[1], words[2:], resilient_parsing=True)
    known = {option for parameter in command.params for option in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= known


def test_the_unit_starts_what_there_is():
    """Its command line is understood; the watchdog is as patient as /livez."""
    understood([Path(unit()["ExecStart"][0].split()[0]).name, *unit()["ExecStart"][0].split()[1:]])
    assert unit()["Type"] == ["notify"]
    assert unit()["WatchdogSec"] == [f"{LIVE_WITHIN_S:.0f}s"]


@pytest.fixture
def verifiable(tmp_path):
    """The unit with a program that exists on this machine."""
    if ANALYZE is None:
        pytest.skip("needs systemd-analyze")
    path = tmp_path / UNIT.name
    path.write_text(
        UNIT.read_text(encoding="utf-8").replace("/opt/loopsight/bin/loopsight", shutil.which("true"))
    )
    return path


def test_the_unit_is_verified(verifiable):
    """No unknown setting, no complaint."""
    done = subprocess.run([ANALYZE, "verify", str(verifiable)], capture_output=True, text=True, check=False)
    about_it = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert (done.returncode, about_it) == (0, [])


def test_the_unit_exposes_little(verifiable):
    """By systemd's own measure."""
    done = subprocess.run(
        [ANALYZE, "security", "--offline=true", "--no-pager", str(verifiable)],
        capture_output=True,
        text=True,
        check=False,
    )
    level = re.search(r"exposure level for \S+: ([\d.]+)", done.stdout)
    if level is None:
        pytest.skip("this systemd-analyze cannot do it offline")
    assert float(level[1]) < MOST_EXPOSURE


def test_the_container_file_is_sound():
    """Two stages of one base, what is copied exists, nobody is root at the end, one volume."""
    found = instructions()
    bases = [rest.split()[0] for name, rest in found if name == "FROM"]
    assert len(set(bases)) == 1
    assert ":" in bases[0]
    sources = [w for n, r in found if n == "COPY" and "--from" not in r for w in r.split()[:-1]]
    assert all((ROOT / source).exists() for source in sources)
    assert {"tuners", "monitor", "sim_plants"} <= set(sources)
    last = found[max(k for k, (name, _) in enumerate(found) if name == "FROM") :]
    users = [rest for name, rest in last if name == "USER"]
    assert users
    assert all(user.isdigit() and int(user) > 0 for user in users)
    assert [rest for name, rest in last if name == "VOLUME"] == ["/state"]
    assert not [name for name, _ in found if name in {"ADD", "ARG"}]


def test_the_containers_commands_are_understood():
    """What it starts, and what asks whether it is alive."""
    last = dict(instructions())
    understood(json.loads(last["ENTRYPOINT"]))
    words = json.loads(re.search(r"CMD (\[.*\])", last["HEALTHCHECK"])[1])
    address = json.loads(last["ENTRYPOINT"])[json.loads(last["ENTRYPOINT"]).index("--http") + 1]
    assert f"http://{address}/livez" in words[-1]
    compile(words[-1], "HEALTHCHECK", "exec")
    for name, rest in instructions():
        if name == "RUN":
            assert subprocess.run(["/bin/sh", "-nc", rest], check=False).returncode == 0
            assert shlex.split(rest)
