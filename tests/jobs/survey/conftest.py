"""A survey of three sources in two views."""

import pytest

from tests.jobs.survey.pictures import draw_sources


@pytest.fixture
def folder(tmp_path):
    from cnca.jobs.survey.build import build_survey

    build_survey([str(draw_sources(tmp_path / "images"))], tmp_path / "survey")
    return tmp_path / "survey"
