"""A small server for one survey: it hands out the page and keeps the answers."""

from __future__ import annotations

import re
import sqlite3
import sys
import traceback
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from cnca.core.errors import RunError
from cnca.jobs.survey.answers import STORE, Store, read_sheet, read_survey

MOST_BYTES = 32_768
"""Of a request's body: a sheet of 300 answers has under 8 KiB."""
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class SurveyServer(ThreadingHTTPServer):
    """Serves the survey in ``folder``; its sheets go to ``answers.sqlite`` in there.

    Raises:
        RunError: there is no survey, or the address cannot be had.
    """

    daemon_threads = False  # so that closing waits for the answers under way
    request_queue_size = 256

    def __init__(self, folder: Path, *, host: str, port: int) -> None:
        self.survey = read_survey(folder)
        self.page = (folder / "index.html").read_bytes()
        self.store = Store(folder / STORE)
        try:
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as error:
            raise RunError(
                f"{host}:{port}: cannot listen ({error}); choose another --port"
            ) from None

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say what went wrong, but not with whom; clients that went away are no error."""
        if not isinstance(sys.exception(), ConnectionError):
            traceback.print_exc()

    def server_close(self) -> None:
        """Wait for the requests under way, then close the store."""
        super().server_close()
        self.store.close()


class Handler(BaseHTTPRequestHandler):
    """``GET /`` is the page, ``POST /answers`` takes a sheet: 204 once it is safe on the disk."""

    server: SurveyServer
    timeout = 20
    """Seconds that a client may keep silent."""

    def do_GET(self) -> None:
        """The page; there is nothing else to get."""
        if urlsplit(self.path).path != "/":
            self._answer(HTTPStatus.NOT_FOUND, b"only / is here")
            return
        self._answer(HTTPStatus.OK, self.server.page, kind="text/html; charset=utf-8")

    def do_POST(self) -> None:
        """Check a sheet and keep it."""
        refused = self._refusal()
        if refused:
            self._answer(refused, refused.phrase.encode())
            return
        body = self.rfile.read(int(self.headers["Content-Length"]))
        try:
            self.server.store.keep(read_sheet(body, self.server.survey))
        except RunError as error:
            self._answer(HTTPStatus.BAD_REQUEST, str(error).encode())
        except sqlite3.Error as error:  # such as a full disk: the page keeps the answers
            self._answer(HTTPStatus.INTERNAL_SERVER_ERROR, str(error).encode())
        else:
            self._answer(HTTPStatus.NO_CONTENT, b"")

    def _refusal(self) -> HTTPStatus | None:
        """Why the request's body is not even read."""
        length, origin = self.headers.get("Content-Length", ""), self.headers.get("Origin")
        if self.path != "/answers":
            return HTTPStatus.NOT_FOUND
        if origin is not None and urlsplit(origin).netloc != self.headers.get("Host"):
            return HTTPStatus.FORBIDDEN  # another site's page
        if self.headers.get_content_type() != "application/json":
            return HTTPStatus.UNSUPPORTED_MEDIA_TYPE
        if not re.fullmatch("[0-9]+", length):
            return HTTPStatus.LENGTH_REQUIRED
        too_large = len(length) > 9 or int(length) > MOST_BYTES
        return HTTPStatus.REQUEST_ENTITY_TOO_LARGE if too_large else None

    def _answer(self, status: HTTPStatus, body: bytes, kind: str = "text/plain") -> None:
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if body:
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def version_string(self) -> str:
        """Not which Python runs here."""
        return "cnca"

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: addresses are not for keeping."""
