"""The scene file: what may stand in ``scenes/*.yaml`` and in which range.

Lengths are in metres, angles in degrees, colors sRGB in [0, 1], paths relative to the scene file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from cnca.scene.environment import read_environment
from cnca.scene.materials import MATERIALS
from cnca.scene.values import (
    Altitude,
    AltitudeRange,
    Asymmetry,
    Azimuth,
    Color,
    Coordinate,
    Elevation,
    ElevationRange,
    FieldOfView,
    Label,
    NonNegative,
    Positive,
    PositiveRange,
    Range,
    Switch,
    Unit,
)
from cnca.scene.weather import Fog, SkyMap, Weather


class Section(BaseModel):
    """A part of the file; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


class FinishSection(Section):
    """How the paint reflects light; see :class:`cnca.scene.materials.Material`."""

    roughness: Unit = MATERIALS["paint"].roughness
    metallic: Unit = MATERIALS["paint"].metallic
    clearcoat: Unit = MATERIALS["paint"].clearcoat
    clearcoat_gloss: Unit = MATERIALS["paint"].clearcoat_gloss


class VehicleSection(Section):
    """The vehicle and its paint."""

    mesh: str = "builtin:sedan"
    """``builtin:NAME`` or the path of an OBJ, PLY, glTF or GLB file."""
    missing: str | None = None
    """What to tell a user who does not have the mesh: what to put where."""
    label: Label = "car"
    """What it is: the class as which detectors are to find it, such as truck, bus or boat."""
    up: Literal["x", "y", "z"] = "y"
    """The file's upward axis."""
    front: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = "+x"
    """The file's forward axis."""
    scale: Positive = 1.0
    """Metres per unit of the file."""
    recentre: bool = True
    """Move a vehicle onto the origin that stands away from it by more than a third of its size."""
    unwrap: bool = False
    """Give the paint new UVs: for meshes whose texture coordinates overlap or are missing."""
    materials: dict[str, str] = Field(default_factory=dict)
    """The file's material names → ours; names left out are guessed."""
    paint_mask: str | None = None
    """Picture in UV space, white where there is paint; without it every textured texel is paint."""
    base_texture: str | None = None
    """Picture in UV space of everything that is not paint, and of the paint before an attack."""
    paint: Color = (0.75, 0.76, 0.78)
    """sRGB color of the plain paint where there is no base texture."""
    finish: FinishSection = FinishSection()
    """The paint's gloss."""
    glass_transmission: Unit = 0.0
    """Share of light that passes the windows; 0 is dark glass, and hides that nothing is inside."""
    texture_size: Annotated[int, Field(ge=1, le=8192)] = 512
    """Texels per side of the texture that the renderer sees."""


class GroundSection(Section):
    """A flat, matt ground at z = 0."""

    color: Color = (0.42, 0.41, 0.40)
    wetness: Unit = 0.0
    """Of the ground, a world's too: up to 0.5 a film of water, then puddles."""


class WorldPart(Section):
    """Another file that stands in the world, read as the world's own is."""

    file: str
    at: tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Coordinate]
    """Where its origin lies: metres in the world's axes, +z up."""
    heading: Annotated[float, Field(ge=-360, le=720)] = 0.0
    """By how many degrees it is turned counter-clockwise."""


class WorldSection(Section):
    """What stands around the vehicle; ``world: FILE`` is short for ``world: {file: FILE}``."""

    file: str
    """``builtin:NAME`` or the path of an OBJ, PLY, glTF, GLB or Mitsuba XML file."""
    missing: str | None = None
    """What to tell a user who does not have the file: what to put where."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Which of its many forms a built-in world takes."""
    place: Annotated[int, Field(ge=0)] = 0
    """Number of the place, of those that the world knows, where the vehicle stands."""
    at: tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Where else it stands: metres in the world's axes, +z up; without a height, on the ground."""
    heading: Annotated[float, Field(ge=-360, le=720)] | None = None
    """Where the vehicle heads there: degrees counter-clockwise from the world's +x."""
    places: tuple[tuple[Coordinate, Coordinate, Coordinate], ...] = ()
    """x, y and heading of the places that variation draws from; built-in worlds know theirs."""
    up: Literal["x", "y", "z"] | None = None
    """The file's upward axis; by default y for glTF and Mitsuba XML, else z."""
    scale: Positive = 1.0
    """Metres per unit of the file."""
    parts: tuple[WorldPart, ...] = ()
    """More files that stand in it, such as the houses of a town."""
    lamps: Switch = "auto"
    """Street lamps, lights of traffic and windows; ``auto`` turns them on when the sun is down."""


def _as_section(world: Any) -> Any:
    return {"file": world} if isinstance(world, str) else world


class SunSection(Section):
    """The sun; azimuth counter-clockwise from the vehicle's front."""

    altitude: Altitude = 45.0
    azimuth: Azimuth = 120.0
    scale: NonNegative = 1.0


