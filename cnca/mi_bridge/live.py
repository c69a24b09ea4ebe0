"""Pictures that keep up with a hand: one ray per pixel at a time, from recorded kernels.

Most of a small picture's time goes into tracing Python into kernels that are there already.  So a
draw is recorded once (``dr.freeze``), and what changes from one to the next is handed to it: the
camera, the number of the sample, the texture, the numbers of sun, sky and fog.  What it draws is
what :class:`cnca.mi_bridge.renderer.MitsubaRenderer` renders, to the last bit.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from cnca.core.errors import NonFiniteError
from cnca.core.types import LinearTexture
from cnca.effects.plan import EffectPlan
from cnca.mi_bridge.bridge import PART_SEED, Shot
from cnca.mi_bridge.geometry import Geometry
from cnca.mi_bridge.integrator import trace
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import dr, mi
from cnca.scene.cameras import View

RECORDINGS = 8
"""Recordings of different plans and picture sizes that are kept for one geometry."""
MOST_FAILURES = 2
"""Attempts to record a draw, after which it is traced anew each time."""

TRAVERSED = (mi.Object, mi.Texture1f, mi.Texture2f, mi.Texture3f)
"""Those of Mitsuba's types that Dr.Jit searches for arrays."""
Constants = tuple[object, ...]


class LiveCamera:
    """Draws the scene of one renderer, one evenly spread sample per pixel at a time."""

    def __init__(self, renderer: MitsubaRenderer) -> None:
        self.renderer = renderer
        self._geometry: Geometry | None = None
        self._bound: LinearTexture | None = None
        self._recordings: dict[Constants, _Recording] = {}

    def draw(
        self, chosen: EffectPlan, albedo: LinearTexture, view: View, *, seed: int, first: int
    ) -> Float[np.ndarray, "height width 3"]:
        """The exposed linear radiance that sample number ``first`` of each pixel finds.

        The mean over ``first`` = 0, 1, … is the picture: its samples are spread evenly.

        Args:
            chosen: how to render; its own number of samples means nothing here.
            albedo: of the renderer's texture size, in [0, 1].

        Raises:
            NonFiniteError: the picture holds NaN or infinity.
        """
        chosen = replace(chosen, models={**chosen.models, "samples": 1})
        with dr.suspend_grad(), torch.no_grad():
            shot = self.renderer.shots(chosen, [view], None, seed=seed)[0]
            self._bind(shot.geometry, albedo)
            arrays, constants = kernel_inputs(shot.surroundings)
            size = view.width, view.height
            recording = self._recording((size, chosen.bounces, *constants))
            image = recording.draw(shot, arrays, seed=seed, first=first)
        picture = image.reshape(view.height, view.width, 3)
        if not np.isfinite(picture).all():
            raise NonFiniteError(
                f"view {view.name}, seed {seed}, sample {first}: the picture is not finite; please "
                "report the scene"
            )
        return picture

    def _bind(self, geometry: Geometry, albedo: LinearTexture) -> None:
        if self._geometry is not geometry:
            self._recordings.clear()  # they hold the other geometry
            self._geometry, self._bound = geometry, None
        if self._bound is not albedo:
            texels = geometry.texture_size
            texture = albedo.detach().expand(3, texels, texels).permute(1, 2, 0)
            geometry.bind(mi.TensorXf(np.ascontiguousarray(texture, dtype=np.float32)))
            self._bound = albedo

    def _recording(self, key: Constants) -> _Recording:
        if key not in self._recordings:
            if len(self._recordings) >= RECORDINGS:
                self._recordings.pop(next(iter(self._recordings)))
            self._recordings[key] = _Recording()
        return self._recordings[key]


class _Recording:
    """One draw for one geometry, and for all light that its kernel can read."""

    def __init__(self) -> None:
        self._failures = 0
        self._shot: Shot | None = None
        self._recorded = dr.freeze(_drawing(self))

    @property
    def recordings(self) -> int:
        """How often the draw was recorded."""
        return self._recorded.n_recordings

    @property
    def shot(self) -> Shot:
        """What is drawn: Dr.Jit may record anew at any time, and must find the present light."""
        assert self._shot is not None
        return self._shot

    def draw(self, shot: Shot, arrays: list[Any], *, seed: int, first: int) -> np.ndarray:
        self._shot = shot
        part_seed = seed + PART_SEED * first & 0xFFFFFFFF
        numbers = [dr.opaque(mi.UInt32, n) for n in (seed & 0xFFFFFFFF, part_seed, first)]
        given = shot.cameras.frames, *numbers, shot.exposure, shot.geometry.scene, arrays
        # The tables of a measured sky cannot be handed over.
        if self._failures < MOST_FAILURES and shot.surroundings.sky.measured is None:
            try:
                with _no_collection():
                    return np.array(self._recorded(*given))
            except RuntimeError:  # lamps and wet ground: calls within calls are not recorded
                self._failures += 1
        return np.array(_drawing(self)(*given))


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep NumPy arrays: freeing one while Dr.Jit records ends the process."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _drawing(recording: _Recording) -> Callable[..., mi.Float]:
    """:meth:`Shot.primal` as a function of all that changes; one sample per pixel."""

    def draw(
        frames: mi.Float,
        seed: mi.UInt32,
        part_seed: mi.UInt32,
        first: mi.UInt32,
        exposure: mi.Float,
        scene: mi.Scene,
        _arrays: list[Any],
    ) -> mi.Float:
        shot = recording.shot
        lens = copy(shot.cameras)
        lens.frames = frames
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(part_seed, lens.lanes(1))
        ray, first_reflection = lens.rays(1, seed, first)
        radiance, _ = trace(
            scene, shot.surroundings, sampler, ray, first_reflection, bounces=shot.bounces
        )
        radiance *= exposure
        dr.eval(radiance)
        return dr.ravel(radiance)

    return draw


@dataclass
class _Found:
    arrays: list[Any]
    constants: list[object]


def kernel_inputs(surroundings: object) -> tuple[list[Any], Constants]:
    """What a kernel reads of sun, sky and fog, and the constants that are part of its code."""
    found, seen = _Found([], []), set[int]()
    for value in _inside(surroundings, seen):
        if isinstance(value, bool | int | float | str | None):
            found.constants.append(value)
        else:
            found.arrays.append(value)
    return found.arrays, (*found.constants, *(type(array) for array in found.arrays))


def _inside(value: Any, seen: set[int]) -> Iterator[Any]:
    """Constants, arrays, textures and scenes of a value, each object once."""
    if isinstance(value, bool | int | float | str | None):
        yield value
        return
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, Geometry):
        yield value.scene
        yield from value.kernel_tables
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _inside(item, seen)
    elif dr.is_array_v(value) or isinstance(value, TRAVERSED):
        yield value
    elif type(value).__module__.startswith("cnca.mi_bridge"):
        for inner in vars(value).values():
            yield from _inside(inner, seen)
