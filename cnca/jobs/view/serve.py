"""A small server for one page on this machine: it hands out frames and takes what is asked for.

Only programs of this machine reach it: it listens on the loopback address, answers only to that
name (a page of another site cannot pass itself off as it), and takes only its own page's requests.
"""

from __future__ import annotations

import json
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from cnca.core.errors import CncaError, RunError

HOST = "127.0.0.1"
MOST_BYTES = 65_536
"""Of a request's body."""
PATIENCE = 15.0
"""Seconds after which a page that waits for a frame is told that there is none."""
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class Page(Protocol):
    """What is served."""

    @property
    def html(self) -> str:
        """The page itself."""

    def newer(self, than: int, timeout: float) -> Mapping[str, Any] | None:
        """What the page shows after number ``than``; None where there is nothing for a while."""

    def post(self, path: str, content: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """Answer to a request of the page; None for a path that there is not; may raise CncaError.

        All numbers in it are finite.
        """


class PageServer(ThreadingHTTPServer):
    """Serves one page on :data:`HOST`; raises RunError where the port cannot be had."""

    daemon_threads = True

    def __init__(self, page: Page, port: int) -> None:
        self.page = page
        try:
            super().__init__((HOST, port), Handler)
        except (OSError, OverflowError) as error:
            raise RunError(
                f"{HOST}:{port}: cannot listen ({error}); choose another --port, 0 takes a free one"
            ) from None

    @property
    def address(self) -> str:
        """Of the page, for the browser."""
        return f"http://{HOST}:{self.server_port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say what went wrong; a page that went away is no error."""
        if not isinstance(sys.exception(), ConnectionError):
            traceback.print_exc()


@contextmanager
def serving(page: Page, port: int) -> Iterator[str]:
    """Serve in a thread of its own; yields the page's address."""
    with PageServer(page, port) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield server.address
        finally:
            server.shutdown()
            thread.join()


class Handler(BaseHTTPRequestHandler):
    """``GET /`` is the page, ``GET /frame?after=N`` the next thing to show, ``POST`` the rest."""

    server: PageServer
    protocol_version = "HTTP/1.1"  # one connection for all frames
    timeout = 60

    def do_GET(self) -> None:
        """The page or a frame."""
        parts = urlsplit(self.path)
        if not self._at_home():
            self._answer(HTTPStatus.FORBIDDEN, b"only by its own address")
        elif parts.path == "/":
            html = self.server.page.html.encode()
            self._answer(HTTPStatus.OK, html, "text/html; charset=utf-8")
        elif parts.path == "/frame":
            after = parse_qs(parts.query).get("after", ["0"])[0]
            number = int(after) if after.isdecimal() and len(after) < 16 else 0
            shown = self.server.page.newer(number, PATIENCE)
            self._json(HTTPStatus.OK, {} if shown is None else shown)
        else:
            self._answer(HTTPStatus.NOT_FOUND, b"not here")

    def do_POST(self) -> None:
        """Something the page asks for, as JSON."""
        refused = self._refusal()
        if refused:
            self.close_connection = True  # its body was not read
            self._answer(refused, refused.phrase.encode())
            return
        body = self.rfile.read(int(self.headers["Content-Length"]))
        try:
            content = json.loads(body)
            if not isinstance(content, dict):
                raise RunError("the request is no JSON object")
            answer = self.server.page.post(self.path, content)
        except (CncaError, ValueError, TimeoutError) as error:
            self._json(HTTPStatus.BAD_REQUEST, {"error": str(error) or "busy; try again"})
            return
        if answer is None:
            self._answer(HTTPStatus.NOT_FOUND, b"not here")
        else:
            self._json(HTTPStatus.OK, answer)

    def _at_home(self) -> bool:
        """Whether the request names this address, not a name that someone else pointed here."""
        port = self.server.server_port
        return self.headers.get("Host") in (f"{HOST}:{port}", f"localhost:{port}")

    def _refusal(self) -> HTTPStatus | None:
        """Why the request's body is not even read."""
        length, origin = self.headers.get("Content-Length", ""), self.headers.get("Origin")
        if not self._at_home():
            return HTTPStatus.FORBIDDEN
        if origin is not None and urlsplit(origin).netloc != self.headers.get("Host"):
            return HTTPStatus.FORBIDDEN  # another site's page
        if self.headers.get_content_type() != "application/json":
            return HTTPStatus.UNSUPPORTED_MEDIA_TYPE
        if not (length.isascii() and length.isdecimal()):
            return HTTPStatus.LENGTH_REQUIRED
        too_large = len(length) > 9 or int(length) > MOST_BYTES
        return HTTPStatus.REQUEST_ENTITY_TOO_LARGE if too_large else None

    def _json(self, status: HTTPStatus, content: Mapping[str, Any]) -> None:
        text = json.dumps(content, allow_nan=False)
        self._answer(status, text.encode(), "application/json")

    def _answer(self, status: HTTPStatus, body: bytes, kind: str = "text/plain") -> None:
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def version_string(self) -> str:
        """Not which Python runs here."""
        return "cnca"

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: a frame every few milliseconds is no news."""
