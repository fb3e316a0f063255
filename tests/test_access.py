"""Who gets in and who does not: the files of config/zenoh as they are shipped, with real sessions on loopback."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from monitor.adapters.zenoh_bus import Bus, BusError, ask, open_session
from monitor.contract import keys
from tests.monitor.cli.tools import run
from tests.support.places import ROOT
from tests.support.waiting import PATIENCE, free_port, until

ZENOH = ROOT / "config" / "zenoh"
OPENSSL = shutil.which("openssl")
pytestmark = pytest.mark.skipif(OPENSSL is None, reason="needs openssl")
ROLES = ("gateway", "monitor", "viewer")
FOLDER = "/etc/loopsight"


def certificates(folder: Path, *names: str) -> None:
    """What the shipped script makes; the router's is for this machine."""
    for name in names:
        address = ["DNS:localhost,IP:127.0.0.1"] if name == "router" else []
        line = ["/bin/sh", str(ZENOH / "certificates.sh"), str(folder), name, *address]
        subprocess.run(line, check=True, capture_output=True)


def shipped(name: str, folder: Path, **changes: str) -> str:
    """Write a shipped file as somebody would adapt it; return its path."""
    text = (ZENOH / name).read_text(encoding="utf-8").replace(FOLDER, str(folder))
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{len(list(folder.iterdir()))}-{name}"
    path.write_text(text, encoding="utf-8")
    return str(path)


class Plant:
    """A router with its authority, and whoever wants to get in."""

    def __init__(self, folder: Path, mode: str) -> None:
        self.folder, self.mode = folder, mode
        certificates(folder / "tls", "router", *ROLES)
        self.endpoint = f"tls/127.0.0.1:{free_port()}"
        self.sessions: list[Any] = []
        if mode == "password":
            (folder / "users.txt").write_text("".join(f"{role}:{role}-secret\n" for role in ROLES))
        self.router = self.keep(open_session("router", listen=[self.endpoint], file=self.router_file()))

    def keep(self, session: Any) -> Any:
        self.sessions.append(session)
        return session

    def router_file(self) -> str:
        if self.mode == "certificate":
            return shipped("router.json5", self.folder)
        return shipped(
            "router.json5", self.folder, **{"enable_mtls: true": "enable_mtls: false", "// auth:": "auth:"}
        )

    def client_file(self, role: str, secret: str = "") -> str:
        if self.mode == "certificate":
            return shipped("client.json5", self.folder, **{"tls/client.": f"tls/{role}."})
        lines = (ZENOH / "client.json5").read_text(encoding="utf-8").splitlines(keepends=True)
        first = next(k for k, line in enumerate(lines) if "connect_certificate:" in line)
        text = "".join(lines[:first] + lines[first + 3 :]).replace(FOLDER, str(self.folder))
        text = (
            text.replace("// auth:", "auth:")
            .replace('"monitor"', f'"{role}"')
            .replace("...", secret or f"{role}-secret")
        )
        path = self.folder / f"{role}-{secret}.json5"
        path.write_text(text, encoding="utf-8")
        return str(path)

    def enter(self, role: str, secret: str = "") -> Any:
        """A session of this role."""
        return self.keep(open_session("client", connect=[self.endpoint], file=self.client_file(role, secret)))

    def refuses(self, file: str = "") -> None:
        """Nobody gets in with this."""
        with pytest.raises(BusError, match="cannot open"):
            open_session("client", [self.endpoint], options={"connect/timeout_ms": 1000}, file=file)


