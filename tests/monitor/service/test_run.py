"""End to end over real Zenoh on loopback: the process itself, its publishers, its subscribers, and kills."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from monitor.adapters.loop_table import read_loop_table
from monitor.adapters.store import Store, StoreError
from monitor.adapters.zenoh_bus import Bus, BusError, ask, open_session, plant_put
from monitor.contract.loop_fields import parse_row
from monitor.contract.loops import LoopTable
from monitor.contract.records import Assessment
from monitor.contract.samples import Samples
from monitor.engine import Engine
from monitor.service.config import Config
from monitor.service.run import opened, serve
from monitor.service.service import Service
from monitor.service.vitals import Vitals
from sim_plants.export import write_rows
from sim_plants.loops import Simulation
from sim_plants.scenarios import SCENARIOS
from sim_plants.truth import loop_table
from tests.monitor.service.tools import messages_of
from tests.support.stores import stored
from tests.support.waiting import PATIENCE, free_port, heard, until

START = 1_767_225_600
SECONDS = 1500


@pytest.fixture(scope="session")
def plant(tmp_path_factory):
    """The demo's loops, their table as a file, and their samples for 1500 s."""
    loops = SCENARIOS["demo"](1)
    path = tmp_path_factory.mktemp("plant") / "loops.csv"
    write_rows(path, loop_table(loops))
    return loops, path, Simulation(loops, START).advance(SECONDS)


@pytest.fixture
def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


# ---------------------------------------------------------------------------------------------------
# live equals batch, over the real bus


@pytest.fixture(scope="session")
def expected(plant):
    """What the engine says of the sorted samples."""
    loops, _, block = plant
    engine = Engine(LoopTable([parse_row(row)[0] for row in loop_table(loops)]))
    samples = Samples.of(block.loop, block.time_ns, block.sp, block.pv, block.op, block.auto)
    return by_loop([*engine.step(samples), *engine.flush()])


def by_loop(records: Any) -> dict[str, list[dict[str, Any]]]:
    out: dict[str, list[dict[str, Any]]] = {}
    for r in records:
        if isinstance(r, Assessment):
            out.setdefault(r.loop, []).append(msgspec.structs.asdict(r))
    return out


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "payload", [pytest.param("tag", marks=SLOW), pytest.param("sample", marks=SLOW), "frame"]
)
def test_live_over_zenoh_equals_batch(plant, expected, endpoint, tmp_path, payload, monkeypatch):
    """Disturbed within the window, in whatever batches the bus makes of it: the engine's records, bit by bit."""
    monkeypatch.setattr(
        "monitor.service.service.FINISH_S", PATIENCE
    )  # a busy machine assesses few events in 6 s
    loops, table, block = plant
    messages = messages_of(loops, block, payload)
    rng = np.random.default_rng(7)
    within = {"tag": 60, "sample": 15, "frame": 1}[payload]  # fewer than come in 1.9 s
    late = np.argsort(np.arange(len(messages)) + rng.integers(0, within, len(messages)), kind="stable")
    records: list[Any] = []
    bus, store = Bus(open_session("router", listen=[endpoint])), Store(tmp_path)
    sender = open_session("client", connect=[endpoint])
    try:
        service = Service(Config(loops=str(table)), read_loop_table(table), bus, store, heard=records.append)
        bus.subscribe(["plant/**"], time.time_ns)
        put = plant_put(sender)
        until(lambda: heard(sender, "plant/hello"))
        thread = threading.Thread(target=lambda: [put(*messages[k]) for k in late])
        thread.start()
        until(lambda: service.tick() < 0 or bus.inbox.received >= len(messages))
        thread.join()
        service.finish()
        status = service.status()
    finally:
        sender.close()
        bus.close()
        store.close()
    assert (status.samples_ok, status.late, status.dropped) == (len(block), 0, 0)
    assert by_loop(records) == expected


# ---------------------------------------------------------------------------------------------------
# the process


