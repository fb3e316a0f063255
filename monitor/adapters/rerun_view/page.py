"""Rerun's web page, handed on with one header more: the browser may talk to this machine and to nobody else.

The page as it is reports its use to its makers, asks for news and loads fonts from outside, none of which belongs
into a plant. A Content-Security-Policy makes the browser refuse all of that; the picture does not need it.
"""

from __future__ import annotations

import shutil
import threading
from http.client import HTTPConnection, HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

PASSED_ON = ("Content-Type", "Content-Length", "rerun-final-length")


class Page:
    """Serves what ``127.0.0.1:source`` serves, on a port of its own; ``data`` is the port of the page's data."""

    def __init__(self, source: int, data: int) -> None:
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(source, policy(data)))
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        threading.Thread(
            target=self._server.serve_forever, args=(0.1,), name="view-page", daemon=True
        ).start()

    def stop(self) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()


def policy(data: int) -> str:
    """Write the policy of a page that may only reach its own server and the port ``data`` of this machine."""
    return "; ".join(
        [
            "default-src 'self'",
            "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'",
            "style-src 'self' 'unsafe-inline'",
            f"connect-src 'self' http://127.0.0.1:{data}",
            "img-src 'self' data: blob:",
            "worker-src 'self' blob:",
            "frame-ancestors 'none'",
            "form-action 'none'",
        ]
    )


def _handler(source: int, rules: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = (
            "HTTP/1.0"  # the end of the answer is the end of the connection: no length is needed
        )
        timeout = 30

        def do_GET(self) -> None:
            """Fetch and hand on. Another host's name means a page elsewhere that poses as this one."""
            own = "{}:{}".format(*self.request.getsockname()[:2])
            if self.headers.get("Host") != own:
                self.send_error(403)
                return
            connection = HTTPConnection("127.0.0.1", source, timeout=30)
            try:
                connection.request("GET", self.path)
                answer = connection.getresponse()
                self.send_response(answer.status)
                for name in PASSED_ON:
                    if value := answer.getheader(name):
                        self.send_header(name, value)
                self.send_header("Content-Security-Policy", rules)
                self.send_header("Referrer-Policy", "no-referrer")
                self.end_headers()
                shutil.copyfileobj(answer, self.wfile, 1 << 16)
            except (OSError, HTTPException):
                self.close_connection = True  # Rerun's server or the browser has gone
            finally:
                connection.close()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    return Handler
