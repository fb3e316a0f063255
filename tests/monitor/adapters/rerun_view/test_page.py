"""The page in front of Rerun's: the same bytes, one header more, and nobody who poses as this machine."""

from __future__ import annotations

import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from monitor.adapters.rerun_view.page import Page, policy
from tests.support.waiting import PATIENCE

BODY = b"\x00asm" * 1000


class Source(BaseHTTPRequestHandler):
    """Stands for Rerun's own server."""

    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/viewer.wasm" else 404)
        self.send_header("Content-Type", "application/wasm")
        self.send_header("Server-Timing", "not handed on")
        self.end_headers()
        self.wfile.write(BODY)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def page() -> Iterator[Page]:
    source = ThreadingHTTPServer(("127.0.0.1", 0), Source)
    threading.Thread(target=source.serve_forever, args=(0.01,), daemon=True).start()
    made = Page(int(source.server_address[1]), 9876)
    yield made
    made.stop()
    source.shutdown()
    source.server_close()


def test_the_page_is_handed_on_with_a_policy(page: Page) -> None:
    with urllib.request.urlopen(f"http://127.0.0.1:{page.port}/viewer.wasm", timeout=PATIENCE) as answer:
        assert answer.read() == BODY
        assert answer.headers["Content-Type"] == "application/wasm"
        assert answer.headers["Content-Security-Policy"] == policy(9876)
        assert answer.headers["Server-Timing"] is None
    with pytest.raises(urllib.error.HTTPError, match="404") as missing:
        urllib.request.urlopen(f"http://127.0.0.1:{page.port}/else", timeout=PATIENCE)
    missing.value.close()


def test_another_hosts_name_is_refused(page: Page) -> None:
    """A page elsewhere whose name was made to point here."""
    asked = urllib.request.Request(
        f"http://127.0.0.1:{page.port}/viewer.wasm", headers={"Host": "evil.example"}
    )
    with pytest.raises(urllib.error.HTTPError, match="403") as refused:
        urllib.request.urlopen(asked, timeout=PATIENCE)
    refused.value.close()


def test_a_page_reaches_its_own_server_and_its_data_only() -> None:
    rules = dict(rule.split(" ", 1) for rule in policy(9876).split("; "))
    assert rules["default-src"] == "'self'"
    assert rules["connect-src"] == "'self' http://127.0.0.1:9876"
    assert [w for rule in rules.values() for w in rule.split() if "//" in w] == ["http://127.0.0.1:9876"]
