"""The command `loopsight status`: who answers, who answers rubbish, and nobody."""

from __future__ import annotations

import json

import pytest
from msgspec.structs import replace

from monitor.adapters.zenoh_bus import open_session
from monitor.service.status import encode_status
from tests.monitor.cli.tools import refused, run
from tests.monitor.service.tools import Bench, one_loop
from tests.support.waiting import free_port

NASTY = "a\x1b[31m\n\u202eb\x9b"
RUBBISH = {
    "nothing": b"",
    "no-json": b"\xff\x00",
    "no-object": b"[1]",
    "no-status": b'{"id": "no-status"}',
    "deep": b"[" * 100_000,
    "wrong": b'{"id": 5}',
    "numbers": b'{"id": "numbers", "uptime": "long"}',
}


@pytest.fixture
def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def answering(endpoint):
    """A router at which these answer: name in the key, payload."""
    session = open_session("router", listen=[endpoint])

    def answer(name: str, payload: bytes) -> None:
        key = f"loopsight/@/{name}/status"
        session.declare_queryable(key, lambda query: query.reply(key, payload))

    yield answer
    session.close()


@pytest.fixture
def status(tmp_path):
    """Make a monitor's status, some of it otherwise."""
    bench = Bench(tmp_path, one_loop())
    yield lambda name, **fields: encode_status(replace(bench.service.status(), id=name, **fields))
    bench.store.close()


@pytest.mark.usefixtures("impatient")
def test_nobody_answers(endpoint):
    """No router, and a router without a monitor: one line with the endpoint, exit 2."""
    refused("status", "--connect", endpoint, names=endpoint)
    session = open_session("router", listen=[endpoint])
    try:
        assert "no monitor answers" in refused("status", "--connect", endpoint, names=endpoint)
    finally:
        session.close()


def test_rubbish_is_named_and_left_out(answering, endpoint, status):
    """Whoever may answer may answer anything: the monitors that there are are shown all the same."""
    for name, payload in RUBBISH.items():
        answering(name, payload)
    answering("posing", status("A"))
    answering("A", status("A"))
    done = run("status", "--connect", endpoint)
    assert done.returncode == 0
    assert done.stdout.startswith("monitor A: NOT READY (nothing has come in yet)")
    lines = done.stderr.splitlines()
    assert len(lines) == len(RUBBISH) + 1
    assert all(line.startswith("loopsight status: loopsight/@/") for line in lines)
    assert all(any(f"/{name}/" in line for line in lines) for name in [*RUBBISH, "posing"])
    done = run("status", "--connect", endpoint, "--json")
    assert [json.loads(line)["id"] for line in done.stdout.splitlines()] == ["A"]


def test_rubbish_alone(answering, endpoint):
    """Exit 2, as where nobody answers."""
    answering("x", b"{")
    done = run("status", "--connect", endpoint)
    assert (done.returncode, done.stdout) == (2, "")
    assert "no monitor answers" in done.stderr.splitlines()[-1]


def test_names_are_data(answering, endpoint, status):
    """Whatever a loop, a key or a reason is called: it prints, and stays in its line; as JSON it is as it was."""
    lists = {name: [NASTY] for name in ("flagged", "stale", "clock_ahead", "not_ready")}
    answering("A", status("A", unknown={NASTY: 1}, ready=False, **lists))
    done = run("status", "--connect", endpoint)
    assert len(done.stdout.splitlines()) == 10
    assert all(line.isprintable() for line in done.stdout.splitlines())
    done = run("status", "--connect", endpoint, "--json")
    assert json.loads(done.stdout)["flagged"] == [NASTY]
    assert done.stdout.strip().isascii()


def test_a_monitor_of_another_version(answering, endpoint, status):
    """What it does not say has a default; what it says beyond is handed on as JSON."""
    facts = json.loads(status("A", twins=1))
    answering("A", json.dumps({**facts, "colour": "blue"}).encode())
    assert "others under this id: 1" in run("status", "--connect", endpoint).stdout
    assert json.loads(run("status", "--connect", endpoint, "--json").stdout)["colour"] == "blue"
    del facts["twins"]
    answering("B", json.dumps({**facts, "id": "B"}).encode())
    assert "monitor B: " in run("status", "--connect", endpoint).stdout
