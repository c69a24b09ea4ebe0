"""Texture in, images out, for torch: ``dr.wrap`` around one custom Dr.Jit operation.

The operation binds its own texture and weather, both when it renders and when it differentiates.
So two renders may share one backward pass, the scene may show something else in between, and
renders without gradient disturb nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float
from torch import Tensor

from cnca.mi_bridge.geometry import ALBEDO_FLOOR, Geometry
from cnca.mi_bridge.integrator import Reflection, trace
from cnca.mi_bridge.panes import sees_vehicle
from cnca.mi_bridge.rays import Cameras, average_samples
from cnca.mi_bridge.surroundings import Surroundings
from cnca.mi_bridge.variant import dr, mi

BACKWARD_SEED = 0x9E3779B9
"""Added to the seed for the adjoint pass: independent noise keeps products of both unbiased."""

PART_SEED = 0x85EBCA6B
"""Added to the seed as many times as samples come before those of a part of a picture."""


class Shot:
    """All that one render needs besides the texture."""

    def __init__(
        self,
        geometry: Geometry,
        surroundings: Surroundings,
        cameras: Cameras,
        *,
        samples: int,
        bounces: int,
        seed: int,
        exposure: float,
        first: int = 0,
        vehicle_only: bool = False,
        shares: Float[np.ndarray, " pixels"] | None = None,
    ) -> None:
        """
        Args:
            first: with which of a pixel's evenly spread samples this part of them begins.
            vehicle_only: leaves everything else that cameras see dark.
            shares: factors on the light of each pixel, such as the share of it that nothing hides.
        """
        self.geometry = geometry
        self.surroundings = surroundings
        self.cameras = cameras
        self.samples = samples
        self.bounces = bounces
        self.seed = seed
        self.first = first
        self.vehicle_only = vehicle_only
        self.exposure = dr.opaque(mi.Float, exposure)  # another value needs no other kernel
        self._shares = None if shares is None else mi.Float(np.float32(shares))

    def start(self, seed: int) -> tuple[mi.Sampler, mi.Ray3f, list[mi.Float]]:
        """A freshly seeded sampler, the camera rays and their first reflection's random numbers."""
        opaque_seed = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
        part_seed = dr.opaque(mi.UInt32, seed + PART_SEED * self.first & 0xFFFFFFFF)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(part_seed, self.cameras.lanes(self.samples))
        return sampler, *self.cameras.rays(self.samples, opaque_seed, self.first)

    def weights(self) -> mi.Float:
        """Exposure of every lane, times the share of its pixel that is not hidden."""
        if self._shares is None:
            return self.exposure
        lane = dr.arange(mi.UInt32, self.cameras.lanes(self.samples))
        return self.exposure * dr.gather(mi.Float, self._shares, lane // self.samples)

    def lanes(self, ray: mi.Ray3f) -> mi.Bool | None:
        """Which camera rays are followed; None is all."""
        return sees_vehicle(self.geometry, ray) if self.vehicle_only else None

    def _walk(
        self, seed: int, *, differentiable: bool = False
    ) -> tuple[mi.Color3f, list[Reflection]]:
        """Radiance of every lane and its reflections, as :func:`trace` returns them."""
        sampler, ray, first_reflection = self.start(seed)
        # The path's own first hit says whether to follow it, but holes take a ray of their own.
        by_ray = self.vehicle_only and self.geometry.has_holes
        by_hit = self.vehicle_only and not by_ray
        return trace(
            self.geometry.scene,
            self.surroundings,
            sampler,
            ray,
            first_reflection,
            bounces=self.bounces,
            differentiable=differentiable,
            lanes=self.lanes(ray) if by_ray else None,
            starts=self.geometry.is_vehicle if by_hit else None,
        )

    def primal(self, seed: int) -> mi.Color3f:
        """Exposed radiance of every lane."""
        radiance, _ = self._walk(seed)
        return radiance * self.weights()

    def adjoint(self, seed: int, albedo: mi.TensorXf, image_gradient: mi.TensorXf) -> mi.TensorXf:
        """The bound texture's gradient for the given gradient of the exposed image."""
        unit = self.geometry.bind(albedo, differentiable=True)
        dr.forward_from(unit, flags=dr.ADFlag.ClearEdges)
        with dr.suspend_grad():  # the integrator resumes it where the texture is looked up
            L, reflections = self._walk(seed, differentiable=True)
            pixel = dr.arange(mi.UInt32, self.cameras.lanes(self.samples)) // self.samples
            δL = dr.gather(mi.Color3f, image_gradient.array, pixel)
            δL *= self.weights() / self.samples
        bound = self.geometry.bind(albedo, differentiable=True)
        total = mi.Color3f(0)
        for kept in reflections:
            δρ = δL * kept.slope(L)
            total += δρ * self.geometry.paint(kept.uv, dr.any(δρ != 0))
        dr.backward_from(total)
        return dr.grad(bound)


class _Render(dr.CustomOp):
    """(texture, shots) → exposed image of the cameras' film shape and 3 colors.

    The parts of a picture are taken one after the other, and only their sum is kept.
    """

    def eval(self, albedo: mi.TensorXf, shots: Sequence[Shot]) -> mi.TensorXf:
        self.albedo, self.shots, first = dr.detach(albedo), shots, shots[0]
        image = mi.Float(0)
        with dr.suspend_grad():
            first.geometry.bind(self.albedo)
            for shot, share in self._parts():
                radiance = shot.primal(shot.seed)
                dr.eval(radiance)  # once, not once for each color that is averaged below
                pixels = [average_samples(channel, shot.samples) for channel in radiance]
                image += dr.ravel(mi.Color3f(*pixels)) * share
                dr.eval(image)
        return mi.TensorXf(image, shape=(*first.cameras.film_shape, 3))

    def backward(self) -> None:
        geometry, gradient = self.shots[0].geometry, mi.TensorXf(0)
        image_gradient = self.grad_out()
        for shot, share in self._parts():
            seed = shot.seed + BACKWARD_SEED
            gradient += shot.adjoint(seed, self.albedo, image_gradient * share)
            dr.eval(gradient)
        self.set_grad_in("albedo", gradient * (1 - ALBEDO_FLOOR))
        geometry.bind(self.albedo)  # leave no derivatives behind

    def _parts(self) -> Iterator[tuple[Shot, float]]:
        """Each part, and the share of all samples that it has."""
        samples = sum(shot.samples for shot in self.shots)
        return ((shot, shot.samples / samples) for shot in self.shots)

    def forward(self) -> None:
        raise NotImplementedError("the texture's gradient is computed in reverse mode only")

    def name(self) -> str:
        return "cnca.render"


def render(albedo: Float[Tensor, "size size 3"], shots: Sequence[Shot]) -> Float[Tensor, "*film 3"]:
    """Exposed linear images of ``albedo`` (linear, [0, 1], row 0 at v = 1); differentiable.

    ``shots`` are the parts of the same pictures, each with some of the samples.
    """

    @dr.wrap(source="torch", target="drjit")
    def call(albedo: mi.TensorXf) -> mi.TensorXf:
        return dr.custom(_Render, albedo, shots)

    # dr.wrap refuses parameters and half precision in backward: give it a plain float32 tensor.
    wrapped: Callable[[Tensor], Tensor] = call
    return wrapped(albedo.float().contiguous().clone())
