"""The Mitsuba backend: a :class:`cnca.effects.protocols.PlanningRenderer`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import torch
from jaxtyping import Float, Int

from cnca.core.errors import TextureError
from cnca.core.types import Boxes, LinearImages, LinearTexture
from cnca.effects.catalog import amounts
from cnca.effects.caustics import BOUNDS
from cnca.effects.effect import Model
from cnca.effects.plan import Demand, EffectPlan, plan
from cnca.effects.subject import Contents, Subject
from cnca.mi_bridge.atmosphere import Atmosphere, make_atmosphere
from cnca.mi_bridge.bridge import Shot, render
from cnca.mi_bridge.finite import refuse_non_finite
from cnca.mi_bridge.forward import ForwardShare
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.layers import first_hits, mask_boxes, refuse_inside, vehicle_mask
from cnca.mi_bridge.light import Light
from cnca.mi_bridge.memory import refuse_too_many, samples_at_once
from cnca.mi_bridge.portions import REST, WHOLE, Portion, vehicle_part
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.sightings import Sightings
from cnca.mi_bridge.worlds import Worlds, one_spot
from cnca.scene.cameras import Spot, View
from cnca.scene.layers import Layers, Sighting
from cnca.scene.weather import Weather
from cnca.vehicle.model import Part, Vehicle
from cnca.world.model import World

WEATHERS_KEPT = 64
"""Weathers whose sky and fog stay in memory (about 3 MB each)."""

ROUNDING = 1e-4
"""By how much an albedo may leave [0, 1]; less than the floor that keeps it positive."""


VISIBLE_SAMPLES = 64
"""Looks at each pixel for what hides the vehicle there."""


class MitsubaRenderer:
    """Path-traced pictures of one vehicle, differentiable in its texture."""

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        ground_albedo: Sequence[float] = (0.15, 0.15, 0.15),
        texture_size: int = 512,
        samples: int = 16,
        bounces: int = 2,
        exposure: float = 1.0,
        props: tuple[Part, ...] = (),
        demand: Demand | None = None,
        worlds: Callable[[Spot], World] | None = None,
    ) -> None:
        """
        Args:
            ground_albedo: linear RGB in [0, 1].
            texture_size: texels per side of the textures that :meth:`render` takes.
            samples: rays per pixel, unless ``demand`` asks for others.
            bounces: surface reflections of a path, likewise; 1 is sun and sky alone.
            exposure: factor on the metered exposure.
            props: other things that stand around; painted ones wear the vehicle's texture.
            demand: which effects to render how, unless a picture asks for something else; by
                default the usual ones.
            worlds: what stands around the vehicle, which faces +x in its origin, at each spot.
        """
        self.vehicle = vehicle
        self.ground_albedo = np.asarray(ground_albedo, dtype=np.float64)
        self._demand = demand or Demand()
        self._usual: dict[str, Model] = {"samples": samples, "interreflection": bounces}
        self.exposure = exposure
        everything = replace(vehicle, parts=(*vehicle.parts, *props))
        self._amounts = amounts(Contents(everything, worlds(Spot()) if worlds else None))

        self._forward_share = lru_cache(ForwardShare)
        self._atmosphere = lru_cache(maxsize=WEATHERS_KEPT)(self._make_atmosphere)
        self.texture_size = texture_size
        texels = max(texture_size, 2)  # Mitsuba knows no texture of one texel: it is repeated
        self._build = partial(Geometry, vehicle, self.ground_albedo, texels, props)
        # What is most likely asked for, since kernels go on holding code of what was built before.
        best: dict[str, Model] = {
            "materials": "coat" if self._amounts["materials"] else "principled",
            "glass": "pane" if self._amounts["glass"] else "dark",
            **self._demand.forced,
        }
        self._worn = (str(best["materials"]), str(best["glass"]))
        self.geometry = self._build(*self._worn)
        self._make_world = worlds
        self._sightings = lru_cache(1)(self._find_objects)
        self.worlds = Worlds(worlds, self.geometry) if worlds else None

    def render(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        *,
        seed: int,
        demand: Demand | None = None,
    ) -> LinearImages:
        """Exposed linear images (views, 3, height, width).

        Args:
            demand: which effects to render how; None is what the renderer was made with.

        Raises:
            TextureError: the texture has another shape than (3, size, size), holds NaN, or leaves
                [0, 1].
            NonFiniteError: a view, or a gradient in the backward pass, holds NaN or infinity.
            BackendError: there is too little memory.
        """
        chosen = self.plan(albedo, views, weather, demand=demand)
        return LinearImages(self._expose(albedo, views, chosen, None, seed).permute(0, 3, 1, 2))

    def render_pixels(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        pixels: Int[np.ndarray, " pixels"],
        *,
        seed: int,
        samples: int | None = None,
    ) -> Float[torch.Tensor, "pixels 3"]:
        """Like :meth:`render`, but only these pixels, counted over views, rows and columns.

        ``samples`` are rays per pixel in place of those that the plan takes.
        """
        chosen = self.plan(albedo, views, weather, samples=samples)
        return self._expose(albedo, views, chosen, pixels, seed)

    def render_vehicle(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        pixels: Int[np.ndarray, " pixels"],
        shares: Float[np.ndarray, " pixels"],
        *,
        seed: int,
        samples: int | None = None,
    ) -> Float[torch.Tensor, "pixels 3"]:
        """What the vehicle alone adds to these pixels of pictures in a world.

        Args:
            shares: of what the vehicle covers of each pixel, the share that nothing hides.
        """
        chosen = self.plan(albedo, views, weather, samples=samples)
        return self._expose(albedo, views, chosen, pixels, seed, vehicle_part(shares))

    def render_rest(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        pixels: Int[np.ndarray, " pixels"],
        *,
        seed: int,
    ) -> Float[torch.Tensor, "pixels 3"]:
        """What all but the vehicle adds to these pixels."""
        chosen = self.plan(albedo, views, weather)
        return self._expose(albedo, views, chosen, pixels, seed, REST)

    def _expose(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        chosen: EffectPlan,
        pixels: Int[np.ndarray, " pixels"] | None,
        seed: int,
        portion: Portion = WHOLE,
    ) -> Float[torch.Tensor, "*film 3"]:
        if chosen["gradient"] == "off":
            albedo = LinearTexture(albedo.detach())
        shots = self.shots(chosen, views, pixels, seed=seed, portion=portion)
        texels = self.geometry.texture_size
        texture = albedo.expand(3, texels, texels).permute(1, 2, 0)
        images = render(texture, shots)
        refuse_non_finite(images, texture, shots[0].cameras, chosen.subject.weather, seed)
        return images

    def shots(
        self,
        chosen: EffectPlan,
        views: Sequence[View],
        pixels: Int[np.ndarray, " pixels"] | None,
        *,
        seed: int,
        most_rays: int | None = None,
        portion: Portion = WHOLE,
    ) -> list[Shot]:
        """The parts that a picture of these views, or of these pixels of them, is rendered in."""
        self._wear(str(chosen["materials"]), str(chosen["glass"]))
        cameras = self._cameras(views, pixels)
        atmosphere = self._atmosphere(
            chosen.weather, str(chosen["sun"]), str(chosen["sky"]), str(chosen["fog"])
        )
        geometry, around, white = self.geometry, atmosphere.surroundings, atmosphere.white
        if self.worlds is not None:
            rung = str(chosen.demand.forced.get("surroundings", portion.rung))
            geometry, around, white = self.worlds.light(one_spot(views), atmosphere, rung)
        around = replace(around, brightest=BOUNDS[str(chosen["caustics"])])
        at_once = min(samples_at_once(cameras.lanes(1), most_rays), chosen.samples)
        refuse_too_many(cameras.lanes(at_once))
        return [
            Shot(
                geometry,
                around,
                cameras,
                samples=min(at_once, chosen.samples - first),
                bounces=chosen.bounces,
                seed=seed,
                exposure=self.exposure / white,
                first=first,
                only=portion.only,
                shares=portion.shares,
            )
            for first in range(0, chosen.samples, at_once)
        ]

    def light_at(self, weather: Weather, spot: Spot) -> tuple[Light, float]:
        """The light of a world without the vehicle, seen from its middle, and white card there."""
        assert self.worlds is not None
        weather = replace(weather, fog=None)  # as plain shading has it
        return self.worlds.kept_light(spot, self._atmosphere(weather, "direction", "map", "none"))

    def layers(self, views: Sequence[View]) -> Layers:
        """What each view's camera hits first; independent of texture and weather."""
        return first_hits(self._traced(views), self._cameras(views))

    def _traced(self, views: Sequence[View]) -> Geometry:
        """The vehicle with all that stands around it in these views."""
        return self.worlds.traced(one_spot(views)) if self.worlds else self.geometry

    def vehicle_mask(self, views: Sequence[View]) -> Float[np.ndarray, "views height width"]:
        """Share of each pixel that the vehicle covers, in [0, 1]."""
        return vehicle_mask(self._traced(views), self._cameras(views))

    def sightings(self, views: Sequence[View]) -> list[list[Sighting]]:
        """What else with a label each view shows."""
        if self.worlds is None:
            return [[] for _ in views]
        spot = one_spot(views)
        return self._sightings(spot).look(self.worlds.traced(spot), self._cameras(views))

    def visible_shares(self, views: Sequence[View]) -> list[float]:
        """Share of the vehicle in each picture that nothing of the world hides, in [0, 1].

        0 where the vehicle is not in the picture at all.
        """
        cameras = self._cameras(views)
        seen = vehicle_mask(self._traced(views), cameras).sum(axis=(1, 2))
        whole = vehicle_mask(self.geometry, cameras).sum(axis=(1, 2))
        return (seen / np.maximum(whole, 1e-9)).clip(0, 1).tolist()

    def visible_pixels(
        self, view: View, pixels: Int[np.ndarray, " pixels"]
    ) -> Float[np.ndarray, " pixels"]:
        """Of what the vehicle covers of each pixel, the share that nothing hides."""
        cameras = self._cameras([view], pixels)
        seen = vehicle_mask(self._traced([view]), cameras, VISIBLE_SAMPLES)
        whole = vehicle_mask(self.geometry, cameras, VISIBLE_SAMPLES)
        return np.where(whole > 0, seen / np.maximum(whole, 1e-9), 0.0).clip(0, 1)

    def vehicle_boxes(self, views: Sequence[View]) -> Boxes:
        """Bounding boxes (views, 4) of all pixels that the vehicle touches, xyxy.

        Raises:
            SceneError: a view does not show the vehicle, or its camera is inside of it.
        """
        for view in views:
            refuse_inside(self.geometry, self.geometry.local(view))
        return mask_boxes(self.vehicle_mask(views), views)

    def plan(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        *,
        samples: int | None = None,
        demand: Demand | None = None,
    ) -> EffectPlan:
        """Which model stands for each effect in these pictures.

        Args:
            samples: rays per pixel, whatever else would be chosen.
            demand: as in :meth:`render`.

        Raises TextureError as :meth:`render` does.
        """
        refuse_bad_texture(albedo.detach(), self.texture_size)
        subject = Subject(
            weather,
            ground=float(self.ground_albedo.mean()),
            paint=float(albedo.detach().mean().clamp(0, 1)),
            fog_path=max(_path_in_layer(self.geometry.local(v), weather) for v in views),
            pixels_per_metre=min(_pixels_per_metre(self.geometry.local(view)) for view in views),
            amounts=self._amounts,
        )
        demand = demand or self._demand
        if samples:
            demand = replace(demand, forced={**demand.forced, "samples": samples})
        return plan(subject, demand, usual=self._usual)

    def _cameras(
        self, views: Sequence[View], pixels: Int[np.ndarray, " pixels"] | None = None
    ) -> Cameras:
        return Cameras([self.geometry.local(view) for view in views], pixels)

    def _wear(self, materials: str, glass: str) -> None:
        """Exchange the geometry: kernels hold the code of all materials that exist."""
        if (materials, glass) != self._worn:
            self._atmosphere.cache_clear()
            self._forward_share.cache_clear()
            self._worn, self.geometry = (materials, glass), self._build(materials, glass)
            if self._make_world is not None:
                self.worlds = Worlds(self._make_world, self.geometry)

    def _find_objects(self, spot: Spot) -> Sightings:
        assert self._make_world is not None
        return Sightings(self._make_world(spot))

    def _make_atmosphere(self, weather: Weather, sun: str, sky: str, fog: str) -> Atmosphere:
        forward = partial(self._forward_share, self.geometry) if self.vehicle.parts else None
        return make_atmosphere(
            weather,
            self.ground_albedo,
            sun=sun,
            sky=sky,
            fog=fog,
            panes=self.geometry.has_panes,
            forward=forward,
            ground=self.geometry.ground if self._make_world is None else None,
        )


def _pixels_per_metre(view: View) -> float:
    """At the distance of the vehicle's foot."""
    distance = max(float(np.linalg.norm(view.origin)), 1e-3)
    return view.width / (2 * np.tan(np.radians(view.fov) / 2) * distance)


def _path_in_layer(view: View, weather: Weather) -> float:
    """Metres of the way from the camera to the vehicle's foot that lie in fog."""
    if weather.fog is None:
        return 0.0
    height = view.origin[2]
    inside = min(weather.fog.height / height, 1.0) if height > 0 else 1.0
    return float(np.linalg.norm(view.origin)) * inside


def refuse_bad_texture(albedo: torch.Tensor, size: int) -> None:
    """Raise TextureError for another shape than (3, size, size), NaN, or values off [0, 1]."""
    if tuple(albedo.shape) != (3, size, size):
        raise TextureError(
            f"texture of shape {tuple(albedo.shape)}: the renderer takes (3, {size}, {size})"
        )
    low, high = (float(bound) for bound in torch.aminmax(albedo))  # NaN if any texel is
    if not (low >= -ROUNDING and high <= 1 + ROUNDING):
        raise TextureError(f"texture has values from {low:g} to {high:g}: albedo lies in [0, 1]")
