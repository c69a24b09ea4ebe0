"""The vehicle's paint as the page asks for it: a file, a run's, or what a prompt gives."""

from __future__ import annotations

from pathlib import Path

import torch

from cnca.attack.settings import Settings
from cnca.attack.variables import origin
from cnca.core.types import SrgbTexture
from cnca.jobs.attack.pattern import at_size
from cnca.jobs.attack.presets import under_preset
from cnca.jobs.attack.request import Request
from cnca.jobs.attack.run import build_generator
from cnca.judge.candidates import Candidate, read_candidate
from cnca.scene.protocols import TextureGenerator
from cnca.vehicle.model import Vehicle


class Painter:
    """Paints by file or by prompt; the shipped generator is loaded with the first prompt."""

    def __init__(self) -> None:
        self._generator: TextureGenerator | None = None

    @torch.no_grad()
    def texture(
        self, vehicle: Vehicle, size: int, *, file: str, prompt: str, seed: int = 0
    ) -> SrgbTexture | None:
        """The UV texture (3, height, width) in [0, 1]; None stands for the scene's own paint.

        A prompt's is what ``cnca optimize`` starts from with its usual preset.

        Raises:
            TextureError, GeneratorError: the file or the prompt cannot be used.
        """
        if file:
            return read_candidate(Candidate("texture", Path(file)), vehicle, size)
        if not prompt:
            return None
        request = under_preset(Request(Path(), Path(), Settings(prompt, seed=seed)))
        if self._generator is None:
            self._generator = build_generator(request)
        generator = at_size(request, self._generator, vehicle)
        return origin(generator, request.settings).texture(generator, prompt, seed)
