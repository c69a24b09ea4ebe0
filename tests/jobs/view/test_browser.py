"""``cnca view`` in a real browser: a picture, the mouse, sliders, what is saved.

``CNCA_SCREENSHOTS=docs/images`` lets the slow test write the screenshots of docs/view.md.
"""

import os
import re
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import cv2
import pytest

from cnca.jobs.view.controls import controls_of
from cnca.scene.load_scene import load_scene
from tests.accessibility import complaints

SCENE = """
vehicle: {texture_size: 64}
cameras: [{azimuth: 35, elevation: 12, distance: 7.5}]
image: {width: 96, height: 72, samples: 4}
"""
PATIENCE = 300.0
"""Seconds for what takes one on a free machine."""


@contextmanager
def viewing(*arguments, folder):
    """``cnca view`` in a process of its own; yields the page's address."""
    command = [sys.executable, "-m", "cnca", "view", *map(str, arguments), "--port", "0"]
    process = subprocess.Popen(
        [*command, "--out", str(folder / "saved")], stdout=subprocess.PIPE, text=True
    )
    try:
        line = process.stdout.readline()
        yield re.search(r"http://127\.0\.0\.1:\d+/", line)[0]
    finally:
        process.terminate()  # shells let what they put into the background ignore Ctrl-C
        process.wait(60)


def until(page, condition, what=""):
    """Wait for a condition on the numbers that the page shows."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        numbers = page.evaluate("({...document.body.dataset})")
        if condition({key: int(value) for key, value in numbers.items()}):
            return
        time.sleep(0.05)
    raise AssertionError(f"never came: {what}; {page.locator('#note').inner_text()}")


def number(page):
    return int(page.evaluate("document.body.dataset.number"))


def until_after(page, last):
    """Wait for a picture after that of number ``last``, which was shown at rest."""
    until(page, lambda shown: shown["number"] > last, "another picture")


def picture(page):
    return page.locator("#picture").get_attribute("src")


def slide(page, label, value):
    """Move a slider as keys do: its value, then its event."""
    slider = page.get_by_label(label)
    slider.evaluate(
        "(field, value) => { field.value = value; field.dispatchEvent(new Event('input')); }", value
    )


def test_a_scene_is_turned_changed_and_saved(open_page, tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    with viewing(tmp_path / "scene.yaml", "--detector", "builtin", folder=tmp_path) as address:
        page = open_page(address)
        requests = []
        page.on("request", lambda request: requests.append(request.url))
        until(page, lambda shown: shown.get("samples") == 4, "the whole picture")
        assert page.locator("#plan tr").count() > 8
        assert complaints(page) == []

        before, last = picture(page), number(page)
        frame = page.locator("#frame").bounding_box()
        page.mouse.move(frame["x"] + 50, frame["y"] + 50)
        page.mouse.down()
        page.mouse.move(frame["x"] + 250, frame["y"] + 50, steps=5)
        until_after(page, last)
        assert picture(page) != before
        page.mouse.up()
        until(page, lambda shown: shown["samples"] == 4, "the picture at rest")

        last = number(page)
        slide(page, "sun altitude", 15)
        until_after(page, last)
        page.get_by_label("detector").fill("no such detector")
        page.get_by_label("detector").press("Enter")
        page.get_by_text("detector 'no such detector': unknown").wait_for()
        page.get_by_label("detector").fill("")
        page.get_by_label("detector").press("Enter")
        until(page, lambda shown: shown["samples"] == 4, "the picture at rest")

        for button in ("Save as scene file", "Save picture"):
            page.get_by_role("button", name=button).click()
            page.get_by_text("saved/" + ("scene" if "scene" in button else "picture")).wait_for()
        outside = [url for url in requests if not url.startswith((address, "data:"))]
        assert outside == []

    saved = controls_of(load_scene(next((tmp_path / "saved").glob("scene_*.yaml"))))
    assert saved.azimuth == pytest.approx((35 - 200 * 0.4) % 360, abs=0.01)
    assert saved.sun_altitude == 15.0
    kept = cv2.imread(str(next((tmp_path / "saved").glob("picture_*.png"))))
    assert kept.shape == (72, 96, 3)


@pytest.mark.slow
def test_the_street_with_a_prompt_for_the_docs(open_page, tmp_path):
    arguments = ["builtin:street_day", "--detector", "builtin", "--prompt", "zebra strips"]
    with viewing(*arguments, folder=tmp_path) as address:
        page = open_page(address, width=1180, height=1330)
        until(page, lambda shown: shown.get("samples", 0) >= 32, "the whole picture")
        assert page.locator("#boxes div").count() >= 1
        shots = os.environ.get("CNCA_SCREENSHOTS")
        page.screenshot(path=Path(shots or tmp_path) / "view.jpg", quality=85)
        last = number(page)
        slide(page, "target error", 30)
        slide(page, "visibility", 45)
        slide(page, "time of day", 16.5)
        until_after(page, last)
        until(page, lambda shown: shown["samples"] >= 24, "the picture in fog")
        page.screenshot(path=Path(shots or tmp_path) / "view_fog.jpg", quality=85)
