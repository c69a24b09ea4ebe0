"""What a report says, and which folders it refuses."""

import json
import math
from xml.etree import ElementTree

import numpy as np
import pytest
from rich.console import Console

from cnca import build
from cnca.core.errors import CncaError, RunError
from cnca.report import MEANING, shown_views, write_report
from cnca.report.attack import attack_parts
from cnca.report.curves import draw
from cnca.report.markdown import as_html
from cnca.report.turntable import FIELD_OF_VIEW, HEIGHT, WIDTH, around, turntables
from cnca.vehicle.mesh.load_mesh import resolve_vehicle
from tests.report import folders

SCENE = "vehicle: {mesh: builtin:sedan, texture_size: 16}\n"


def quiet() -> Console:
    return Console(quiet=True)


@pytest.mark.parametrize("kind", [folders.attack, folders.evaluation, folders.tradeoff])
def test_a_damaged_file_is_named(tmp_path, kind):
    folder = kind(tmp_path / "run")
    main = next(folder.glob("[srt]*.json"))
    main.write_text(main.read_text()[:-5])
    with pytest.raises(RunError, match=rf"{main.name}: damaged .*; run its command again"):
        write_report(folder)


def test_a_missing_picture_is_named(tmp_path):
    folder = folders.attack(tmp_path / "run")
    (folder / "before_after.png").unlink()
    with pytest.raises(CncaError, match=r"before_after\.png"):
        write_report(folder)


def test_a_folder_without_a_finished_run_is_refused(tmp_path):
    with pytest.raises(RunError, match="holds no finished run"):
        write_report(tmp_path)


def test_scores_and_their_intervals(tmp_path):
    """Against the same percentile bootstrap by numpy: resamples differ, 1000 of them by little."""
    part = attack_parts(folders.attack(tmp_path / "run") / "summary.json")[0]
    scores = np.array(folders.SCORES["before"])
    drawn = np.random.default_rng(1).choice(scores, (20_000, len(scores))).mean(axis=1)
    row = str(part.blocks[0].html).split(MEANING["before"])[1].split("</td>")[0]
    numbers = row.split("<td>")[1].replace("[", "").replace("]", "").replace(",", "")
    value, low, high = map(float, numbers.split())
    assert value == pytest.approx(scores.mean(), abs=5e-4)
    # A percentile p of 1000 draws varies by sqrt(p (1 - p) / 1000) / density: under a tenth of the
    # standard error of the mean for 2.5 % of a normal distribution; four of these.
    slack = 4 * 0.1 * scores.std() / math.sqrt(len(scores)) + 5e-4
    assert (low, high) == pytest.approx(tuple(np.percentile(drawn, (2.5, 97.5))), abs=slack)


def test_every_detector_has_its_table(tmp_path):
    own = folders.SUMMARY
    both = own | {"detectors": {"one": own, "two": own | {"AP@0.5": dict.fromkeys(MEANING, 0.25)}}}
    path = folders.attack(tmp_path / "run") / "summary.json"
    path.write_text(json.dumps(both))
    part = attack_parts(path)[0]
    assert part.title.endswith("against one, two")
    html = str(part.blocks[0].html)
    assert (html.count("<table>"), html.count("0.250</td>")) == (2, len(MEANING))


@pytest.mark.parametrize(("count", "views"), [(1, [0]), (3, [0, 1, 2]), (24, [0, 6, 12, 18])])
def test_shown_views_are_spread(count, views):
    assert list(shown_views(count)) == views


def test_markdown_escapes_and_names_rows():
    text = "| a | b |\n|---|---|\n| <b>x</b> | 1 [0.1, 0.2] |\n"
    html = as_html(text)
    assert "&lt;b&gt;x" in html
    assert html.count('scope="col"') == 2
    assert '<th scope="row">' in html
    assert "[0.1,\N{NO-BREAK SPACE}0.2]" in html


def test_a_curve_takes_the_color_of_the_page():
    drawing = ElementTree.fromstring(draw([1, 2], [3.0, 1.5], "loss, L_adv"))
    assert drawing.get("aria-label") == "loss, L_adv: 3.00 at first, 1.50 at last"
    assert "currentColor" in ElementTree.tostring(drawing, "unicode")
    ids = [each.get("id") for each in drawing.iter() if each.get("id")]
    assert all(one.startswith("loss-") for one in ids)


@pytest.mark.parametrize("name", ["builtin:sedan", "builtin:van"])
def test_a_turning_vehicle_stays_in_the_picture(tmp_path, name):
    """By our own pinhole: no vertex lies outside of any picture's edges."""
    vehicle = resolve_vehicle(name, tmp_path)
    corners = np.concatenate([part.vertices for part in vehicle.parts])
    for view in around(vehicle, 5):
        forward = np.subtract(view.target, view.origin)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, view.up)
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        x, y, z = np.stack([right, up, forward]) @ (corners - view.origin).T
        half = math.tan(math.radians(FIELD_OF_VIEW / 2))
        assert np.abs(x / z).max() < half
        assert np.abs(y / z).max() < half * HEIGHT / WIDTH


class Painter:
    """Pictures as bright as the texture; counts them."""

    def __init__(self):
        self.rendered = 0

    def render(self, albedo, views, weather, *, seed):
        self.rendered += len(views)
        return albedo.mean().expand(len(views), 3, 6, 8)


@pytest.fixture
def painted_run(tmp_path, monkeypatch):
    painter = Painter()
    monkeypatch.setattr(build, "build_renderer", lambda *_, **__: painter)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    return folders.attack(tmp_path / "run"), painter


def test_turntables_are_rendered_once(painted_run):
    folder, painter = painted_run
    first = turntables(folder, 5, quiet())
    assert [(each.name, len(each.frames)) for each in first] == [("camouflage", 5)]
    assert turntables(folder, 5, quiet()) == first
    assert painter.rendered == 5
    folders.write_png(folder / "texture.png", folders.flat(folders.GREEN))
    assert turntables(folder, 5, quiet()) != first
    assert painter.rendered == 10


def test_without_its_scene_a_run_has_no_turntable(painted_run, capsys):
    folder, _ = painted_run
    (folder.parent / "scene.yaml").unlink()
    assert turntables(folder, 5, Console(stderr=True)) == []
    assert "no turntable of camouflage" in capsys.readouterr().err


def test_every_run_of_a_comparison_turns(painted_run):
    folder, _ = painted_run
    both = turntables(folders.tradeoff(folder.parent / "both"), 2, quiet())
    assert [each.name for each in both] == ["τ = 0.1", "τ = 1"]


@pytest.mark.parametrize("frames", [-1, 361])
def test_frames_have_limits(tmp_path, frames):
    with pytest.raises(RunError, match=f"--turntable {frames}"):
        turntables(tmp_path, frames, quiet())
