"""A few pages for machines over HTTP: only GET and HEAD, few connections at a time, and each of them short."""

from __future__ import annotations

import ipaddress
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import Any
from urllib.parse import urlsplit

MOST_CONNECTIONS = 8
"""At a time; one more is closed at once: a scraper, a probe and a person are three."""
WITHIN_S = 5.0
"""For a connection from its beginning to its end, however slowly it asks [s]."""
LOOK_EVERY_S = 0.5
"""Between two looks for connections that take too long [s]."""

Answer = tuple[int, str, bytes]
"""Status code, content type, body."""


class HttpError(OSError):
    """An address that cannot be listened on; one line."""


def split_address(text: str) -> tuple[str, int]:
    """Return host and port of an address such as ``127.0.0.1:9464`` or ``[::1]:9464``.

    Raises
    ------
    ValueError
        It is none.

    Examples
    --------
    >>> split_address("127.0.0.1:9464"), split_address("[::1]:0")
    (('127.0.0.1', 9464), ('::1', 0))
    """
    with suppress(ValueError):  # of a port that is none
        parts = urlsplit(f"//{text}")
        if parts.hostname and parts.port is not None and parts.netloc == text and "@" not in text:
            return parts.hostname, parts.port
    raise ValueError(f"http: {text!r}, expected a host and a port, e.g. 127.0.0.1:9464")


def is_local(host: str) -> bool:
    """Whether only this machine can reach a host's address.

    Examples
    --------
    >>> [is_local(host) for host in ("localhost", "127.0.0.1", "::1", "0.0.0.0", "10.1.2.3", "plant")]
    [True, True, True, False, False, False]
    """
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Http:
    """Serves pages on threads of its own until it is closed.

    Parameters
    ----------
    address
        Host and port to listen on; port 0 takes a free one.
    answers
        What makes a page, by its path; called on the connection's thread.

    Raises
    ------
    HttpError
        It cannot listen there.
    """

    def __init__(self, address: str, answers: Mapping[str, Callable[[], Answer]]) -> None:
        host, port = split_address(address)
        try:
            self._server = _Server(host, port, _handler(host, answers))
        except OSError as error:
            raise HttpError(f"http: {address}: {error.strerror or error}") from None
        shown = f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{self._server.server_address[1]}"
        """Where it is."""
        threading.Thread(
            target=self._server.serve_forever, args=(LOOK_EVERY_S,), name="http", daemon=True
        ).start()

    def close(self) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, host: str, port: int, handler: type[BaseHTTPRequestHandler]) -> None:
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._open: dict[Any, float] = {}
        super().__init__((host, port), handler)

    def server_bind(self) -> None:
        """Bind, without asking the network for this machine's name as the base does."""
        TCPServer.server_bind(self)

    def process_request(self, request: Any, client_address: Any) -> None:
        if len(self._open) >= MOST_CONNECTIONS:
            self.shutdown_request(request)
            return
        self._open[request] = time.monotonic()
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        self._open.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """Break off what takes too long: its thread ends with the connection."""
        latest = time.monotonic() - WITHIN_S
        for request in [r for r, began in list(self._open.items()) if began < latest]:
            with suppress(OSError):
                request.shutdown(socket.SHUT_RDWR)

    def handle_error(self, *_: Any) -> None:
        """Leave a client that has gone alone."""


def _handler(own: str, answers: Mapping[str, Callable[[], Answer]]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = WITHIN_S

        def do_GET(self) -> None:
            """Answer. Another host's name means a page elsewhere that poses as this one."""
            page = answers.get(self.path.partition("?")[0])
            if not _is_ours(self.headers.get("Host", ""), own):
                self.send_error(403)
            elif page is None:
                self.send_error(404)
            else:
                code, kind, body = page()
                self.send_response(code)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("X-Content-Type-Options", "nosniff")
                self.end_headers()
                if self.command != "HEAD":
                    self.wfile.write(body)

        do_HEAD = do_GET  # noqa: N815 (the base class names it)

        def version_string(self) -> str:
            return "loopsight"

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    return Handler


def _is_ours(asked: str, own: str) -> bool:
    """Whether a header names us by address, or by the name that was configured: only a name can be led astray."""
    try:
        host = urlsplit(f"//{asked}").hostname or ""
    except ValueError:
        return False
    with suppress(ValueError):
        return bool(ipaddress.ip_address(host))
    return host in {"localhost", own}
