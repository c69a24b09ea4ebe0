"""The survey's folder: sources, blindness, what is refused."""

import json
import re

import cv2
import numpy as np
import pytest

from cnca.core.errors import RunError
from cnca.jobs.survey.answers import STORE, read_survey
from cnca.jobs.survey.build import build_survey, uneven
from tests.jobs.survey.pictures import SOURCES, VIEWS, draw_sources


@pytest.fixture
def images(tmp_path):
    return draw_sources(tmp_path / "images")


def test_every_picture_has_its_source(folder):
    survey = read_survey(folder)
    found = sorted((survey.sources[key], survey.names[key]) for key in survey.sources)
    assert found == sorted((source, f"{view}.png") for source in SOURCES for view in VIEWS)
    for key, source in survey.sources.items():
        picture = cv2.imread(str(folder / "pictures" / f"{key}.jpg"))[..., ::-1]
        bright = 30 * VIEWS.index(survey.names[key].removesuffix(".png"))
        assert picture[0, 0] == pytest.approx(np.array(SOURCES[source]) + bright, abs=6)


def test_the_page_does_not_give_the_sources_away(folder):
    page = (folder / "index.html").read_text()
    text = re.sub(r"base64,[\w+/=]+", "", page)  # in which any word may occur by chance
    assert not [word for word in (*SOURCES, *VIEWS) if re.search(rf"\b{word}\b", text)]
    content = json.loads(re.search(r'id="content">(.*?)</script>', page, re.DOTALL)[1])
    assert {each["key"] for each in content["pictures"]} == read_survey(folder).sources.keys()


def test_what_a_camera_wrote_into_its_files_is_gone(images, tmp_path):
    file = images / "FCA" / "front.jpg"
    plain = cv2.imencode(".jpg", np.full((60, 90, 3), 99, np.uint8))[1].tobytes()
    secret = b"Exif\0\0 GPS 52.5N 13.4E"
    marker = b"\xff\xe1" + (len(secret) + 2).to_bytes(2, "big") + secret
    file.write_bytes(plain[:2] + marker + plain[2:])
    survey = build_survey([str(images)], tmp_path / "out")
    (key,) = (key for key, name in survey.names.items() if name == "front.jpg")
    assert secret not in (tmp_path / "out" / "pictures" / f"{key}.jpg").read_bytes()


def test_sources_may_be_named_one_by_one(images, tmp_path):
    specs = [f"plain={images / 'Normal'}", str(images / "FCA"), str(images / "CNCA" / "left.png")]
    survey = build_survey(specs, tmp_path / "out")
    assert list(survey.sources.values()) == ["plain", "plain", "FCA", "FCA", "left"]
    assert uneven(survey) == "left"


def test_equal_views_are_even(folder):
    assert uneven(read_survey(folder)) is None


def test_large_pictures_shrink(images, tmp_path):
    cv2.imwrite(str(images / "FCA" / "large.png"), np.zeros((1000, 2000, 3), np.uint8))
    survey = build_survey([str(images)], tmp_path / "out")
    (key,) = (key for key, name in survey.names.items() if name == "large.png")
    assert cv2.imread(str(tmp_path / "out" / "pictures" / f"{key}.jpg")).shape[:2] == (480, 960)


def test_the_same_pictures_make_the_same_survey(images, tmp_path):
    first = build_survey([str(images)], tmp_path / "one")
    assert build_survey([str(images)], tmp_path / "two") == first
    assert build_survey([str(images)], tmp_path / "three", question="Why?").id != first.id


@pytest.mark.parametrize(
    ("specs", "message"),
    [
        (["{images}/FCA"], "one source"),
        (["{images}/nowhere"], "nowhere: no .png"),
        (["{images}/broken.png", "{images}/FCA"], r"broken\.png: cannot be read as a picture"),
        (["<b>={images}/FCA", "{images}/CNCA"], "give it a name of letters"),
    ],
)
def test_what_cannot_be_asked_is_refused(images, tmp_path, specs, message):
    (images / "broken.png").write_bytes(b"no picture")
    with pytest.raises(RunError, match=message):
        build_survey([spec.format(images=images) for spec in specs], tmp_path / "out")


def test_answers_are_not_orphaned(images, folder):
    (folder / STORE).touch()
    with pytest.raises(RunError, match=r"was started with another question \(was How natural"):
        build_survey([str(images)], folder, question="Why?")
    cv2.imwrite(str(images / "FCA" / "front.png"), np.zeros((60, 90, 3), np.uint8))
    with pytest.raises(RunError, match=r"FCA/front\.png: has changed since"):
        build_survey([str(images)], folder)


def test_without_answers_a_survey_may_be_made_anew(images, folder):
    assert build_survey([str(images)], folder, question="Why?").question == "Why?"
