"""The Mitsuba backend: a :class:`cnca.effects.protocols.PlanningRenderer`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float, Int

from cnca.core.types import Boxes, LinearImages, LinearTexture
from cnca.effects.catalog import amounts
from cnca.effects.effect import Model
from cnca.effects.plan import Demand, EffectPlan, plan
from cnca.effects.subject import Contents, Subject
from cnca.effects.world import GEOMETRY
from cnca.mi_bridge.bridge import Shot, render
from cnca.mi_bridge.built_scene import BuiltScene
from cnca.mi_bridge.finite import refuse_non_finite
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.layers import first_hits, mask_boxes, refuse_inside, vehicle_mask
from cnca.mi_bridge.memory import refuse_too_many, samples_at_once
from cnca.mi_bridge.portions import WHOLE, Portion
from cnca.mi_bridge.rays import Cameras
from cnca.mi_bridge.texture_check import refuse_bad_texture
from cnca.mi_bridge.worlds import Worlds
from cnca.scene.cameras import Spot, View
from cnca.scene.layers import Layers, Sighting
from cnca.scene.weather import Weather
from cnca.vehicle.model import Part, Vehicle
from cnca.world.model import World

VISIBLE_SAMPLES = 64
"""Rays per pixel that look for what hides the vehicle there."""


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
        wetness: float = 0.0,
    ) -> None:
        """
        Args:
            ground_albedo: linear RGB in [0, 1].
            texture_size: texels per side of the textures that :meth:`render` takes.
            samples: rays per pixel, unless ``demand`` asks for others.
            bounces: surface reflections of a path, likewise; 1 is sun and sky alone.
            exposure: factor on the metered exposure.
            props: other things that stand around; painted ones wear the vehicle's texture.
            demand: which effects to render and how, unless a picture asks for something else; by
                default the usual ones.
            worlds: what stands around the vehicle, which faces +x in its origin, at each spot.
            wetness: of the ground, in [0, 1].
        """
        self.vehicle = vehicle
        self.ground_albedo = np.asarray(ground_albedo, dtype=np.float64)
        self._demand = demand or Demand()
        self._usual: dict[str, Model] = {"samples": samples, "interreflection": bounces}
        self.exposure = exposure
        everything = replace(vehicle, parts=(*vehicle.parts, *props))
        world = worlds(Spot()) if worlds else None
        self._amounts = amounts(Contents(everything, world, wetness))

        self.texture_size = texture_size
        # What will most likely be asked for: kernels go on holding code of what was built before.
        best: dict[str, Model] = {
            "materials": "coat" if self._amounts["materials"] else "principled",
            "glass": "pane" if self._amounts["glass"] else "dark",
            "wetness": "film" if wetness > 0 else "dry",
            **self._demand.forced,
        }
        self.built = BuiltScene(
            vehicle,
            ground_albedo=self.ground_albedo,
            texture_size=texture_size,
            props=props,
            worlds=worlds,
            worn=(str(best["materials"]), str(best["glass"]), str(best["wetness"])),
            wetness=wetness,
        )

    @property
    def geometry(self) -> Geometry:
        """The vehicle on bare ground, in the materials that it wears now."""
        return self.built.geometry

    @property
    def worlds(self) -> Worlds | None:
        """What stands around it; None where it stands alone."""
        return self.built.worlds

    def render(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        weather: Weather,
        *,
        seed: int,
        demand: Demand | None = None,
    ) -> LinearImages:
        """As :class:`cnca.effects.protocols.PlanningRenderer` has it.

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
        portion: Portion = WHOLE,
        demand: Demand | None = None,
        first: int = 0,
    ) -> Float[torch.Tensor, "pixels 3"]:
        """Like :meth:`render`, but only these pixels, counted over views, rows and columns.

        Args:
            samples: rays per pixel in place of those that the plan takes.
            portion: which part of a world's pictures to render, such as the vehicle alone.
            first: with which of each pixel's evenly spread samples to begin: what goes on where
                another call with the same seed ended is as even as one call of both.
        """
        chosen = self.plan(albedo, views, weather, samples=samples, demand=demand)
        return self._expose(albedo, views, chosen, pixels, seed, portion, first)

    def _expose(
        self,
        albedo: LinearTexture,
        views: Sequence[View],
        chosen: EffectPlan,
        pixels: Int[np.ndarray, " pixels"] | None,
        seed: int,
        portion: Portion = WHOLE,
        first: int = 0,
    ) -> Float[torch.Tensor, "*film 3"]:
        if chosen["gradient"] == "off":
            albedo = LinearTexture(albedo.detach())
        shots = self.shots(chosen, views, pixels, seed=seed, portion=portion, begin=first)
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
        begin: int = 0,
    ) -> list[Shot]:
        """The parts that a picture of these views, or of these pixels of them, is rendered in."""
        rung, shares = portion.rung, portion.shares
        if portion.vehicle_only:
            rung = str(chosen.demand.forced.get("surroundings", rung))
        if rung == GEOMETRY:  # where what hides the vehicle is traced
            shares = None
        geometry, around, white = self.built.lit(chosen, views, rung)
        cameras = self._cameras(views, pixels)
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
                first=begin + first,
                vehicle_only=portion.vehicle_only,
                shares=shares,
            )
            for first in range(0, chosen.samples, at_once)
        ]

    def layers(self, views: Sequence[View]) -> Layers:
        """What each view's camera hits first; independent of texture and weather."""
        return first_hits(self.built.traced(views), self._cameras(views))

    def vehicle_mask(self, views: Sequence[View]) -> Float[np.ndarray, "views height width"]:
        """Share of each pixel that the vehicle covers, in [0, 1]."""
        return vehicle_mask(self.built.traced(views), self._cameras(views))

    def sightings(self, views: Sequence[View]) -> list[list[Sighting]]:
        """Everything else with a label that each view shows."""
        objects = self.built.objects(views)
        if objects is None:
            return [[] for _ in views]
        return objects.look(self.built.traced(views), self._cameras(views))

    def visible_shares(self, views: Sequence[View]) -> list[float]:
        """Share of the vehicle in each picture that nothing of the world hides, in [0, 1].

        0 where the vehicle is not in the picture at all.
        """
        cameras = self._cameras(views)
        seen = vehicle_mask(self.built.traced(views), cameras).sum(axis=(1, 2))
        whole = vehicle_mask(self.geometry, cameras).sum(axis=(1, 2))
        return (seen / np.maximum(whole, 1e-9)).clip(0, 1).tolist()

    def visible_pixels(
        self, view: View, pixels: Int[np.ndarray, " pixels"]
    ) -> Float[np.ndarray, " pixels"]:
        """Of what the vehicle covers of each pixel, the share that nothing hides."""
        cameras = self._cameras([view], pixels)
        seen = vehicle_mask(self.built.traced([view]), cameras, VISIBLE_SAMPLES)
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
        subject = Subject.of_views(
            [self.geometry.local(view) for view in views],
            weather,
            ground=float(self.ground_albedo.mean()),
            paint=float(albedo.detach().mean().clamp(0, 1)),
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
