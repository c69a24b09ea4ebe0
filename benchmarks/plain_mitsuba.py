"""The same step as a user of Mitsuba would write it, without anything of ours but the scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from cnca.mi_bridge.variant import dr, mi
from cnca.mi_bridge.volpath import BUBBLE, in_fog, lit_by_mitsuba
from cnca.scene.cameras import View

if TYPE_CHECKING:
    from peers import Bench

FOG_DEPTH = 64
"""Longest path in fog; half of it is visibly too dark."""


class _Plain:
    """A Mitsuba scene whose paint is a bitmap texture."""

    def __init__(self, bench: Bench, integrator: dict[str, Any]) -> None:
        self.bench, self.integrator = bench, mi.load_dict(integrator)
        renderer, weather = bench.renderer, bench.weather
        plan = renderer.plan(bench.albedo, bench.views, weather)
        shot = renderer.shots(plan, bench.views, None, seed=0)[0]
        self.exposure = float(shot.exposure[0])
        self.views = [renderer.geometry.local(view) for view in bench.views]
        light = shot.surroundings.sky.light
        if weather.fog is None:
            self.scene, self.medium = lit_by_mitsuba(renderer.geometry.scene, light), None
        else:
            foggy, self.medium = in_fog(renderer.geometry.scene, light, weather.fog)
            self.scene = self._with_bubbles(foggy)
        self.params = mi.traverse(self.scene)
        (self.key,) = (k for k in self.params.keys() if k.endswith("base_color.data"))  # noqa: SIM118

    def _with_bubbles(self, foggy: mi.Scene) -> mi.Scene:
        """``prbvolpath`` starts every path in clear air; outside of a small ball is the fog."""
        parts = {f"shape_{i}": shape for i, shape in enumerate(foggy.shapes())}
        parts |= {f"light_{i}": light for i, light in enumerate(foggy.emitters())}
        for i, view in enumerate(self.views):
            parts[f"bubble_{i}"] = {
                "type": "sphere",
                "center": list(view.origin),
                "radius": BUBBLE,
                "bsdf": {"type": "null"},
                "exterior": self.medium,
            }
        return mi.load_dict({"type": "scene", **parts})

    def picture(self, texture: Tensor, sensor: mi.Sensor, seed: int) -> Tensor:
        """Linear radiance (height, width, 3), differentiable in the texture (size, size, 3)."""

        @dr.wrap(source="torch", target="drjit")
        def render(texture: mi.TensorXf) -> mi.TensorXf:
            self.params[self.key] = texture
            self.params.update()
            return mi.render(
                self.scene,
                self.params,
                sensor=sensor,
                integrator=self.integrator,
                spp=self.bench.samples,
                seed=seed,
            )

        image: Tensor = render(texture)
        return image

    def texture(self) -> tuple[Tensor, Tensor]:
        """The leaf (3, size, size), and what the renderer takes (size, size, 3)."""
        albedo = self.bench.albedo.clone().requires_grad_()
        return albedo, albedo.permute(1, 2, 0).contiguous()


class BatchAD(_Plain):
    """All views in one picture, differentiated step by step of the path."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench, {"type": "path", "max_depth": 12})
        width = sum(view.width for view in bench.views)
        sensors = {f"view_{i}": sensor(view) for i, view in enumerate(self.views)}
        film = _film(width, bench.views[0].height)
        self.sensor = mi.load_dict({"type": "batch", **sensors, "film": film})

    def step(self, seed: int) -> Tensor:
        """Gradient of the texture."""
        albedo, texture = self.texture()
        image = self.picture(texture, self.sensor, seed) * self.exposure
        adjoint = torch.cat(list(self.bench.adjoint.permute(0, 2, 3, 1)), dim=1)
        (image * adjoint).sum().backward()
        assert albedo.grad is not None
        return albedo.grad


class Script(_Plain):
    """One view after the other, by path replay."""

    def __init__(self, bench: Bench) -> None:
        kind = {"type": "prb", "max_depth": 12}
        if bench.weather.fog is not None:
            kind = {"type": "prbvolpath", "max_depth": FOG_DEPTH}
        super().__init__(bench, kind)
        self.sensors = [mi.load_dict(sensor(view)) for view in self.views]

    def step(self, seed: int) -> Tensor:
        """Gradient of the texture; one backward pass for each view, for a pass forgets others."""
        albedo, texture = self.texture()
        shared = texture.detach().requires_grad_()
        for i, (camera, adjoint) in enumerate(zip(self.sensors, self.bench.adjoint, strict=True)):
            image = self.picture(shared, camera, len(self.sensors) * seed + i) * self.exposure
            (image * adjoint.permute(1, 2, 0)).sum().backward()
        texture.backward(shared.grad)
        assert albedo.grad is not None
        return albedo.grad


def sensor(view: View) -> dict[str, Any]:
    """The view as Mitsuba's pin-hole camera."""
    return {
        "type": "perspective",
        "fov": view.fov,
        "near_clip": BUBBLE / 10,
        "to_world": mi.ScalarTransform4f().look_at(
            origin=list(view.origin), target=list(view.target), up=list(view.up)
        ),
        "film": _film(view.width, view.height),
        "sampler": {"type": "independent"},
    }


def _film(width: int, height: int) -> dict[str, Any]:
    box = {"type": "box"}
    return {"type": "hdrfilm", "width": width, "height": height, "rfilter": box}
