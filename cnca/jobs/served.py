"""What the small servers of pages have in common: what they refuse, and how they answer."""

from __future__ import annotations

import sys
import traceback
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar
from urllib.parse import urlsplit

from cnca.core.errors import RunError

HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class PageServer(ThreadingHTTPServer):
    """Raises RunError where the address is taken or not ours."""

    def __init__(self, host: str, port: int, handler: type[PageHandler]) -> None:
        try:
            super().__init__((host, port), handler)
        except (OSError, OverflowError) as error:
            raise RunError(
                f"{host}:{port}: cannot listen ({error}); choose another --port, 0 takes a free one"
            ) from None

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say what went wrong, but not with whom; clients that went away are no error."""
        if not isinstance(sys.exception(), ConnectionError):
            traceback.print_exc()


class PageHandler(BaseHTTPRequestHandler):
    """Takes JSON from its own page alone, and leaves no trace of who asked."""

    most_bytes: ClassVar[int]
    """Of a request's body."""

    def refusal(self) -> HTTPStatus | None:
        """Why the body of a request is not even read."""
        length, origin = self.headers.get("Content-Length", ""), self.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != self.headers.get("Host"):
            return HTTPStatus.FORBIDDEN  # another site's page
        if self.headers.get_content_type() != "application/json":
            return HTTPStatus.UNSUPPORTED_MEDIA_TYPE
        if not (length.isascii() and length.isdecimal()):
            return HTTPStatus.LENGTH_REQUIRED
        too_large = len(length) > 9 or int(length) > self.most_bytes
        return HTTPStatus.REQUEST_ENTITY_TOO_LARGE if too_large else None

    def answer(self, status: HTTPStatus, body: bytes, kind: str = "text/plain") -> None:
        """Send a status and, unless it is empty, a body."""
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
        """Nothing: addresses are not for keeping, and a frame every few milliseconds is no news."""
