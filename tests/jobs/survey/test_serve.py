"""The server: nobody's answers are lost, and nothing else gets in."""

import http.client
import json
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from cnca.core.errors import RunError
from cnca.core.records import as_json
from cnca.jobs.survey.answers import KEY, Survey, read_sheets
from cnca.jobs.survey.serve import Handler, SurveyServer
from tests.jobs.survey.server import serving

PARTICIPANTS, PICTURES = 50, 12
SURVEY = Survey(
    "5" * 16,
    "How?",
    {f"{k:x}": ("Normal", "FCA")[k % 2] for k in range(PICTURES)},
    {f"{k:x}": f"{k}.png" for k in range(PICTURES)},
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / KEY).write_text(json.dumps(as_json(SURVEY)))
    (tmp_path / "index.html").write_text("<title>the page</title>")
    return tmp_path


def ask(port, method="POST", path="/answers", body=b"", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        connection.request(method, path, body, headers)
        response = connection.getresponse()
        return response.status, response.read()
    finally:
        connection.close()


def sheet(participant: int, revision: int) -> dict:
    """The first ``revision`` answers of a participant, which depend on who it is."""
    scores = {f"{k:x}": 1 + (participant + k) % 5 for k in range(revision)}
    who = f"{participant:032x}"
    return {"survey": SURVEY.id, "participant": who, "revision": revision, "answers": scores}


def post(port, content: dict) -> int:
    body = json.dumps(content).encode()
    return ask(port, body=body, **{"Content-Type": "application/json"})[0]


def test_fifty_at_once_lose_nothing(folder):
    """Each sends its sheet after every answer, and the last two in the wrong order."""
    order = [*range(1, PICTURES - 1), PICTURES, PICTURES - 1]
    start = threading.Barrier(PARTICIPANTS)

    def take_part(participant: int) -> set[int]:
        start.wait()
        return {post(port, sheet(participant, revision)) for revision in order}

    with serving(folder) as port, ThreadPoolExecutor(PARTICIPANTS) as people:
        answered = list(people.map(take_part, range(PARTICIPANTS)))
    assert answered == [{204}] * PARTICIPANTS
    kept = {int(each.participant, 16): each.answers for each in read_sheets(folder, SURVEY)}
    assert kept == {p: sheet(p, PICTURES)["answers"] for p in range(PARTICIPANTS)}


def test_a_kill_loses_no_answer_that_was_acknowledged(folder):
    """SIGKILL while fifty send: whatever was answered with 204 is there, and the file is sound."""
    program = (
        "import sys; from pathlib import Path; from cnca.jobs.survey.serve import SurveyServer\n"
        "with SurveyServer(Path(sys.argv[1]), host='127.0.0.1', port=0) as server:\n"
        "    print(server.server_port, flush=True); server.serve_forever()"
    )
    command = [sys.executable, "-c", program, str(folder)]
    acknowledged = [0] * PARTICIPANTS
    enough = threading.Event()

    def take_part(participant: int) -> None:
        for revision in range(1, PICTURES + 1):
            try:
                done = post(port, sheet(participant, revision)) == 204
            except (OSError, http.client.HTTPException):
                return
            if done:
                acknowledged[participant] = revision
            if sum(acknowledged) > 3 * PARTICIPANTS:
                enough.set()

    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server,
        ThreadPoolExecutor(PARTICIPANTS) as people,
    ):
        port = int(server.stdout.readline())
        people.map(take_part, range(PARTICIPANTS))
        assert enough.wait(120)
        server.send_signal(signal.SIGKILL)
    assert sum(acknowledged) < PARTICIPANTS * PICTURES  # the kill came in the middle
    kept = {int(each.participant, 16): each for each in read_sheets(folder, SURVEY)}
    for participant, revision in enumerate(acknowledged):
        if revision:
            stored = kept[participant]
            assert stored.revision >= revision
            assert stored.answers == sheet(participant, stored.revision)["answers"]


JSON = {"Content-Type": "application/json"}


@pytest.mark.parametrize(
    ("status", "request_"),
    [
        (200, {"method": "GET", "path": "/"}),
        (200, {"method": "GET", "path": "/?from=mail"}),
        (404, {"method": "GET", "path": "/survey.json"}),
        (404, {"method": "GET", "path": "/../survey.json"}),
        (404, {"path": "/elsewhere"}),
        (501, {"method": "PUT"}),
        (415, {"body": b"{}"}),
        (415, {"body": b"{}", "Content-Type": "text/plain"}),
        (400, {"body": b"{}", **JSON}),
        (403, {"body": b"{}", "Origin": "http://elsewhere.example", **JSON}),
        (411, {"Content-Length": "-1", **JSON}),
        (413, {"Content-Length": str(Handler.most_bytes + 1), **JSON}),
        (413, {"Content-Length": "9" * 5000, **JSON}),
    ],
)
def test_what_gets_in(folder, status, request_):
    with serving(folder) as port:
        assert ask(port, **request_)[0] == status
    assert read_sheets(folder, SURVEY) == []


def test_the_page_is_handed_out_whole(folder):
    with serving(folder) as port:
        assert ask(port, "GET", "/") == (200, b"<title>the page</title>")


def test_a_taken_port_is_named(folder):
    with (
        serving(folder) as port,
        pytest.raises(RunError, match=rf"127\.0\.0\.1:{port}: cannot listen .* another --port"),
    ):
        SurveyServer(folder, host="127.0.0.1", port=port)


def test_without_a_survey_there_is_nothing_to_serve(tmp_path):
    with pytest.raises(RunError, match=r"survey\.json: no survey"):
        SurveyServer(tmp_path, host="127.0.0.1", port=0)
