"""Controls → scene, without a renderer, a server or a browser."""

import pytest

from cnca.core.errors import RunError
from cnca.jobs.view.controls import changed, controlled, controls_of, sun_at
from cnca.jobs.view.keep import save_scene
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene

STREET = Scene.model_validate(
    {
        "world": "builtin:street",
        "sun": {"altitude": 48, "scale": 0.9},
        "fog": {"visibility": 200, "height": 30},
        "cameras": [{"name": "front", "azimuth": 35, "elevation": 12, "distance": 7.5}],
    }
)


def test_the_file_as_it_is_has_only_its_camera_under_another_name():
    scene = controlled(STREET, controls_of(STREET))
    assert scene.cameras[0].model_dump(exclude={"name"}) == STREET.cameras[0].model_dump(
        exclude={"name"}
    )
    assert scene.cameras[1:] == STREET.cameras
    assert scene.model_copy(update={"cameras": STREET.cameras}) == STREET


@pytest.mark.parametrize(
    ("update", "key", "value"),
    [
        ({"sun_altitude": 20.0}, ("sun", "altitude"), 20.0),
        ({"sun_azimuth": 270.0}, ("sun", "azimuth"), 270.0),
        ({"visibility": 50.0}, ("fog", "visibility"), 50.0),
        ({"visibility": None}, ("fog",), None),
        ({"wetness": 0.6}, ("ground", "wetness"), 0.6),
        ({"world_seed": 7}, ("world", "seed"), 7),
        ({"place": 2}, ("world", "place"), 2),
    ],
)
def test_a_control_moves_its_key_and_no_other(update, key, value):
    scene = controlled(STREET, changed(controls_of(STREET), update))
    found = scene
    for name in key:
        found = getattr(found, name)
    assert found == value
    kept = {"sun": ("scale",), "fog": ("height",), "world": ("file",)}.get(key[0], ())
    if value is not None:
        section, original = getattr(scene, key[0]), getattr(STREET, key[0])
        assert all(getattr(section, name) == getattr(original, name) for name in kept)
    back = changed(changed(controls_of(STREET), update), vars(controls_of(STREET)))
    assert controlled(STREET, back) == controlled(STREET, controls_of(STREET))


def test_the_sun_over_a_day_is_that_of_the_almanac():
    """At an equinox it rises in the east at six, and at noon stands 90° − φ high in the south."""
    morning, noon, evening = sun_at(6.0), sun_at(12.0), sun_at(18.0)
    assert morning == pytest.approx((0.0, 270.0), abs=1e-6)  # at the right of the car
    assert noon == pytest.approx((40.0, 180.0), abs=1e-6)
    assert evening == pytest.approx((0.0, 90.0), abs=1e-6)


def test_the_hour_moves_the_sun():
    controls = changed(controls_of(STREET), {"hour": 9})
    assert (controls.sun_altitude, controls.sun_azimuth) == pytest.approx(sun_at(9.0))


def test_a_measured_sky_is_turned(tmp_path):
    scene = Scene.model_validate({"sky": {"map": "sky.hdr", "rotation": 30}, "base": tmp_path})
    turned = controlled(scene, changed(controls_of(scene), {"sun_azimuth": 75.0, "hour": 9}))
    assert turned.sky.rotation == pytest.approx(sun_at(9.0)[1])
    assert "altitude" not in turned.sun.model_fields_set


def test_a_paint_takes_the_other_ones_place():
    controls = changed(controls_of(STREET), {"prompt": "zebra"})
    assert changed(controls, {"texture": "run"}).prompt == ""
    assert changed(changed(controls, {"texture": "run"}), {"prompt": "x"}).texture == ""


@pytest.mark.parametrize(
    ("update", "complaint"),
    [
        ({"sun": 3}, "sun: "),
        ({"elevation": 95}, "elevation: .* 89"),
        ({"visibility": float("nan")}, "visibility: "),
        ({"hour": 25}, "hour: give 0 to 24"),
        ({"hour": "noon"}, "hour: "),
        ({"texture": 7}, "texture: "),
    ],
)
def test_what_is_no_control_is_refused_in_one_line(update, complaint):
    with pytest.raises(RunError, match=complaint):
        changed(controls_of(STREET), update)


def test_a_saved_scene_comes_back_as_it_was(tmp_path):
    moved = changed(controls_of(STREET), {"azimuth": 100.0, "visibility": 80.0, "place": 1})
    scene = controlled(STREET, moved)
    again = load_scene(save_scene(tmp_path / "out", scene, None))
    assert again.model_copy(update={"base": scene.base}) == scene
    assert controls_of(again) == moved


def test_files_that_a_scene_names_are_found_from_elsewhere(tmp_path):
    (tmp_path / "car.png").write_bytes(b"")
    content = {"vehicle": {"base_texture": "car.png", "paint_mask": "no such.png"}}
    scene = Scene.model_validate({**content, "base": tmp_path})
    vehicle = load_scene(save_scene(tmp_path / "out" / "far", scene, None)).vehicle
    assert vehicle.base_texture == (tmp_path / "car.png").as_posix()
    assert vehicle.paint_mask == "no such.png"
