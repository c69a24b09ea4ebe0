"""The picture that controls ask for, against the renderer's own."""

import cv2
import numpy as np
import pytest
import torch

from cnca import build
from cnca.core.color import linear_to_srgb
from cnca.core.errors import TextureError
from cnca.core.pictures import as_pictures
from cnca.core.types import LinearImages
from cnca.effects.plan import Demand
from cnca.jobs.view.controls import changed, controls_of
from cnca.jobs.view.costs import TARGETS
from cnca.jobs.view.keep import save_scene
from cnca.jobs.view.stage import Stage
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.views import build_views

SCENE = Scene.model_validate(
    {
        "vehicle": {"texture_size": 32},
        "image": {"width": 40, "height": 30, "samples": 4},
        "cameras": [{"azimuth": 35, "elevation": 12, "distance": 7.5}],
    }
)


def finished(stage):
    frame = stage.step()
    while not frame.done:
        frame = stage.step()
    return frame


def rendered(scene, samples):
    """The scene's first view by the renderer, one sample at a time as the live view takes it."""
    vehicle = build.build_vehicle(scene)
    renderer, albedo = build.build_path_tracer(scene, vehicle), build.build_paint(scene, vehicle)
    demand = Demand(forced={"gradient": "off", "samples": samples})
    with torch.no_grad():
        return renderer.render(
            albedo.apply(), build_views(scene)[:1], scene.weather(), seed=0, demand=demand
        )


def as_picture(images):
    return as_pictures(linear_to_srgb(LinearImages(images)))[0].astype(int)


@pytest.fixture(scope="module")
def stage():
    return Stage(SCENE)


def test_the_picture_is_refined_to_the_scenes_samples_and_then_left(stage):
    stage.show(controls_of(SCENE))
    frames = [stage.step() for _ in range(6)]
    assert [frame.samples for frame in frames] == [1, 2, 3, 4, 4, 4]
    assert frames[-1].done
    assert np.array_equal(frames[3].picture, frames[5].picture)
    apart = frames[-1].picture.astype(int) - as_picture(rendered(SCENE, 4))
    assert np.abs(apart).mean() < 3  # of 255: other random numbers after the first reflection


def test_a_camera_that_moves_keeps_what_was_built(stage):
    controls = controls_of(SCENE)
    stage.show(controls)
    built = stage._kept["camera"][1]
    stage.show(changed(controls, {"azimuth": 120.0, "moving": True}))
    moved = stage.step()
    assert stage._kept["camera"][1] is built
    assert moved.picture.shape == (30, 40, 3)
    stage.show(changed(controls, {"azimuth": 120.0, "sun_altitude": 15.0, "moving": False}))
    assert stage._kept["camera"][1] is built
    assert not np.array_equal(stage.step().picture, moved.picture)


def test_large_pictures_are_small_while_they_move():
    wide = Stage(SCENE, width=800)
    controls = controls_of(SCENE)
    wide.show(changed(controls, {"moving": True}))
    height, width = wide.step().picture.shape[:2]
    assert width * height <= 320 * 320
    assert width / height == pytest.approx(800 / 600, rel=0.01)


def test_a_target_error_says_what_it_costs(stage):
    stage.show(changed(controls_of(SCENE), {"target_error": 0.2}))
    frame = stage.step()
    assert [cost.target for cost in frame.targets] == list(TARGETS)
    times = [cost.milliseconds for cost in frame.targets]
    assert times == sorted(times, reverse=True)  # more accurate is dearer
    *effects, everything = frame.plan
    assert everything.error <= 0.2
    assert sum(row.milliseconds for row in effects) == pytest.approx(
        everything.milliseconds, rel=0.02
    )
    chosen = next(cost for cost in frame.targets if cost.target == 0.2)
    assert frame.planned == chosen.samples


def test_a_texture_is_worn_saved_and_worn_again(stage, tmp_path):
    checks = np.kron(np.indices((4, 4)).sum(axis=0) % 2, np.ones((8, 8))).astype(np.uint8) * 255
    cv2.imwrite(str(tmp_path / "checks.png"), np.stack([checks] * 3, axis=-1))
    stage.show(controls_of(SCENE))
    plain = finished(stage).picture
    stage.show(changed(controls_of(SCENE), {"texture": str(tmp_path / "checks.png")}))
    painted = finished(stage).picture
    assert np.abs(painted.astype(int) - plain).mean() > 3
    saved = load_scene(save_scene(tmp_path / "out", stage.scene, stage.albedo))
    again = Stage(saved)
    again.show(controls_of(saved))
    assert np.abs(finished(again).picture.astype(int) - painted).max() <= 1


def test_what_cannot_be_shown_leaves_what_was(stage, tmp_path):
    controls = controls_of(SCENE)
    stage.show(controls)
    before = finished(stage).picture
    with pytest.raises(TextureError, match=r"none\.png"):
        stage.show(changed(controls, {"texture": str(tmp_path / "none.png")}))
    assert np.array_equal(stage.step().picture, before)


def test_boxes_are_those_that_the_detector_finds(stage):
    street = SCENE.model_copy(
        update={"image": SCENE.image.model_copy(update={"width": 160, "height": 160})}
    )
    stage = Stage(street)
    stage.show(changed(controls_of(street), {"detector": "builtin"}))
    frame = finished(stage)
    images = torch.from_numpy(frame.picture).permute(2, 0, 1)[None] / 255
    found = build.build_detector("builtin").detect(images)[0]
    assert len(frame.boxes) == len(found.scores) > 0
    box = frame.boxes[0]
    corners = [box.left * 160, box.top * 160, box.right * 160, box.bottom * 160]
    assert corners == pytest.approx(found.boxes[0].tolist(), abs=2)
    assert (box.label, box.score) == ("car", pytest.approx(float(found.scores[0]), abs=0.05))
