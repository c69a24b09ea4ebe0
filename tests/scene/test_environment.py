"""Measured skies: their sun is split off with its energy, and lamps are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cnca.core.errors import CncaError
from cnca.core.images import write_exr
from cnca.scene import environment as environment_module
from cnca.scene.environment import (
    Environment,
    read_environment,
    sky_directions,
    sky_solid_angles,
    split_sun,
)
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import Scene
from cnca.scene.weather import SkyMap

HDRI = Path(__file__).parents[3] / "shared" / "data" / "hdri"
ROWS, COLUMNS = 256, 512
D, OMEGA = sky_directions(ROWS, COLUMNS), sky_solid_angles(ROWS, COLUMNS)


def towards(altitude: float, azimuth: float) -> np.ndarray:
    h, a = np.radians([altitude, azimuth])
    return np.array([np.cos(h) * np.cos(a), np.cos(h) * np.sin(a), np.sin(h)])


def blob(altitude: float, azimuth: float, radius: float, radiance: float) -> np.ndarray:
    """A soft round light of so many degrees."""
    apart = np.degrees(np.arccos((D @ towards(altitude, azimuth)).clip(-1, 1)))
    return radiance * np.exp(-((apart / radius) ** 2))[..., None] * [1.0, 0.9, 0.7]


def sky() -> np.ndarray:
    """Brighter towards the zenith, above grey ground."""
    return (0.3 + 0.7 * D[..., 2:].clip(min=0)) * [0.6, 0.8, 1.0]


def irradiance(radiance: np.ndarray, normal: np.ndarray) -> np.ndarray:
    rows, columns = radiance.shape[:2]
    cosine = (sky_directions(rows, columns) @ normal).clip(min=0)
    weights = cosine * sky_solid_angles(rows, columns)
    return np.einsum("rcx,rc->x", radiance.astype(np.float64), weights)


def assert_energy_is_kept(before: np.ndarray, after: Environment) -> None:
    """To 1 %, on surfaces that see the whole disc of the sun or nothing of it."""
    for altitude, azimuth in ((90, 0), (50, 20), (50, 140), (50, 260), (10, 320)):
        normal = towards(altitude, azimuth)
        facing = max(float(normal @ after.sun_direction), 0.0)
        kept = irradiance(after.radiance, normal) + facing * after.sun_irradiance
        np.testing.assert_allclose(kept, irradiance(before, normal), rtol=0.01)


@pytest.mark.parametrize("peak", [3e2, 1e4, 1e6])
@pytest.mark.parametrize("altitude", [8.0, 40.0, 88.0])
def test_a_sun_is_split_off_with_its_energy(peak, altitude):
    before = sky() + blob(altitude, 130.0, 0.7, peak)
    after = split_sun(before)
    assert after.has_sun
    assert after.sun_direction @ towards(altitude, 130.0) > np.cos(np.radians(0.3))
    assert_energy_is_kept(before, after)
    assert after.radiance.max() < 2, "no trace of it stays in the sky"
    assert after.contrast < 1


@pytest.mark.parametrize(
    "lights",
    [
        [],
        [(30, 0, 0.7, 1e3), (35, 90, 0.7, 1e3)],
        [(h, a, 0.5, 500.0) for h in (10, 30) for a in range(0, 360, 45)],
        [(40, 100, 15.0, 50.0)],
        [(-20, 100, 0.7, 1e4)],
        [(40, 100, 0.7, 1.0)],
    ],
    ids=["sky alone", "two lamps", "many lamps", "a broad light", "below the horizon", "faint"],
)
def test_what_is_no_sun_stays_in_the_map(lights):
    before = sky() + sum((blob(*light) for light in lights), np.zeros(3))
    after = split_sun(before)
    assert not after.has_sun
    np.testing.assert_array_equal(after.radiance, np.float32(before))


def test_lamps_have_contrast_and_skies_have_not():
    assert split_sun(sky()).contrast < 1
    assert split_sun(sky() + sum(blob(25, a, 0.5, 2e3) for a in (0, 90, 200))).contrast > 5


@pytest.mark.parametrize(
    ("name", "altitude"),
    [
        ("blender_city.exr", 48),
        ("narrow_moonlit_road_1k.hdr", 68),
        ("kloppenheim_05_1k.hdr", 75),
        ("potsdamer_platz_1k.hdr", None),
        ("st_peters_square_night_1k.hdr", None),
        ("blender_night.exr", None),
        ("blender_sunset.exr", 3.4),
    ],
)
def test_photographed_skies(name, altitude):
    if not HDRI.is_dir():
        pytest.skip("needs ../shared/data/hdri")
    after = read_environment(SkyMap(str(HDRI / name)))
    assert after.has_sun == (altitude is not None)
    if altitude is not None:
        assert after.sun_altitude == pytest.approx(altitude, abs=0.5)


def saved(folder: Path, radiance: np.ndarray) -> str:
    path = folder / "sky.exr"
    write_exr(path, {"": np.float32(radiance)})
    return str(path)


def test_pictures_show_the_front_in_their_middle_and_the_right_to_the_right(tmp_path):
    """In our axes the front is +x, at column 0, and the right is −y, at three quarters."""
    picture = np.zeros((64, 128, 3))
    picture[:, 64:72] = [1, 0, 0]
    picture[:, 92:100] = [0, 1, 0]
    radiance = read_environment(SkyMap(saved(tmp_path, picture))).radiance
    red, green = (radiance[32, :, color].nonzero()[0] / 128 * 360 for color in (0, 1))
    assert (red > 337).all(), "just right of ahead, so clockwise of it"
    assert green.mean() == pytest.approx(270, abs=3)


def scene(folder: Path, **more) -> Scene:
    return Scene.model_validate({"sky": {"map": "sky.exr"}, "base": folder} | more)


def test_a_scenes_sun_is_where_the_map_has_it(tmp_path):
    """The picture runs the other way round and starts behind."""
    ours = sky() + blob(40.0, 130.0, 0.7, 1e4)
    saved(tmp_path, np.roll(ours, COLUMNS // 2, axis=1)[:, ::-1])
    turned = {"map": "sky.exr", "rotation": 30, "scale": 2}
    weather = scene(tmp_path, sky=turned, sun={"scale": 0.5}).weather()
    assert weather.sun_altitude == pytest.approx(40, abs=0.3)
    assert weather.sun_azimuth == pytest.approx(160, abs=0.3)
    assert (weather.sun_scale, weather.sky_scale) == (1.0, 2.0)
    moved = weather.turned(10.0, 200.0)
    assert moved.sun_altitude == weather.sun_altitude, "it was photographed there"
    assert moved.sky_map is not None
    assert moved.sky_map.rotation == pytest.approx(70, abs=0.3)


def test_a_map_without_a_sun_has_none(tmp_path):
    saved(tmp_path, sky())
    assert scene(tmp_path).weather().sun_scale == 0


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 4), (16, 32)])
@pytest.mark.parametrize("radiance", [0.0, 1.0])
def test_small_and_black_maps_are_maps(tmp_path, size, radiance):
    saved(tmp_path, np.full((*size, 3), radiance))
    environment = read_environment(SkyMap(str(tmp_path / "sky.exr")))
    assert not environment.has_sun
    assert environment.contrast == pytest.approx(0, abs=1e-3)


def test_large_maps_are_averaged(tmp_path, monkeypatch):
    """As those of 8192 columns are: to 2048 rows."""
    monkeypatch.setattr(environment_module, "MOST_ROWS", 32)
    wave = 2 + np.sin(np.arange(256) / 256 * 4 * np.pi)
    picture = np.broadcast_to(wave[None, :, None], (128, 256, 3))
    radiance = read_environment(SkyMap(saved(tmp_path, picture))).radiance
    assert radiance.shape == (32, 64, 3)
    np.testing.assert_allclose(
        np.roll(radiance[0, ::-1, 0], 32), wave.reshape(64, 4).mean(axis=1), rtol=1e-4
    )


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.nan, r"sky\.exr: 1 texels are NaN or infinite"),
        (np.inf, r"sky\.exr: 1 texels are NaN or infinite"),
        (-1e3, r"sky\.exr: has negative radiance down to -1e\+03"),
    ],
)
def test_texels_that_are_no_light_are_refused(tmp_path, value, message):
    picture = np.ones((8, 16, 3))
    picture[3, 5, 1] = value
    saved(tmp_path, picture)
    with pytest.raises(CncaError, match=message) as raised:
        scene(tmp_path).weather()
    assert "\n" not in str(raised.value)


def test_a_little_below_zero_is_black(tmp_path):
    picture = np.ones((8, 16, 3))
    picture[0, 0] = -1e-3
    assert read_environment(SkyMap(saved(tmp_path, picture))).radiance.min() == 0


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        (
            "sky: {map: none.hdr, missing: fetch it}",
            r"sky\.map: .*none\.hdr: no such file; fetch it",
        ),
        ("sky: {map: scene.yaml}", r"radiance is read from \.hdr or \.exr"),
        ("sky: {map: bad.hdr}", r"bad\.hdr: cannot be decoded"),
        ("sky: {map: bad.exr}", r"bad\.exr: cannot be read as EXR"),
        ("sky: {map: square.exr}", r"square\.exr: is 8 × 8; .*twice as wide as high"),
        ("sky: {map: square.exr}\nsun: {altitude: 3}", r"leave sun\.altitude out"),
        ("sky: {map: square.exr, height: 0}", r"sky\.height"),
    ],
)
def test_maps_that_cannot_be_used_are_refused_in_one_line(tmp_path, sections, message):
    (tmp_path / "scene.yaml").write_text(sections)
    for name in ("bad.hdr", "bad.exr"):
        (tmp_path / name).write_text("no picture")
    write_exr(tmp_path / "square.exr", {"": np.ones((8, 8, 3), np.float32)})
    with pytest.raises(CncaError, match=message) as raised:
        load_scene(tmp_path / "scene.yaml").weather()
    assert "\n" not in str(raised.value)