class Monitor:
    """`loopsight monitor` as a process of its own."""

    def __init__(self, endpoint: str, state: Path, loops: Path | None = None) -> None:
        self.endpoint, self.state = endpoint, state
        options = ["--listen", endpoint, "--state", str(state), *(["--loops", str(loops)] if loops else [])]
        state.mkdir(parents=True, exist_ok=True)
        self.log = (state / "log").open("a")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "monitor", "monitor", *options],
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
        )
        assert self.process.stdout is not None
        watchdog = threading.Timer(PATIENCE, self.process.kill)
        watchdog.start()
        self.first = self.process.stdout.readline()
        watchdog.cancel()

    def status(self) -> dict[str, Any]:
        done = subprocess.run(
            [sys.executable, "-m", "monitor", "status", "--json", "--connect", self.endpoint],
            capture_output=True, text=True, check=False, timeout=PATIENCE,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return dict(json.loads(done.stdout))

    def end(self, number: int = signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        code = self.process.wait(PATIENCE)
        assert self.process.stdout is not None
        self.process.stdout.close()
        self.log.close()
        return code

    def said(self) -> str:
        return (self.state / "log").read_text()


@pytest.fixture
def start(endpoint, tmp_path):
    """Start a monitor; it is gone at the end."""
    started: list[Monitor] = []

    def begin(loops: Path | None = None, state: str = "state") -> Monitor:
        started.append(Monitor(endpoint, tmp_path / state, loops))
        return started[-1]

    yield begin
    for m in started:
        if m.process.poll() is None:
            m.end(signal.SIGKILL)


@pytest.fixture
def client(endpoint):
    """A session towards the monitor, once it listens."""
    opened: list[Any] = []

    def connect() -> Any:
        opened.append(open_session("client", connect=[endpoint]))
        return opened[-1]

    yield connect
    for session in opened:
        session.close()


def health(session: Any) -> dict[str, Any]:
    """The monitor's status, by a query; empty while it does not answer."""
    replies = ask(session, "loopsight/@/*/status", 2.0)
    return dict(json.loads(replies[0][1])) if replies else {}


def test_ready_stop_and_all_that_is_stored(plant, start, client):
    """A line that begins with ready; SIGTERM in the middle of a burst: exit 0 in time, what was said is stored."""
    loops, table, block = plant
    monitor = start(table)
    assert monitor.first.startswith("ready")
    session = client()
    heard: list[tuple[str, bytes]] = []
    subscriber = session.declare_subscriber(
        "loopsight/**/assessment", lambda s: heard.append((str(s.key_expr), s.payload.to_bytes()))
    )
    put = plant_put(session)
    messages = messages_of(loops, block, "frame")
    for message in messages[:1200]:
        put(*message)
    until(lambda: heard)
    stop = threading.Event()

    def burst() -> None:
        for message in messages[1200:]:
            if stop.is_set():
                return
            put(*message)

    thread = threading.Thread(target=burst)
    thread.start()
    code = monitor.end()
    stop.set()
    thread.join()
    subscriber.undeclare()
    assert code == 0, monitor.said()
    found = stored(monitor.state)
    said = {r["id"]: r for r in (json.loads(p) for _, p in heard)}
    assert said
    assert all(found[i] == r for i, r in said.items())
    events = stored(
        monitor.state, "event"
    )  # assessed or, where a busy machine had no time for it, only closed
    assert set(said) <= set(events)
    assert all(e["state"] != "open" for e in events.values())
    assert any(e["state"] == "interrupted" for e in events.values())


@pytest.mark.parametrize("comes", [True, False])
def test_a_router_that_is_not_there_is_waited_for(endpoint, tmp_path, comes):
    """Said, not ready; when it comes, ready; told to stop before: exit 0."""
    log = (tmp_path / "log").open("w")
    process = subprocess.Popen(
        [sys.executable, "-m", "monitor", "monitor", "--connect", endpoint, "--state", str(tmp_path / "state")],
        stdout=subprocess.PIPE, stderr=log, text=True,
    )  # fmt: skip
    router = None
    try:
        until(lambda: "router_absent" in (tmp_path / "log").read_text())
        if comes:
            router = open_session("router", listen=[endpoint])
            watchdog = threading.Timer(PATIENCE, process.kill)
            watchdog.start()
            assert process.stdout is not None
            assert process.stdout.readline().startswith("ready")
            watchdog.cancel()
        process.terminate()
        assert process.wait(PATIENCE) == 0
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        if router is not None:
            router.close()
        process.stdout.close()
        log.close()


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no SIGHUP on this system")
def test_sighup_reads_the_loop_table_again(start, client, tmp_path):
    """A wrong table is refused, the old one holds; a right one is taken over at the next tick."""
    table = tmp_path / "loops.csv"
    table.write_text("name,kp\nA,1\n")
    monitor = start(table)
    session = client()
    until(lambda: health(session))
    table.write_text("name,kp\nA,0\n")
    monitor.process.send_signal(signal.SIGHUP)
    until(lambda: "reload_refused" in monitor.said())
    assert "kp" in monitor.said()
    table.write_text("name,kp\nA,2\nB,1\n")
    monitor.process.send_signal(signal.SIGHUP)
    until(lambda: health(session)["loops"]["total"] == 2)
    assert monitor.end() == 0
    assert "1 loops new, 1 changed, 0 gone; 2 now" in monitor.said()


@pytest.mark.slow
def test_sigint_and_idle(start):
    """Ctrl-C without any data: exit 0."""
    monitor = start()
    assert monitor.end(signal.SIGINT) == 0, monitor.said()


@pytest.mark.slow
def test_bad_input_is_counted_and_nothing_stops(plant, start, client):
    """Rubbish, unknown loops, missing values, the future, a publisher that is killed: each its own counter."""
    loops, table, _ = plant
    monitor = start(table)
    session = client()
    put = plant_put(session)
    until(lambda: health(session))
    key = f"plant/{loops[0].name}"
    now = time.time()
    sent = [
        (key, b"{"), (key, b"\xff\xfe\x00"), (f"{key}/pv", b"NaN"), ("plant/area1/frame", b"\xff\xff\xff\xff" * 100),
        ("plant/nobody", b'{"pv":1}'), ("plant/nobody/pv", b"1"), ("plant/<script>/pv", b"1"),
        (key, json.dumps({"t": now + 3600, "sp": 1, "pv": 1, "op": 1}).encode()),
        (key, b'{"t":0,"sp":1,"pv":1,"op":1}'),
        (key, json.dumps({"t": START, "sp": 1, "pv": "Bad Input", "op": 1}).encode()),
        (key, json.dumps({"t": START + 1, "sp": 1, "pv": 1, "op": 1, "q": 0}).encode()),
        (key, json.dumps({"t": START + 2, "sp": 1, "pv": 1, "op": 1}).encode()),
    ]  # fmt: skip
    for message in sent:
        put(*message)
    other = subprocess.Popen(
        [sys.executable, "-m", "monitor", "simulate", "--connect", monitor.endpoint, "--speed", "100"],
    )
    try:
        until(lambda: health(session).get("samples_ok", 0) > 1000)
    finally:
        other.kill()
        other.wait()
    put(key, b"}")
    until(lambda: health(session).get("malformed") == 5)
    status = monitor.status()
    assert (status["malformed"], status["unknown_loop"], status["future"]) == (5, 3, 1)
    assert (status["bad_time"], status["bad_value"], status["bad_quality"]) == (1, 1, 1)
    assert set(status["unknown"]) == {"plant/nobody", "plant/<script>"}
    assert status["ready"]
    assert monitor.process.poll() is None
    assert monitor.end() == 0
    assert "Traceback" not in monitor.said()
    assert monitor.said().count(" refused_malformed: ") == 1  # once a minute, whatever the keys


@pytest.mark.parametrize("kills", [pytest.param(3, marks=SLOW), pytest.param(20, marks=pytest.mark.soak)])
def test_killed_under_load_loses_nothing_that_was_said(plant, endpoint, tmp_path, kills):
    """SIGKILL at any instant: each assessment that a subscriber received is whole in the monitor's file."""
    loops, table, block = plant
    messages = messages_of(loops, block, "frame")
    rng = np.random.default_rng(kills)
    acknowledged = 0
    for k in range(kills):
        monitor = Monitor(endpoint, tmp_path / str(k), table)
        session = open_session("client", connect=[endpoint])
        heard: list[bytes] = []
        subscriber = session.declare_subscriber(
            "loopsight/**/assessment", lambda s, heard=heard: heard.append(s.payload.to_bytes())
        )
        put = plant_put(session)
        enough = int(rng.integers(1, 12))
        stop = threading.Event()

        def load(stop: threading.Event = stop, put: Any = put) -> None:
            for message in messages:
                if stop.is_set():
                    return
                put(*message)

        thread = threading.Thread(target=load)
        thread.start()
        until(lambda heard=heard, enough=enough: len(heard) >= enough)
        monitor.end(signal.SIGKILL)
        stop.set()
        thread.join()
        subscriber.undeclare()
        session.close()
        found = stored(tmp_path / str(k))
        said = [json.loads(p) for p in heard]
        assert len(said) >= enough
        assert [found.get(r["id"]) for r in said] == said
        acknowledged += len(said)
    again = Monitor(endpoint, tmp_path / "0", table)
    assert again.first.startswith("ready")
    assert again.end() == 0
    assert acknowledged >= kills


@pytest.mark.slow
def test_history_and_status_over_zenoh(plant, start, client):
    """Queries as the contract writes them, against the running process."""
    loops, table, block = plant
    monitor = start(table)
    session = client()
    put = plant_put(session)
    until(lambda: health(session))
    for message in messages_of(loops, block, "frame"):
        put(*message)
    until(lambda: health(session)["samples_ok"] >= len(block) - 13)
    until(lambda: len(ask(session, "loopsight/**/history/*", 5.0)) >= 5)
    found = ask(
        session,
        "loopsight/plant/*/history/*?since=2026-01-01T00:00:00Z&until=2027-01-01T00:00:00Z&limit=1",
        5.0,
    )
    assert found
    assert len({k for k, _ in found}) == len(found) == len({k.split("/history/")[0] for k, _ in found})
    key, payload = found[0]
    record = json.loads(payload)
    assert key == f"loopsight/plant/{record['loop']}/history/{record['id']}"
    assert record["start"].endswith("Z")
    assert ask(session, f"{key.rpartition('/')[0]}/*?until=2026-01-01T00:00:00Z", 5.0) == []
    assert ask(session, f"{key.rpartition('/')[0]}/*?limit=-1", 5.0) == []
    window = ask(session, key.replace("/history/", "/window/"), 5.0)
    assert len(window) == 1
    assert len(ask(session, "loopsight/plant/*/status", 5.0)) == len(loops)
    tokens = [str(r.ok.key_expr) for r in session.liveliness().get("loopsight/@/*/alive") if r.ok]
    assert tokens == ["loopsight/@/monitor/alive"]
    assert monitor.end() == 0


def test_a_port_that_is_taken(endpoint, tmp_path):
    """The second monitor on a port: one line, exit 2."""
    session = open_session("router", listen=[endpoint])
    try:
        done = subprocess.run(
            [sys.executable, "-m", "monitor", "monitor", "--listen", endpoint, "--state", str(tmp_path)],
            capture_output=True, text=True, check=False, timeout=PATIENCE,
        )  # fmt: skip
    finally:
        session.close()
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert endpoint in done.stderr


# ---------------------------------------------------------------------------------------------------
# publishers are not slowed


LONGEST_PUT = """
import sys, time
from monitor.adapters.zenoh_bus import open_session, plant_put
session = open_session("client", connect=[sys.argv[1]])
put, longest, n, end = plant_put(session), 0.0, 0, time.monotonic() + 3.0
while time.monotonic() < end:
    began = time.perf_counter()
    put("plant/x/pv", bytes(2000))
    longest = max(longest, time.perf_counter() - began)
    n += 1
    time.sleep(0.001)
session.close()
print(longest, n)
"""
"""Puts at about 1 kHz; says the longest [s] and how many there were."""


@pytest.mark.slow
def test_a_tick_that_stalls_does_not_slow_the_publishers(endpoint):
    """Nobody takes from the ring for seconds: a blocking publisher in another process does not feel it."""
    bus = Bus(open_session("router", listen=[endpoint]))
    try:
        bus.subscribe(["plant/**"], time.time_ns)
        done = subprocess.run(
            [sys.executable, "-c", LONGEST_PUT, endpoint],
            capture_output=True,
            text=True,
            check=True,
            timeout=PATIENCE,
        )
        longest, n = float(done.stdout.split()[0]), int(done.stdout.split()[1])
        until(lambda: bus.inbox.received == n)
        assert bus.inbox.dropped == 0
    finally:
        bus.close()
    print(f"longest put {longest * 1e3:.2f} ms of {n}")
    assert (
        longest < 4.0
    )  # a stalled callback blocks for 5 s; 10 ms is the goal on a machine that is not shared


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs SIGSTOP")
def test_a_monitor_that_was_frozen_goes_on(plant, start, client):
    """SIGSTOP for a while under load, then on: it takes up again, and counts."""
    loops, table, block = plant
    monitor = start(table)
    session = client()
    put = plant_put(session)
    until(lambda: health(session))
    messages = messages_of(loops, block, "frame")
    for message in messages[:300]:
        put(*message)
    os.kill(monitor.process.pid, signal.SIGSTOP)
    for message in messages[300:330]:
        put(*message)
    os.kill(monitor.process.pid, signal.SIGCONT)
    for message in messages[330:]:
        put(*message)
    until(lambda: health(session).get("samples_ok", 0) >= len(block) - 13)
    assert monitor.end() == 0


def test_another_endpoint_where_the_first_is_taken(endpoint, tmp_path):
    """A monitor that may choose listens on a spare one, and answers there; all is closed behind it."""
    spare = f"tcp/127.0.0.1:{free_port()}"
    session = open_session("router", listen=[endpoint])
    config = Config(id="x", listen=[endpoint], state=str(tmp_path))
    try:
        with pytest.raises(BusError, match=endpoint), opened(config):
            pass
        with opened(config, [endpoint, spare]) as monitor:
            assert monitor.endpoint == monitor.where == spare
            service = monitor.start()
            client = open_session("client", connect=[spare])
            found: list[Any] = []
            try:
                client.get("loopsight/@/*/status", found.append)
                until(lambda: service.tick() < 0 or found)
            finally:
                client.close()
            assert json.loads(found[0].ok.payload.to_bytes())["id"] == "x"
            with pytest.raises(StoreError):
                Store(tmp_path)
        Store(tmp_path).close()
        open_session("router", listen=[spare]).close()
    finally:
        session.close()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="needs AF_UNIX")
def test_a_service_manager_is_told(endpoint, tmp_path, monkeypatch):
    """READY once it is subscribed, WATCHDOG while ticks are completed and not while it is frozen, STOPPING."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "400000")
        monitor = Monitor(endpoint, tmp_path / "state")
        said = [manager.recv(100) for _ in range(4)]
        assert said == [b"READY=1", *[b"WATCHDOG=1"] * 3]
        os.kill(monitor.process.pid, signal.SIGSTOP)
        manager.settimeout(1.0)  # more than twice as long as it may take
        with pytest.raises(TimeoutError):
            list(iter(lambda: manager.recv(100), b""))
        manager.settimeout(PATIENCE)
        os.kill(monitor.process.pid, signal.SIGCONT)
        assert manager.recv(100) == b"WATCHDOG=1"
        assert monitor.end() == 0
        assert b"STOPPING=1" in iter(lambda: manager.recv(100), b"")


def test_http_tells_of_the_process(endpoint, tmp_path, caplog):
    """Not ready before anything is heard, closed with the monitor; open to the network only with a warning."""
    config = Config(listen=[endpoint], state=str(tmp_path))
    vitals = Vitals()
    with ExitStack() as stack:
        assert serve(config, vitals, stack) == ""
        url = serve(replace(config, http="127.0.0.1:0"), vitals, stack)
        service = stack.enter_context(opened(config)).start()
        service.tick()
        vitals.beat(service, 0.0)
        with pytest.raises(urllib.error.HTTPError, match="503") as refused:
            urllib.request.urlopen(f"{url}/readyz", timeout=PATIENCE)
        assert refused.value.read() == b"no_data: nothing has come in yet\n"
        refused.value.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(f"{url}/livez", timeout=PATIENCE)
    assert caplog.messages == []
    with ExitStack() as stack:
        assert serve(replace(config, http="0.0.0.0:0"), vitals, stack) in caplog.text


def test_keys_that_no_subscription_hears_are_named(endpoint, tmp_path, caplog):
    """Only frames could bring them; those that are heard by their tags, or as a whole, are not named."""
    table = tmp_path / "loops.csv"
    table.write_text("name,key\nA,plant/A\nB,area2/B\nC,plant/x/C\n")
    config = Config(
        loops=str(table), listen=[endpoint], state=str(tmp_path / "s"), subscribe=["plant/*/pv", "plant/x/*"]
    )
    with opened(config) as monitor:
        monitor.start()
    (line,) = caplog.messages
    assert line.endswith("the keys of 1 loops, frames alone can bring them: B")


def test_a_bus_without_a_router():
    """Nothing listens: an error, soon."""
    with pytest.raises(BusError):
        open_session("client", connect=[f"tcp/127.0.0.1:{free_port()}"], options={"connect/timeout_ms": 100})


@pytest.mark.slow
def test_told_to_stop_while_the_kernels_are_compiled(tmp_path, endpoint):
    """SIGTERM during the first start, before anything was heard: exit 0 soon, not the deadline's 1."""
    cache = tmp_path / "cache"
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "monitor",
            "monitor",
            "--listen",
            endpoint,
            "--state",
            str(tmp_path / "s"),
        ],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        until(lambda: list(cache.rglob("*.nbi")))
        process.send_signal(signal.SIGTERM)
        said, complained = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == 0, complained
    assert "ready" not in said
    assert "Traceback" not in complained
