"""The server: only this machine, only its own page, frames as they come."""

import http.client
import json
import threading
from urllib.parse import urlsplit

import pytest

from cnca.core.errors import RunError
from cnca.jobs.view.desk import Desk
from cnca.jobs.view.serve import HOST, LocalServer, serving


class OnePage:
    html = "<title>here</title>"

    def newer(self, than, timeout):
        return {"number": than + 1}

    def post(self, path, content):
        if "wrong" in content:
            raise RunError("wrong: not this one")
        return dict(content) if path == "/controls" else None


@pytest.fixture
def ask():
    with serving(OnePage(), 0) as address:
        where = urlsplit(address)

        def ask(method, path, body=None, **headers):
            connection = http.client.HTTPConnection(where.hostname, where.port, timeout=20)
            connection.request(method, path, body, {"Host": where.netloc, **headers})
            response = connection.getresponse()
            return response.status, response.read().decode()

        yield ask


JSON = {"Content-Type": "application/json"}


def test_page_frames_and_requests(ask):
    assert ask("GET", "/") == (200, OnePage.html)
    assert ask("GET", "/frame?after=6") == (200, '{"number": 7}')
    assert ask("GET", "/frame?after=-6") == (200, '{"number": 1}')
    assert ask("POST", "/controls", '{"azimuth": 3}', **JSON) == (200, '{"azimuth": 3}')
    status, answer = ask("POST", "/controls", '{"wrong": 3}', **JSON)
    assert (status, json.loads(answer)["error"]) == (400, "wrong: not this one")


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (("GET", "/etc/passwd"), 404),
        (("POST", "/nowhere", "{}"), 404),
        (("POST", "/controls", "[]"), 400),
        (("POST", "/controls", "{"), 400),
        (("POST", "/controls", "{" + " " * 70_000), 413),
    ],
)
def test_what_is_not_there_or_not_json(ask, request_, status):
    assert ask(*request_, **JSON)[0] == status


@pytest.mark.parametrize(
    "headers",
    [{"Host": "elsewhere.example:80"}, {"Origin": "http://elsewhere.example"}],
)
def test_other_sites_pages_are_refused(ask, headers):
    assert ask("POST", "/controls", "{}", **JSON, **headers)[0] == 403
    if "Host" in headers:
        assert ask("GET", "/", **headers)[0] == 403


def test_forms_of_other_sites_are_refused(ask):
    assert ask("POST", "/controls", "{}", **{"Content-Type": "text/plain"})[0] == 415


def test_only_this_machine_is_listened_to():
    with LocalServer(OnePage(), 0) as server:
        assert server.server_address[0] == HOST == "127.0.0.1"
        with pytest.raises(RunError, match="choose another --port"):
            LocalServer(OnePage(), server.server_port)


def test_the_desk_hands_out_the_newest():
    desk = Desk({"a": 1})
    assert desk.newer(0, timeout=0) is None
    desk.publish("one")
    desk.publish("two")
    assert (desk.newer(0, 0).number, desk.newer(0, 0).shown) == (2, "two")
    assert desk.newer(2, timeout=0) is None
    assert desk.newer(9, timeout=0).shown == "two"  # of an earlier server
    assert desk.wait(0, 0) == ({"a": 1}, 0)
    desk.ask(lambda state, update: state | update, {"b": 2})
    assert desk.wait(0, 5) == ({"a": 1, "b": 2}, 1)


def test_work_is_done_by_the_thread_that_renders():
    desk, names = Desk(0), []

    def rendering():
        desk.wait(0, timeout=20)
        names.append(threading.current_thread().name)
        desk.work()

    thread = threading.Thread(target=rendering, name="renders")
    thread.start()
    assert desk.do(lambda: threading.current_thread().name) == "renders"
    thread.join()
    with pytest.raises(TimeoutError):
        desk.do(lambda: 1, timeout=0.01)
    desk.work()
