"""Reports in a real browser: dragged, steered by keyboard, narrow, dark, printed."""

import cv2
import numpy as np
import pytest

from cnca.report import write_report
from cnca.report.blocks import Turntable
from cnca.report.webpage import jpeg_uri
from tests.accessibility import complaints
from tests.report import folders
from tests.report.folders import BLUE, GREEN, RED, WHITE

KINDS = [folders.attack, folders.evaluation, folders.tradeoff, folders.prices]


@pytest.fixture
def report(tmp_path):
    """The address of the report of a kind of run; its turntable is red, then green, then blue."""

    def write(kind) -> str:
        frames = [jpeg_uri(folders.flat(color)) for color in (RED, GREEN, BLUE)]
        return write_report(kind(tmp_path / "run"), [Turntable("my car", frames)]).as_uri()

    return write


def color_at(locator, across: float) -> tuple[int, ...]:
    """What is really on the screen at this share of an element's width, halfway up."""
    shot = cv2.imdecode(np.frombuffer(locator.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    blue, green, red = shot[len(shot) // 2, round(across * (shot.shape[1] - 1))].tolist()
    return red, green, blue


def near(color):
    return pytest.approx(color, abs=6)  # JPEG rounds


def drag(page, locator, start: float, end: float):
    box = locator.bounding_box()
    for place, act in ((start, page.mouse.down), (end, page.mouse.up)):
        page.mouse.move(box["x"] + place * box["width"], box["y"] + box["height"] / 2, steps=4)
        act()


def test_the_divider_follows_the_mouse(open_page, report):
    page = open_page(report(folders.attack))
    frame = page.locator(".slider .frame")
    frame.scroll_into_view_if_needed()
    assert color_at(frame, 0.4) == near(RED)
    assert color_at(frame, 0.6) == near(BLUE)
    drag(page, frame, 0.5, 0.2)
    assert color_at(frame, 0.1) == near(RED)
    assert color_at(frame, 0.4) == near(BLUE)
    drag(page, frame, 0.2, 0.8)
    assert color_at(frame, 0.6) == near(RED)


def test_the_divider_and_the_view_follow_the_keyboard(open_page, report):
    page = open_page(report(folders.attack))
    slider = page.locator(".slider")
    slider.get_by_role("slider").focus()
    page.keyboard.press("End")
    assert color_at(slider.locator(".frame"), 0.95) == near(RED)
    slider.get_by_label("View").focus()
    page.keyboard.press("ArrowDown")
    assert color_at(slider.locator(".frame"), 0.95) == near(WHITE)
    # View 2 of 4 out of 8 held-out ones is the third of these.
    assert (
        slider.locator("figcaption").inner_text().split()
        == (
            f"plain paint: score {folders.SCORES['before'][2]:.2f} "
            f"camouflage: score {folders.SCORES['after'][2]:.2f}"
        ).split()
    )


def test_other_textures_are_chosen(open_page, report):
    page = open_page(report(folders.evaluation))
    slider = page.locator(".slider")
    assert color_at(slider.locator(".frame"), 0.7) == near(BLUE)  # the candidate comes first
    slider.get_by_label("Compared with").select_option("random")
    assert color_at(slider.locator(".frame"), 0.3) == near(RED)
    assert color_at(slider.locator(".frame"), 0.7) == near(GREEN)


def test_the_runs_of_a_comparison_are_chosen(open_page, report):
    page = open_page(report(folders.tradeoff))
    slider = page.locator(".slider")
    assert color_at(slider.locator(".frame"), 0.7) == near(BLUE)
    slider.get_by_label("Compared with").select_option("τ = 1")
    assert color_at(slider.locator(".frame"), 0.7) == near(GREEN)


def test_the_turntable_turns_by_mouse_and_keyboard(open_page, report):
    page = open_page(report(folders.attack))
    turntable = page.locator(".turntable")
    frame = turntable.locator(".frame")
    frame.scroll_into_view_if_needed()
    assert color_at(frame, 0.5) == near(RED)
    drag(page, frame, 0.1, 0.98)
    assert color_at(frame, 0.5) == near(BLUE)
    turntable.get_by_role("slider").focus()
    page.keyboard.press("ArrowLeft")
    assert color_at(frame, 0.5) == near(GREEN)
    assert turntable.get_by_role("img").get_attribute("alt") == "my car, 120° from the front"


def test_the_tab_key_reaches_every_control(open_page, report):
    page = open_page(report(folders.evaluation))
    controls = page.locator("a[href], input, select, .wide").evaluate_all(
        "all => all.filter((e) => e.checkVisibility()).length"
    )
    reached = set()
    for _ in range(controls + 5):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate(
                "[...document.querySelectorAll('a[href], input, select, .wide')]"
                ".indexOf(document.activeElement)"
            )
        )
    assert len(reached - {-1}) == controls


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_reads_on_a_phone_and_for_the_blind(open_page, report, kind, scheme):
    page = open_page(report(kind), width=390, height=844, scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert complaints(page) == []
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(22, 24, 28)"
    assert dark == (scheme == "dark")


def test_the_check_for_the_blind_can_fail(open_page, report):
    page = open_page(report(folders.attack))
    page.evaluate(
        "document.querySelector('img').alt = '';"
        "document.querySelector('.at').removeAttribute('aria-label');"
        "document.querySelector('p').style.color = '#999'"
    )
    assert [each.split(":")[0][:8] for each in complaints(page)] == [
        "no alt",
        "no label",
        "contrast",
    ]


def test_nothing_is_fetched_and_nothing_foreign_runs(open_page, report):
    page = open_page("about:blank")
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    address = report(folders.attack)
    page.goto(address)
    assert [url for url in requests if not url.startswith("data:")] == [address]
    assert page.title().startswith("“zebra & <script>")
    refused = page.evaluate(
        """async () => {
          const inline = document.createElement("script");
          inline.textContent = "document.title = 'obeyed'";
          document.body.append(inline);
          const fetched = await fetch("http://127.0.0.1:9/").then(() => true, () => false);
          return !fetched && document.title !== "obeyed";
        }"""
    )
    assert refused


def test_prints_both_sides_and_what_was_folded(open_page, report):
    page = open_page(report(folders.attack))
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    left, right = page.locator(".slider .frame img:not([hidden])").all()
    assert left.bounding_box()["x"] + left.bounding_box()["width"] <= right.bounding_box()["x"]
    assert color_at(left, 0.9) == near(RED)
    assert color_at(right, 0.1) == near(BLUE)
    assert page.get_by_text(folders.MANIFEST["inputs"]["scene.yaml"]).is_visible()
    assert not page.get_by_label("View").is_visible()
    assert page.pdf(format="A4").startswith(b"%PDF")