class SkySection(Section):
    """A clear sky after Hosek and Wilkie, or a measured environment."""

    turbidity: Annotated[float, Field(ge=1, le=10)] = 3.0
    scale: NonNegative = 1.0
    map: str | None = None
    """A latitude–longitude picture, ``.hdr`` or ``.exr``, of sky, sun and ground."""
    missing: str | None = None
    """What to tell a user who does not have the map: what to put where."""
    rotation: Azimuth = 0.0
    """Of the map; at 0 its middle is ahead of the vehicle."""
    height: Positive = 1.6
    """Of the camera that took the map, above the ground."""
    radius: Positive = 20.0
    """How far the open ground reaches; what the map has beyond is seen at that distance."""


class FogSection(Section):
    """A fog layer from the ground up to ``height``."""

    visibility: Positive
    height: NonNegative = 60.0
    albedo: Unit = 0.99
    asymmetry: Asymmetry = 0.85


class OrbitCamera(Section):
    """A camera that circles the vehicle."""

    name: str | None = None
    azimuth: Azimuth
    elevation: Elevation
    distance: Positive
    fov: FieldOfView = 45.0
    target: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.7)


class CarlaCamera(Section):
    """The pose of a CARLA frame stored as ``.npz`` (keys ``veh_trans`` and ``cam_trans``)."""

    name: str | None = None
    carla: str
    fov: FieldOfView = 90.0
    lift: Coordinate = 0.0
    """Our z = 0 above CARLA's vehicle location in metres; negative where it lies below."""


class VariationSection(Section):
    """The ranges from which ``cnca optimize`` draws views and weather."""

    azimuth: Range = (0.0, 360.0)
    elevation: ElevationRange = (5.0, 30.0)
    distance: PositiveRange = (6.0, 10.0)
    fov: FieldOfView = 45.0
    sun_altitude: AltitudeRange = (20.0, 70.0)
    sun_azimuth: Range = (0.0, 360.0)
    visibility: PositiveRange | None = None
    """Without it every draw has the scene's own fog."""
    worlds: Annotated[int, Field(ge=1, le=64)] = 2
    """Forms of a built-in world that a run draws."""
    places: Annotated[int, Field(ge=0, le=64)] = 4
    """Places that it draws in each; 0 stays at the scene's own."""


class ImageSection(Section):
    """The picture."""

    width: Annotated[int, Field(ge=1, le=8192)] = 320
    height: Annotated[int, Field(ge=1, le=8192)] = 320
    samples: Annotated[int, Field(ge=1, le=65536)] = 64
    """Rays per pixel."""
    exposure: Positive = 1.0
    """Factor on the metered exposure (see ``cnca.mi_bridge.light``)."""


class Scene(Section):
    """A whole scene file."""

    vehicle: VehicleSection = VehicleSection()
    ground: GroundSection = GroundSection()
    world: Annotated[WorldSection | None, BeforeValidator(_as_section)] = None
    """Without it the vehicle stands alone on the ground."""
    sun: SunSection = SunSection()
    sky: SkySection = SkySection()
    fog: FogSection | None = None
    cameras: Annotated[tuple[OrbitCamera | CarlaCamera, ...], Field(min_length=1)] = (
        OrbitCamera(name="front_left", azimuth=35, elevation=12, distance=7.5),
    )
    variation: VariationSection = VariationSection()
    image: ImageSection = ImageSection()
    base: Path = Field(default=Path("."), exclude=True)
    """The folder that relative paths start from; set by :mod:`cnca.scene.load_scene`."""

    @model_validator(mode="after")
    def _unique_names(self) -> Scene:
        names = [camera.name for camera in self.cameras if camera.name]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise ValueError(f"two cameras are named '{twice}'")
        return self

    @model_validator(mode="after")
    def _fits_the_map(self) -> Scene:
        place = {"altitude", "azimuth"} & self.sun.model_fields_set
        if self.sky.map and place:
            key = min(place)
            raise ValueError(f"sky.map has its own sun: leave sun.{key} out, or turn sky.rotation")
        if self.sky.map and self.ground.wetness > 0 and self.world is None:
            raise ValueError("ground.wetness: the ground of sky.map stays as it was photographed")
        return self

    def weather(self) -> Weather:
        """The scene's own sun, sky and fog.

        Raises:
            SceneError, TextureError: the sky's map is missing or cannot be read.
        """
        fog = Fog(**self.fog.model_dump()) if self.fog else None
        if self.sky.map:
            return self._measured_weather(self.sky.map, fog)
        return Weather(
            sun_altitude=self.sun.altitude,
            sun_azimuth=self.sun.azimuth,
            turbidity=self.sky.turbidity,
            sun_scale=self.sun.scale,
            sky_scale=self.sky.scale,
            fog=fog,
            lamps=self.world.lamps if self.world else "auto",
        )

    def _measured_weather(self, file: str, fog: Fog | None) -> Weather:
        """The light of a map: its sun, where it has one, shines from where it was photographed."""
        sky, path = self.sky, (self.base / file).as_posix()
        sky_map = SkyMap(path, sky.rotation, sky.height, sky.radius, sky.missing)
        environment = read_environment(sky_map)
        return Weather(
            sun_altitude=environment.sun_altitude,
            sun_azimuth=environment.sun_azimuth + sky.rotation,
            sun_scale=self.sun.scale * sky.scale if environment.has_sun else 0.0,
            sky_scale=sky.scale,
            fog=fog,
            sky_map=sky_map,
            lamps=self.world.lamps if self.world else "auto",
        )
