"""The survey's page in a real browser: by mouse, by keyboard, over reloads and lost servers."""

import cv2
import numpy as np
import pytest

from cnca.jobs.survey.answers import FILES, read_sheets, read_survey
from tests.accessibility import complaints
from tests.jobs.survey.pictures import SOURCES
from tests.jobs.survey.server import serving

PICTURES = 6
TASTE = {"Normal": 5, "FCA": 2, "CNCA": 4}


def begin(page):
    page.get_by_label("I have read this").check()
    page.get_by_role("button", name="Start").click()


def source_on_screen(page) -> str:
    """Whose picture it is, by its color on the screen."""
    shot = np.frombuffer(page.locator("#picture").screenshot(), np.uint8)
    pixels = cv2.imdecode(shot, cv2.IMREAD_COLOR)[..., ::-1]
    color = pixels[pixels.shape[0] // 2, pixels.shape[1] // 2].astype(int)
    away = {
        name: min(np.abs(color - own - bright).max() for bright in (0, 30))
        for name, own in ((name, np.array(own)) for name, own in SOURCES.items())
    }
    assert min(away.values()) < 8
    return min(away, key=away.get)


def rate_by_taste(page, count=PICTURES):
    for _ in range(count):
        page.get_by_role("radio").nth(TASTE[source_on_screen(page)] - 1).check()
        page.get_by_role("button", name="Next").click()


def by_source(folder):
    """Participant → the sources with the scores that they got."""
    survey = read_survey(folder)
    return [
        sorted((survey.sources[key], score) for key, score in sheet.answers.items())
        for sheet in read_sheets(folder, survey)
    ]


EVERYTHING = sorted((source, score) for source, score in TASTE.items() for _ in range(2))


def test_by_mouse_to_the_server(open_page, folder):
    with serving(folder) as port:
        page = open_page(f"http://127.0.0.1:{port}/")
        page.get_by_role("button", name="Start").click()
        assert page.locator("#consent").is_visible()  # not without consent
        begin(page)
        page.get_by_role("button", name="Next").click()
        assert page.get_by_role("heading").inner_text() == f"Picture 1 of {PICTURES}"  # nor unrated
        rate_by_taste(page)
        page.get_by_text("All your answers have been sent.").wait_for()
    assert by_source(folder) == [EVERYTHING]


def test_by_keyboard_alone_to_a_file(open_page, folder):
    """As a file, without any server; what the page saves is scored as what it sends."""
    page = open_page((folder / "index.html").as_uri())
    for key in ("Tab", "Space", "Enter"):
        page.keyboard.press(key)
    for number in range(1, PICTURES + 1):
        assert page.get_by_role("heading").inner_text() == f"Picture {number} of {PICTURES}"
        page.keyboard.press(str(TASTE[source_on_screen(page)]))
        page.keyboard.press("Enter")
    assert page.get_by_role("heading").inner_text() == "Thank you"
    page.get_by_role("link", name="Save as a file").focus()
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    download.value.save_as(folder / FILES / download.value.suggested_filename)
    assert by_source(folder) == [EVERYTHING]


def test_arrow_keys_and_the_way_back(open_page, folder):
    page = open_page((folder / "index.html").as_uri())
    begin(page)
    for key in ("3", "ArrowRight", "Enter", "1"):
        page.keyboard.press(key)
    page.get_by_role("button", name="Back").click()
    assert page.get_by_role("heading").inner_text() == f"Picture 1 of {PICTURES}"
    assert page.get_by_role("radio", name="4").is_checked()
    page.keyboard.press("2")
    page.keyboard.press("Enter")
    assert page.get_by_role("radio", name="1 not natural at all").is_checked()


def test_a_reload_keeps_answers_place_and_order(open_page, folder):
    page = open_page((folder / "index.html").as_uri())
    begin(page)
    rate_by_taste(page, 2)
    page.keyboard.press("3")
    before = page.evaluate("localStorage.getItem(Object.keys(localStorage)[0])")
    page.reload()
    assert page.get_by_role("heading").inner_text() == f"Picture 3 of {PICTURES}"
    assert page.get_by_role("radio", name="3").is_checked()
    assert page.evaluate("localStorage.getItem(Object.keys(localStorage)[0])") == before


def test_every_participant_has_an_order_of_their_own(open_page, folder):
    """Ten people, 720 orders: that all be alike by chance, once in 720⁹."""
    orders = set()
    page = open_page((folder / "index.html").as_uri())
    for _ in range(10):
        page.evaluate("localStorage.clear()")
        page.reload()
        begin(page)
        state = page.evaluate("JSON.parse(localStorage.getItem(Object.keys(localStorage)[0]))")
        assert sorted(state["order"]) == sorted(read_survey(folder).sources)
        orders.add(tuple(state["order"]))
    assert len(orders) > 1


def test_answers_outlive_a_lost_server(open_page, folder):
    """The server goes away in the middle and comes back at the end: the page sends what it kept."""
    with serving(folder) as port:
        page = open_page(f"http://127.0.0.1:{port}/")
        begin(page)
        rate_by_taste(page, 2)
    rate_by_taste(page, PICTURES - 2)
    page.get_by_text("kept in this browser, but could not be sent").wait_for()
    with serving(folder, port):
        page.get_by_role("button", name="Send again").click()
        page.get_by_text("All your answers have been sent.").wait_for()
    assert by_source(folder) == [EVERYTHING]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [320, 1100])
def test_every_screen_reads_for_the_blind_and_on_a_phone(open_page, folder, scheme, width):
    page = open_page((folder / "index.html").as_uri(), width=width, scheme=scheme)
    for step in (begin, rate_by_taste, None):
        assert complaints(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") == width
        if step:
            step(page)
    assert page.get_by_role("heading").inner_text() == "Thank you"


def test_the_page_reaches_nothing_but_its_server(open_page, folder):
    page = open_page((folder / "index.html").as_uri())
    fetched = "fetch('http://127.0.0.1:9/').then(() => true, (error) => error.message)"
    with page.expect_event("console", lambda m: "Content Security Policy" in m.text):
        page.evaluate(fetched)
