"""The bus: a ring that never blocks, one prefix to write to, sessions on loopback."""

from __future__ import annotations

import socket
import threading
import time
from typing import Any

import pytest

from monitor.adapters import zenoh_bus
from monitor.adapters.zenoh_bus import Bus, BusError, _parameters, ask, open_session, plant_put, read_config
from monitor.contract.entries import Message
from tests.support.waiting import free_port, until


@pytest.fixture
def endpoint():
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def bus(endpoint):
    b = Bus(open_session("router", listen=[endpoint]))
    yield b
    b.close()


@pytest.fixture
def client(bus, endpoint):  # noqa: ARG001 (there has to be somebody to connect to)
    session = open_session("client", connect=[endpoint])
    yield session
    session.close()


# ---------------------------------------------------------------------------------------------------
# questions


@pytest.mark.parametrize("text", ["a=1&b=2=3", "a=1;b=2=3", ";a=1;;b=2=3&"])
def test_parameters(text):
    """Separated by `&` or `;`, the value may hold a `=`."""
    assert _parameters(text) == {"a": "1", "b": "2=3"}


# ---------------------------------------------------------------------------------------------------
# configuration of Zenoh's own


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{ mod: 1 }", "line 1: unknown field `mod`, expected one of"),
        ("{", "line 1: expected"),
        ("", "Empty config file"),
        ('{mode: "client"}', "mode: expected in the monitor's configuration, or on the command line"),
        ('{connect: {endpoints: ["tcp/a:1"]}}', "connect/endpoints: expected in"),
        ('{listen: {endpoints: ["tcp/a:1"]}}', "listen/endpoints: expected in"),
        (
            '{transport: {link: {tls: {root_ca_certificate: "/no/ca"}}}}',
            "root_ca_certificate: /no/ca: no such file",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(tmp_path, text, why):
    """The file, the place, what would be accepted; nothing of it is passed over in silence."""
    path = tmp_path / "z.json5"
    path.write_text(text)
    with pytest.raises(BusError) as error:
        open_session(file=str(path))
    (line,) = str(error.value).splitlines()
    assert line.startswith(f"{path}: ")
    assert why in line
    assert "cargo" not in line


def test_a_file_does_not_undo_what_is_ours(tmp_path, endpoint, monkeypatch):
    """Nothing is scouted for, whatever the file says."""
    path = tmp_path / "z.json5"
    path.write_text("{scouting: {multicast: {enabled: true}}, metadata: {name: 'x'}}")
    monkeypatch.setattr(zenoh_bus.zenoh, "open", lambda config: config)
    config = open_session("router", listen=[endpoint], file=str(path))
    assert config.get_json("scouting/multicast/enabled") == "false"
    assert config.get_json("metadata") == '{"name":"x"}'


def test_no_such_file():
    with pytest.raises(BusError, match=r"none\.json5: No such file"):
        read_config("none.json5")


# ---------------------------------------------------------------------------------------------------
# sessions


def test_a_port_that_is_taken_and_a_router_that_is_not_there(endpoint):
    """One line with the endpoint, without the library's source lines."""
    session = open_session("router", listen=[endpoint])
    with pytest.raises(BusError) as error:
        open_session("router", listen=[endpoint])
    session.close()
    assert str(error.value).startswith(endpoint)
    assert len(str(error.value).splitlines()) == 1
    assert ".rs" not in str(error.value)
    with pytest.raises(BusError, match="cannot open"):
        open_session("client", connect=[endpoint], options={"connect/timeout_ms": 100})
    with pytest.raises(BusError, match="nonsense"):
        open_session("router", listen=["nonsense"])


def test_nothing_listens_beyond_loopback(endpoint):
    """Only the endpoint that was asked for is open; scouting is off."""
    session = open_session("router", listen=[endpoint])
    port = int(endpoint.rpartition(":")[2])
    with pytest.raises(OSError, match=r"refused|timed out"):
        socket.create_connection(("127.0.0.2", port), timeout=1.0).close()
    session.close()


def test_messages_come_with_key_bytes_and_time(bus, client):
    """Key, payload and the bus's timestamp; what a monitor says itself is not heard."""
    bus.subscribe(["**"], lambda: 7)
    put = plant_put(client)
    until(lambda: put("plant/x", b"\x00\xff") or len(bus.inbox))
    bus.publish("loopsight/x", b"own", "text/plain")
    client.put("loopsight/plant/x/event", b"another monitor's")
    client.put("plant/end", b"")
    heard: list[Message] = []
    until(lambda: heard.extend(bus.inbox.take(100)) or (heard and heard[-1].key == "plant/end"))
    assert {m.key for m in heard} == {"plant/x", "plant/end"}
    assert heard[0].payload == b"\x00\xff"
    assert abs(heard[0].time - time.time_ns()) < 60e9


@pytest.mark.parametrize(
    "key",
    ["plant/x", "loopsight", "", "/loopsight/x", "loopsightx/y", "**", "plant/loopsight/x", "@/loopsight/x"],
)
def test_there_is_no_way_to_write_outside_the_prefix(bus, key):
    """Anything else is refused before it reaches the session."""
    with pytest.raises(ValueError, match="outside loopsight/"):
        bus.publish(key, b"", "")


def test_only_one_place_publishes():
    """`put` is called by the bus (under its prefix) and by the simulated plant, by nobody else in the monitor."""
    from pathlib import Path  # noqa: PLC0415

    import monitor  # noqa: PLC0415

    folder = Path(monitor.__file__).parent
    found = {
        str(f.relative_to(folder))
        for f in folder.rglob("*.py")
        if "session.put" in f.read_text(encoding="utf-8")
        or "declare_publisher" in f.read_text(encoding="utf-8")
    }
    assert found == {"adapters/zenoh_bus.py"}


def test_what_zenoh_does_not_take_is_counted(bus):
    """A key that is none, or a session that is closed: no exception."""
    bus.publish("loopsight/a//b", b"", "")
    bus.close()
    bus.publish("loopsight/x", b"", "")
    assert bus.publish_failed == 2


def test_key_expressions_that_are_none(bus):
    """One line names it."""
    with pytest.raises(BusError, match="subscribe: 'plant/\\*\\*\\*'"):
        bus.subscribe(["plant/***"], lambda: 0)


def test_questions_are_answered_or_refused_by_our_own_thread(bus, client):
    """Parameters as the contract writes them; a refusal is an error at the asker, not a reply."""
    bus.answer(["loopsight/**"])
    got: list[Any] = []

    def get(selector: str) -> threading.Thread:
        thread = threading.Thread(target=lambda: got.append(ask(client, selector, 5.0)))
        thread.start()
        return thread

    thread = get("loopsight/a/history/*?since=2026-01-01T00:00:00Z&limit=3")
    question = until(lambda: bus.questions.popleft() if bus.questions else None)
    assert question.key == "loopsight/a/history/*"
    assert question.parameters == {"since": "2026-01-01T00:00:00Z", "limit": "3"}
    assert question.matches("loopsight/a/history/1")
    assert not question.matches("loopsight/b/history/1")
    for k in range(3):
        question.reply(f"loopsight/a/history/{k}", b"%d" % k, "application/json")
    question.end()
    thread.join(10)
    assert sorted(got.pop()) == [(f"loopsight/a/history/{k}", b"%d" % k) for k in range(3)]
    thread = get("loopsight/a/history/*")
    until(lambda: bus.questions.popleft() if bus.questions else None).refuse("limit: expected a number")
    thread.join(10)
    assert got.pop() == []
    thread = get("**")
    question = until(lambda: bus.questions.popleft() if bus.questions else None)
    for key in ("loopsight/x", "not a / key"):
        question.reply(key, b"", "")
    question.end()
    thread.join(10)


def test_replies_are_bounded(bus, client, monkeypatch):
    """Of whoever answers without an end, so much is taken."""
    monkeypatch.setattr(zenoh_bus, "ANSWER_BYTES", 5000)
    bus.answer(["loopsight/**"])
    got: list[Any] = []
    thread = threading.Thread(target=lambda: got.append(ask(client, "loopsight/**", 60.0)))
    thread.start()
    question = until(lambda: bus.questions.popleft() if bus.questions else None)
    for k in range(100):
        question.reply(f"loopsight/{k}", bytes(1000), "")
    question.end()
    thread.join(60)
    assert len(got.pop()) == 5


def test_two_monitors_of_one_name_find_each_other(bus, client):
    """At once, whichever came first, and until the other one has gone; others do not matter."""
    found: list[int] = []
    bus.look_for_twins("a", found.append)
    other = Bus(client)
    other.look_for_twins("b", found.append)
    other.look_for_twins("a", found.append)
    until(lambda: bus.twins == other.twins == 1)
    assert found == [1, 1]
    other.close()
    until(lambda: bus.twins == 0)


def test_close_twice(bus):
    """Closing is safe in any state."""
    bus.subscribe(["plant/**"], lambda: 0)
    bus.close()
    bus.close()
