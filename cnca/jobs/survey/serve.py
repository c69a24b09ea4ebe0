"""A small server for one survey: it hands out the page and keeps the answers."""

from __future__ import annotations

import sqlite3
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

from cnca.core.errors import RunError
from cnca.jobs.served import PageHandler, PageServer
from cnca.jobs.survey.answers import STORE, Store, read_sheet, read_survey


class SurveyServer(PageServer):
    """Serves the survey in ``folder``; its sheets go to ``answers.sqlite`` in there.

    Raises:
        RunError: there is no survey, or the address is taken or not ours.
    """

    daemon_threads = False  # so that closing waits for the answers under way
    request_queue_size = 256

    def __init__(self, folder: Path, *, host: str, port: int) -> None:
        self.survey = read_survey(folder)
        self.page = (folder / "index.html").read_bytes()
        self.store = Store(folder / STORE)
        super().__init__(host, port, Handler)

    def server_close(self) -> None:
        """Wait for the requests under way, then close the store."""
        super().server_close()
        self.store.close()


class Handler(PageHandler):
    """``GET /`` is the page, ``POST /answers`` takes a sheet: 204 once it is safe on the disk."""

    server: SurveyServer
    timeout = 20
    """Seconds that a client may keep silent."""
    most_bytes = 32_768  # a sheet of 300 answers has under 8 KiB

    def do_GET(self) -> None:
        """The page; there is nothing else to get."""
        if urlsplit(self.path).path != "/":
            self.answer(HTTPStatus.NOT_FOUND, b"only / is here")
            return
        self.answer(HTTPStatus.OK, self.server.page, kind="text/html; charset=utf-8")

    def do_POST(self) -> None:
        """Check a sheet and keep it."""
        refused = self.refusal() if self.path == "/answers" else HTTPStatus.NOT_FOUND
        if refused:
            self.answer(refused, refused.phrase.encode())
            return
        body = self.rfile.read(int(self.headers["Content-Length"]))
        try:
            self.server.store.keep(read_sheet(body, self.server.survey))
        except RunError as error:
            self.answer(HTTPStatus.BAD_REQUEST, str(error).encode())
        except sqlite3.Error as error:  # such as a full disk: the page keeps the answers
            self.answer(HTTPStatus.INTERNAL_SERVER_ERROR, str(error).encode())
        else:
            self.answer(HTTPStatus.NO_CONTENT, b"")
