"""Pages for machines: GET and HEAD, of ourselves, few at a time, each of them short."""

from __future__ import annotations

import http.client
import socket
from collections.abc import Iterator

import pytest

from monitor.adapters import http as pages
from monitor.adapters.http import Http, HttpError, is_local, split_address
from tests.support.waiting import PATIENCE, until


@pytest.fixture
def served() -> Iterator[Http]:
    made = Http("127.0.0.1:0", {"/a": lambda: (503, "text/plain", b"why not\n")})
    yield made
    made.close()


def port(served: Http) -> int:
    return int(served.url.rpartition(":")[2])


def ask(
    served: Http, path: str = "/a", method: str = "GET", host: str | None = None
) -> tuple[int, bytes, http.client.HTTPMessage]:
    """Status, body and headers of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port(served), timeout=PATIENCE)
    try:
        connection.request(method, path, headers={} if host is None else {"Host": host})
        answer = connection.getresponse()
        return answer.status, answer.read(), answer.headers
    finally:
        connection.close()


def test_a_page_with_its_code(served: Http) -> None:
    """As it was made; parameters are no part of the path; HEAD leaves the body out."""
    code, body, headers = ask(served, "/a?x=1")
    assert (code, body) == (503, b"why not\n")
    assert headers["Cache-Control"] == "no-store"
    assert "Python" not in headers["Server"]
    code, body, headers = ask(served, method="HEAD")
    assert (code, body, headers["Content-Length"]) == (503, b"", "8")


@pytest.mark.parametrize(
    ("path", "method", "code"), [("/b", "GET", 404), ("/a", "POST", 501), ("/a", "PUT", 501)]
)
def test_nothing_else_is_answered(served: Http, path: str, method: str, code: int) -> None:
    assert ask(served, path, method)[0] == code


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:9464", "127.0.0.1.evil.example", "", "[", "localhost.evil"]
)
def test_another_hosts_name_is_refused(served: Http, host: str) -> None:
    """A page elsewhere whose name was made to point here (DNS rebinding)."""
    assert ask(served, host=host)[0] == 403


@pytest.mark.parametrize("host", ["127.0.0.1:9464", "127.0.0.1", "localhost:1", "[::1]:9464"])
def test_an_address_cannot_be_led_astray(served: Http, host: str) -> None:
    assert ask(served, host=host)[0] == 503


def test_few_connections_at_a_time_and_none_for_long(served: Http, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those who say nothing, or byte by byte, keep nobody else out for longer than the time of a connection."""
    waiting = [socket.create_connection(("127.0.0.1", port(served))) for _ in range(pages.MOST_CONNECTIONS)]
    try:
        until(lambda: len(served._server._open) == pages.MOST_CONNECTIONS)
        with pytest.raises((OSError, http.client.HTTPException)):
            ask(served)
        monkeypatch.setattr(pages, "WITHIN_S", 0.0)
        for connection in waiting:
            connection.settimeout(PATIENCE)
            assert connection.recv(1) == b""
        monkeypatch.undo()
        until(lambda: not served._server._open)
        assert ask(served)[0] == 503
    finally:
        for connection in waiting:
            connection.close()


def test_what_is_no_request_is_the_askers_fault(served: Http, capfd: pytest.CaptureFixture[str]) -> None:
    """Any bytes: an error or the end, no line of ours, and the next one is answered."""
    for said in (
        b"\x16\x03\x01\x00\xff" * 20,
        b"GET " + 70_000 * b"x" + b"\r\n\r\n",
        b"\r\n\r\n",
        b"GET /a HTTP/9.9\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", port(served)), timeout=PATIENCE) as connection:
            connection.sendall(said)
            connection.shutdown(socket.SHUT_WR)
            try:
                answer = connection.recv(1000)
            except ConnectionResetError:  # it did not read to the end
                answer = b""
            assert b"why not" not in answer
    assert ask(served)[0] == 503
    assert capfd.readouterr().err == ""


def test_an_address_that_is_taken(served: Http) -> None:
    """One line that names it."""
    with pytest.raises(HttpError, match=f"http: 127.0.0.1:{port(served)}: "):
        Http(f"127.0.0.1:{port(served)}", {})


@pytest.mark.parametrize(
    "text",
    [
        "",
        "9464",
        "127.0.0.1",
        "127.0.0.1:",
        ":9464",
        "a:70000",
        "a:b",
        "http://a:1",
        "u@a:1",
        "a:1/x",
        "[::1",
    ],
)
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(ValueError, match="expected a host and a port"):
        split_address(text)


def test_what_only_this_machine_can_reach() -> None:
    assert is_local("127.3.2.1")
    assert not is_local("::")