@pytest.fixture(scope="module", params=["certificate", "password"])
def plant(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    made = Plant(tmp_path_factory.mktemp(request.param), request.param)
    yield made
    for session in reversed(made.sessions):
        session.close()


def listens(session: Any, key: str) -> list[str]:
    """Keys that come in under a key expression, from now on."""
    came: list[str] = []
    session.declare_subscriber(key, lambda sample: came.append(str(sample.key_expr)))
    return came


def monitor_of(plant: Plant) -> Bus:
    """A monitor's bus that hears, answers and is alive."""
    bus = Bus(plant.enter("monitor"))
    bus.subscribe(["plant/**"], time.time_ns)
    bus.answer([keys.LOOPS, keys.of_monitor("m")])
    bus.alive(keys.monitor_alive("m"))
    return bus


def answered(bus: Bus, question: Callable[[], list[tuple[str, bytes]]]) -> list[tuple[str, bytes]]:
    """Replies to a question that the bus answers under the key that was asked for."""
    from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415

    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(question)
        until(lambda: bus.questions or waiting.done())
        while bus.questions:
            asked = bus.questions.popleft()
            asked.reply(asked.key, b"1", "")
            asked.end()
        return waiting.result(PATIENCE)


def test_each_does_what_is_its_own(plant: Plant) -> None:
    """A gateway publishes, a monitor hears it, speaks and answers, a viewer hears and asks: of loops and of itself."""
    bus = monitor_of(plant)
    gateway, viewer = plant.enter("gateway"), plant.enter("viewer")
    results, health = listens(viewer, "loopsight/**"), listens(viewer, "loopsight/@/*/status")
    until(lambda: gateway.put("plant/a/pv", b"1") or len(bus.inbox))
    until(lambda: bus.publish("loopsight/plant/a/event", b"{}", "") or results)
    until(lambda: bus.publish("loopsight/@/m/status", b"{}", "") or health)
    for key in ("loopsight/plant/a/status", "loopsight/@/m/status"):
        until(lambda key=key: answered(bus, lambda: ask(viewer, key, 5.0)) == [(key, b"1")])
    until(lambda: [str(r.ok.key_expr) for r in viewer.liveliness().get("loopsight/@/*/alive") if r.ok])
    bus.close()


def test_nobody_does_what_is_not_his(plant: Plant) -> None:
    """A monitor cannot write to the plant, a viewer nowhere, a gateway says and hears no results, and nobody poses."""
    bus = monitor_of(plant)
    monitor, gateway, viewer = plant.enter("monitor"), plant.enter("gateway"), plant.enter("viewer")
    good = (
        plant.enter("viewer"),
        plant.enter("gateway"),
    )  # what a session says itself, it hears without the router
    results = listens(good[0], "loopsight/**")
    spied = [
        listens(good[0], "plant/**"),
        *(listens(good[1], key) for key in ("loopsight/**", "loopsight/@/**")),
    ]
    forged = [
        viewer.declare_queryable("loopsight/@/m/status", lambda query: query.reply(query.key_expr, b"forged"))
    ]
    forged.append(
        gateway.declare_queryable("loopsight/**", lambda query: query.reply(query.key_expr, b"forged"))
    )
    forged.append(viewer.liveliness().declare_token("loopsight/@/forged/alive"))
    for session in (monitor, viewer):
        session.put("plant/forged/pv", b"0")
    for session in (gateway, viewer):
        session.put("loopsight/plant/forged/event", b"0")
        session.put("loopsight/@/forged/status", b"0")
    # each of them has had its say when what is allowed has come through behind it
    until(lambda: gateway.put("plant/end/pv", b"1") or len(bus.inbox))
    until(lambda: bus.publish("loopsight/plant/end/event", b"{}", "") or results)
    assert {m.key for m in bus.inbox.take(1000)} == {"plant/end/pv"}
    assert set(results) == {"loopsight/plant/end/event"}
    assert spied == [[], [], []]
    assert answered(bus, lambda: ask(good[0], "loopsight/@/m/status", 5.0)) == [
        ("loopsight/@/m/status", b"1")
    ]
    tokens = [str(r.ok.key_expr) for r in good[0].liveliness().get("loopsight/@/*/alive") if r.ok]
    assert tokens == ["loopsight/@/m/alive"]
    for declared in forged:
        declared.undeclare()
    bus.close()


@pytest.mark.slow
def test_the_commands_get_in(plant: Plant, tmp_path: Path) -> None:
    """A monitor, a plant and a status, each with its own; without, a line and exit 2."""
    secure = ["--connect", plant.endpoint, "--zenoh"]
    line = [
        sys.executable,
        "-m",
        "monitor",
        "monitor",
        "--state",
        str(tmp_path),
        *secure,
        plant.client_file("monitor"),
    ]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as monitor:
        try:
            assert monitor.stdout is not None
            assert monitor.stdout.readline().startswith(f"ready {plant.endpoint}")
            simulate = run(
                "simulate", "--loops", "2", "--seconds", "0.1", *secure, plant.client_file("gateway")
            )
            assert simulate.returncode == 0
            status = run("status", *secure, plant.client_file("viewer"))
            assert status.stdout.startswith("monitor monitor: ")
            assert run("status", "--connect", plant.endpoint).returncode == 2
        finally:
            monitor.terminate()
        assert monitor.wait(PATIENCE) == 0


def test_no_credentials(plant: Plant) -> None:
    """Neither over TLS without any, nor without TLS."""
    file = plant.folder / "nobody.json5"
    file.write_text(f'{{transport: {{link: {{tls: {{root_ca_certificate: "{plant.folder}/tls/ca.pem"}}}}}}}}')
    plant.refuses(str(file))
    plant.refuses()
    plain = plant.endpoint.replace("tls/", "tcp/")
    with pytest.raises(BusError):
        open_session("client", [plain], options={"connect/timeout_ms": 1000})


def test_wrong_credentials(plant: Plant, tmp_path: Path) -> None:
    """A certificate of another authority with the right name; a wrong password, and a user who is none."""
    if plant.mode == "password":
        plant.refuses(plant.client_file("monitor", "wrong"))
        plant.refuses(plant.client_file("nobody"))
        return
    certificates(tmp_path / "tls", "monitor")
    (tmp_path / "tls" / "ca.pem").write_bytes((plant.folder / "tls" / "ca.pem").read_bytes())
    plant.refuses(shipped("client.json5", tmp_path, **{"tls/client.": "tls/monitor."}))


def test_another_router_is_not_believed(plant: Plant, tmp_path: Path) -> None:
    """Who poses as the router has no certificate of our authority."""
    certificates(tmp_path / "tls", "router")
    endpoint = f"tls/127.0.0.1:{free_port()}"
    false = open_session("router", listen=[endpoint], file=shipped("router.json5", tmp_path))
    try:
        with pytest.raises(BusError):
            open_session(
                "client", [endpoint], options={"connect/timeout_ms": 1000}, file=plant.client_file("monitor")
            )
    finally:
        false.close()


def test_a_role_without_rules_may_nothing(plant: Plant) -> None:
    """A certificate of our authority whose name is in no rule: in, and mute."""
    if plant.mode == "password":
        pytest.skip("a user who is in no list is refused at the door")
    certificates(plant.folder / "tls", "stranger")
    stranger, bus, gateway = plant.enter("stranger"), monitor_of(plant), plant.enter("gateway")
    came = listens(plant.enter("stranger"), "plant/**")
    stranger.put("plant/forged/pv", b"0")
    until(lambda: gateway.put("plant/end/pv", b"1") or len(bus.inbox))
    assert {m.key for m in bus.inbox.take(1000)} == {"plant/end/pv"}
    assert came == []
    bus.close()
