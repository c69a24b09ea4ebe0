"""How often a pattern repeats over the vehicle's texture, so that it is as large as asked for."""

from __future__ import annotations

from cnca.attack.variables import origin
from cnca.core.errors import RunError
from cnca.gen.period import period
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.jobs.attack.request import Request
from cnca.scene.protocols import TextureGenerator
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.texels import map_texels

TEXELS = 128
"""Per side, on which the vehicle's panels are measured."""


def at_size(request: Request, generator: TextureGenerator, vehicle: Vehicle) -> TextureGenerator:
    """The generator whose marks come every ``request.pattern_size`` metres on the vehicle.

    The unattacked texture tells how far they are apart before.  The number of repeats is whole, so
    that the size is met to within a factor of √2, and better where they are many; it holds on
    the vehicle's typical panel, and on all of them where its texture has one scale.

    Raises RunError where the generator does not repeat.
    """
    if request.pattern_size is None:
        return generator
    if not isinstance(generator, DiffusionTextureGenerator):
        raise RunError("--pattern-size: this generator does not repeat; leave it out")
    settings = request.settings
    texture = origin(generator, settings).texture(generator, settings.prompt, settings.seed)
    side = map_texels(vehicle, TEXELS).texel_length * TEXELS
    metres = period(texture) / texture.shape[-1] * side
    return generator.repeating(max(1, round(metres / request.pattern_size)))
