"""A small server for one page on this machine: it hands out frames and takes what is asked for.

Only programs of this machine reach it: it listens on the loopback address, answers only to that
name (a page of another site cannot pass itself off as it), and takes only its own page's requests.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from cnca.core.errors import CncaError, RunError
from cnca.jobs.served import PageHandler, PageServer

HOST = "127.0.0.1"
FOLLOW = Path(__file__).parent / "follow.js"
"""The program by which a page asks for frames."""
PATIENCE = 15.0
"""Seconds after which a page that waits for a frame is told that there is none."""


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


class LocalServer(PageServer):
    """Serves one page on :data:`HOST`; raises RunError where the port cannot be had."""

    daemon_threads = True

    def __init__(self, page: Page, port: int) -> None:
        self.page = page
        super().__init__(HOST, port, Handler)

    @property
    def address(self) -> str:
        """Of the page, for the browser."""
        return f"http://{HOST}:{self.server_port}/"


@contextmanager
def serving(page: Page, port: int) -> Iterator[str]:
    """Serve in a thread of its own; yields the page's address."""
    with LocalServer(page, port) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield server.address
        finally:
            server.shutdown()
            thread.join()


class Handler(PageHandler):
    """``GET /`` is the page, ``GET /frame?after=N`` the next thing to show, ``POST`` the rest."""

    server: LocalServer
    protocol_version = "HTTP/1.1"  # one connection for all frames
    timeout = 60
    most_bytes = 65_536

    def do_GET(self) -> None:
        """The page or a frame."""
        parts = urlsplit(self.path)
        if not self._at_home():
            self.answer(HTTPStatus.FORBIDDEN, b"only by its own address")
        elif parts.path == "/":
            html = self.server.page.html.encode()
            self.answer(HTTPStatus.OK, html, "text/html; charset=utf-8")
        elif parts.path == "/frame":
            after = parse_qs(parts.query).get("after", ["0"])[0]
            number = int(after) if after.isdecimal() and len(after) < 16 else 0
            shown = self.server.page.newer(number, PATIENCE)
            self._json(HTTPStatus.OK, {} if shown is None else shown)
        else:
            self.answer(HTTPStatus.NOT_FOUND, b"not here")

    def do_POST(self) -> None:
        """Something the page asks for, as JSON."""
        refused = self.refusal() if self._at_home() else HTTPStatus.FORBIDDEN
        if refused:
            self.close_connection = True  # its body was not read
            self.answer(refused, refused.phrase.encode())
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
            self.answer(HTTPStatus.NOT_FOUND, b"not here")
        else:
            self._json(HTTPStatus.OK, answer)

    def _at_home(self) -> bool:
        """Whether the request names this address, not a name that someone else pointed here."""
        port = self.server.server_port
        return self.headers.get("Host") in (f"{HOST}:{port}", f"localhost:{port}")

    def _json(self, status: HTTPStatus, content: Mapping[str, Any]) -> None:
        text = json.dumps(content, allow_nan=False)
        self.answer(status, text.encode(), "application/json")
