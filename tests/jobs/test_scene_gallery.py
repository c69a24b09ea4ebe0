"""``cnca gallery``: every scene has its line and its place; a missing mesh does not stop it."""

import shutil
from pathlib import Path

import cv2
import pytest
from rich.console import Console
from typer.testing import CliRunner

from cnca.cli import app
from cnca.core.errors import RunError
from cnca.jobs import scene_gallery as module
from cnca.jobs.scene_gallery import entries, write_sheet

SCENES = Path(__file__).parents[2] / "scenes"


def test_the_shipped_scenes_are_listed():
    answer = CliRunner().invoke(app, ["gallery"], env={"COLUMNS": "200"})
    assert answer.exit_code == 0
    for file in SCENES.glob("*.yaml"):
        assert f"builtin:{file.stem}" in answer.stdout
    assert "fog 60 m" in answer.stdout


def test_a_sheet_with_a_good_scene_a_missing_mesh_and_a_broken_file(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SAMPLES", 1)
    shutil.copy(SCENES / "hard/plain.yaml", tmp_path / "a.yaml")
    shutil.copytree(SCENES / "hard/meshes", tmp_path / "meshes")
    (tmp_path / "b.yaml").write_text("vehicle: {mesh: none.obj}")
    (tmp_path / "c.yaml").write_text("vehicel: {}")
    listed = entries(tmp_path)
    problems = write_sheet(listed, tmp_path / "sheet.png", Console(quiet=True), width=145)
    assert [Path(name).name for name in problems] == ["b.yaml", "c.yaml"]
    assert "no such file" in problems[str(tmp_path / "b.yaml")]
    assert "did you mean 'vehicle'" in problems[str(tmp_path / "c.yaml")]
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape[1] == 145
    assert sheet.shape[0] > 48
    write_sheet(listed[1:], tmp_path / "plain.png", Console(quiet=True), width=144, captions=False)
    assert cv2.imread(str(tmp_path / "plain.png")).shape == (72, 144, 3)
    with pytest.raises(RunError, match="--width 3: give 96 to 8192 pixels"):
        write_sheet(listed, tmp_path / "small.png", Console(quiet=True), width=3)
    assert sheet[-48:, :48].std() > 5
    assert sheet[-40:, 60:144].std() == 0
    assert not sheet[:, 144].any()


@pytest.mark.parametrize("make", [True, False])
def test_a_folder_without_scenes_is_an_error(tmp_path, make):
    folder = tmp_path if make else tmp_path / "none"
    with pytest.raises(RunError, match="no scene files"):
        entries(folder)
