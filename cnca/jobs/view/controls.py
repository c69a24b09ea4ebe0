"""What the page's controls say, and the scene that this makes of a scene: data in, data out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from cnca.core.errors import RunError
from cnca.scene.cameras import orbit_of
from cnca.scene.schema import CarlaCamera, Scene
from cnca.scene.views import build_views

LATITUDE = 50.0
"""Degrees north, at an equinox, where the hours of :func:`sun_at` pass; the vehicle heads north."""
CLEAREST = 5000.0
"""Metres of visibility from which on there is no fog."""
LIVE = "live"
"""Name of the camera that the mouse moves."""

Unit = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class Controls:
    """One state of the page; angles in degrees, lengths in metres."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    azimuth: Annotated[float, Field(ge=-360, le=720)]
    elevation: Annotated[float, Field(ge=1, le=89)]
    distance: Annotated[float, Field(ge=3, le=200)]
    sun_altitude: Annotated[float, Field(ge=-90, le=90)]
    sun_azimuth: Annotated[float, Field(ge=-360, le=720)]
    """Of a measured sky: by how much it is turned."""
    visibility: Annotated[float, Field(ge=5)] | None
    """In fog; None is clear air."""
    wetness: Unit
    """Of the ground."""
    world_seed: Annotated[int, Field(ge=0, le=2**31)]
    place: Annotated[int, Field(ge=0, le=63)]
    texture: Annotated[str, Field(max_length=1000)] = ""
    """File, or folder of a run; empty is the scene's own paint."""
    prompt: Annotated[str, Field(max_length=1000)] = ""
    """Words for the generator, in place of a texture."""
    detector: Annotated[str, Field(max_length=1000)] = ""
    """Whose boxes are drawn; empty is none."""
    target_error: Annotated[float, Field(gt=0, le=1)] | None = None
    moving: bool = False
    """Whether the mouse drags: then the picture is small."""

    @property
    def camera(self) -> tuple[float, float, float]:
        """Where it stands."""
        return self.azimuth, self.elevation, self.distance


_CONTROLS = TypeAdapter(Controls)


def controls_of(scene: Scene) -> Controls:
    """The controls as they stand in a scene file: its first camera, its own weather and world."""
    view, first = build_views(scene)[0], scene.cameras[0]
    azimuth, elevation, distance = orbit_of(view, _target(scene))
    if not isinstance(first, CarlaCamera):
        azimuth, elevation, distance = first.azimuth, first.elevation, first.distance
    measured, world = bool(scene.sky.map), scene.world
    return Controls(
        azimuth=azimuth,
        elevation=min(max(elevation, 1.0), 89.0),
        distance=min(max(distance, 3.0), 200.0),
        sun_altitude=scene.sun.altitude,
        sun_azimuth=scene.sky.rotation if measured else scene.sun.azimuth,
        visibility=scene.fog.visibility if scene.fog else None,
        wetness=scene.ground.wetness,
        world_seed=world.seed if world else 0,
        place=world.place if world else 0,
    )


def changed(controls: Controls, update: Mapping[str, Any]) -> Controls:
    """The controls with some of them moved; ``hour`` moves the sun (:func:`sun_at`).

    Raises:
        RunError: a control that there is not, or a value out of its range.
    """
    update = dict(update)
    if "hour" in update:
        hour = update.pop("hour")
        if not isinstance(hour, int | float) or not 0 <= hour <= 24:
            raise RunError(f"hour: give 0 to 24, got {hour!r:.40}")
        update["sun_altitude"], update["sun_azimuth"] = sun_at(float(hour))
    if update.get("texture"):
        update.setdefault("prompt", "")
    if update.get("prompt"):
        update.setdefault("texture", "")
    try:
        return _CONTROLS.validate_python({**asdict(controls), **update})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise RunError(f"{where}: {first['msg']}, got {first['input']!r:.40}") from None


def sun_at(hour: float) -> tuple[float, float]:
    """Altitude and azimuth of the sun at an hour of true solar time, in degrees.

    Of spherical astronomy with declination 0: sin h = cos φ cos H.
    """
    angle, latitude = math.radians(15 * (hour - 12)), math.radians(LATITUDE)
    up = math.cos(latitude) * math.cos(angle)
    north, east = -math.sin(latitude) * math.cos(angle), -math.sin(angle)
    compass = math.degrees(math.atan2(east, north))
    return math.degrees(math.asin(up)), -compass % 360


def controlled(scene: Scene, controls: Controls) -> Scene:
    """The scene as the controls have it: seen by a camera of the name :data:`LIVE` first.

    What the controls leave as it was keeps its form in the file.  Paint and target error are none
    of a scene's.
    """
    content = scene_content(scene)
    original = controls_of(scene)
    now = asdict(replace(controls, moving=False))
    moved = {key: now[key] for key, value in asdict(original).items() if now[key] != value}
    sun = "rotation" if scene.sky.map else "azimuth"
    if "sun_azimuth" in moved:
        content.setdefault("sky" if scene.sky.map else "sun", {})[sun] = moved["sun_azimuth"] % 360
    if "sun_altitude" in moved and not scene.sky.map:
        content.setdefault("sun", {})["altitude"] = moved["sun_altitude"]
    if "visibility" in moved:
        fog = {**(content.get("fog") or {}), "visibility": controls.visibility}
        content["fog"] = fog if controls.visibility is not None else None
    if "wetness" in moved:
        content.setdefault("ground", {})["wetness"] = controls.wetness
    for key, of_world in (("world_seed", "seed"), ("place", "place")):
        if key in moved and scene.world is not None:
            content["world"][of_world] = moved[key]
    content["cameras"] = [_camera(scene, controls), *_others(content)]
    return Scene.model_validate({**content, "base": scene.base})


def scene_content(scene: Scene) -> dict[str, Any]:
    """What stands in the scene's file."""
    return scene.model_dump(mode="json", exclude_unset=True)


def with_whole_paths(content: Any, base: Path) -> Any:
    """The content of a scene file whose paths do not start at ``base`` any more.

    As :func:`cnca.scene.named_files.named_files` has it, a path is a text that names a file.
    """
    if isinstance(content, dict):
        return {key: with_whole_paths(value, base) for key, value in content.items()}
    if isinstance(content, list):
        return [with_whole_paths(value, base) for value in content]
    if isinstance(content, str) and content.strip(". ") and _is_file(base / content):
        return (base / content).resolve().as_posix()
    return content


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _target(scene: Scene) -> tuple[float, float, float]:
    first = scene.cameras[0]
    return (0.0, 0.0, 0.7) if isinstance(first, CarlaCamera) else first.target


def _camera(scene: Scene, controls: Controls) -> dict[str, Any]:
    azimuth, elevation, distance = (round(number, 4) for number in controls.camera)
    return {
        "name": LIVE,
        "azimuth": azimuth % 360,
        "elevation": elevation,
        "distance": distance,
        "fov": scene.cameras[0].fov,
        "target": list(_target(scene)),
    }


def _others(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [camera for camera in content.get("cameras", []) if camera.get("name") != LIVE]
