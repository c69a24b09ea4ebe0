"""The textures of an evaluation: the user's candidates and what they must prove themselves against.

=================  ==============================================================================
``normal``         the vehicle's own paint
``uniform``        one random color, another in each weather
``random``         random blocks, others in each weather
``prompt``         a texture of the prompt with F_adv = 0
``NAME prompt``    the same, from the folder of the ``cnca optimize`` that found ``NAME``
``NAME shuffled``  the candidate cut into blocks and shuffled, anew in each weather: its palette
``NAME mirrored``  the candidate flipped left to right
``NAME mean``      the one color that is its mean
=================  ==============================================================================
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch

from cnca.core.errors import TextureError
from cnca.core.images import SrgbArray, read_texture_srgb
from cnca.core.types import LinearTexture, SrgbTexture
from cnca.judge.rows import CONTROLS, NORMAL, RESERVED
from cnca.scene import controls
from cnca.scene.paint import Paint
from cnca.vehicle.model import Vehicle
from cnca.vehicle.uv.texels import draw_faces, map_texels, project_pattern

BLOCKS = 16
"""Squares per side of a shuffled texture."""
Coat = Callable[[int], LinearTexture]
"""The albedo of a texture in the weather of this index."""


@dataclass(frozen=True)
class Candidate:
    """One ``--texture [NAME=]PATH[@SIDEm]``.

    ``PATH`` is a UV picture, the folder of a ``cnca optimize``, or ``.npy`` colors for each face;
    with ``SIDE`` it is a square pattern that repeats every so many metres.
    """

    name: str
    path: Path
    side: float | None = None

    @property
    def picture(self) -> Path:
        """The file of the texture itself."""
        return self.path / "texture.png" if self.path.is_dir() else self.path

    @property
    def prompt_picture(self) -> Path | None:
        """The texture of the same prompt with F_adv = 0, where a run's folder has one."""
        picture = self.path / "texture_prompt.png"
        return picture if picture.is_file() else None


def named(spec: str) -> tuple[str | None, str]:
    """``NAME=VALUE`` as a pair; None stands for a name that is not given."""
    name, sign, value = spec.partition("=")
    return (name, value) if sign and not re.search(r"[\\/]", name) else (None, spec)


def parse_candidates(specs: Sequence[str]) -> list[Candidate]:
    """Read the texture options.

    Raises TextureError for a name that is taken, reserved or hard to write.
    """
    candidates: list[Candidate] = []
    for spec in specs:
        given, rest = named(spec)
        match = re.fullmatch(r"(.+)@(\d*\.?\d+)m", rest)
        path, side = (match[1], float(match[2])) if match else (rest, None)
        name = given if given is not None else Path(path).stem
        if not re.fullmatch(r"[\w.+-]+", name):
            raise TextureError(f"--texture {spec}: give it a name of letters and digits: NAME=PATH")
        if name in RESERVED or name in [candidate.name for candidate in candidates]:
            raise TextureError(f"--texture {spec}: the name '{name}' is taken; write NAME=PATH")
        candidates.append(Candidate(name, Path(path), side))
    return candidates


def read_candidate(candidate: Candidate, vehicle: Vehicle, size: int) -> SrgbTexture:
    """The UV texture of the vehicle, (3, height, width) in [0, 1].

    Patterns and colors of faces are drawn at ``size`` texels per side.  Raises TextureError, which
    names the file, where it cannot be used.
    """
    path = candidate.picture
    if path.suffix.lower() != ".npy":
        picture = read_texture_srgb(path)
        if candidate.side is None:
            return _as_texture(picture)
    try:
        if path.suffix.lower() == ".npy":
            return _as_texture(draw_faces(map_texels(vehicle, size), _read_array(path)))
        assert candidate.side is not None
        return _as_texture(project_pattern(map_texels(vehicle, size), picture, candidate.side))
    except TextureError as error:
        raise TextureError(f"{path}: {error}") from None


def make_coats(
    paint: Paint,
    textures: Mapping[str, SrgbTexture],
    prompts: Mapping[str, SrgbTexture],
    *,
    wanted: Collection[str] = CONTROLS,
    seed: int,
) -> dict[str, Coat]:
    """Name → coat: the normal paint, the ``wanted`` controls, the candidates.

    ``textures`` are the candidates by name, ``prompts`` the textures with F_adv = 0 by row name.
    """
    size = paint.base.shape[-1]

    def drawn(name: str, draw: Callable[[torch.Generator], SrgbTexture]) -> Coat:
        return lambda weather: paint.apply(draw(_chance(seed, name, weather)))

    def fixed(texture: SrgbTexture | None) -> Coat:
        albedo = paint.apply(texture)
        return lambda _weather: albedo

    coats = {NORMAL: fixed(None)}
    if "uniform" in wanted:
        coats["uniform"] = drawn("uniform", lambda chance: controls.uniform(size, chance))
    if "random" in wanted:
        coats["random"] = drawn("random", lambda chance: controls.random_blocks(size, chance))
    if "prompt" in wanted:
        coats |= {name: fixed(texture) for name, texture in prompts.items()}
    for name, texture in textures.items():
        on_car = paint.resize(texture)
        if "shuffled" in wanted:
            cut = partial(controls.shuffled, on_car, blocks=min(BLOCKS, size), mask=paint.mask)
            coats[f"{name} shuffled"] = drawn("shuffled", cut)
        if "mirrored" in wanted:
            flip = partial(controls.mirrored, on_car, mask=paint.mask)
            coats[f"{name} mirrored"] = drawn("mirrored", flip)
        if "mean" in wanted:
            coats[f"{name} mean"] = fixed(controls.mean_color(on_car, paint.mask))
        coats[name] = fixed(texture)
    return coats


def controls_of(candidate: str, coats: Sequence[str], candidates: Sequence[str]) -> list[str]:
    """The rows that this candidate is compared with: the common ones and its own."""
    return [
        name for name in coats if name not in candidates and name.split(" ")[0] in (name, candidate)
    ]


def _chance(seed: int, name: str, weather: int) -> torch.Generator:
    """Randomness of a control that does not depend on which others there are."""
    entropy = np.random.SeedSequence([seed, zlib.crc32(name.encode()), weather])
    return torch.Generator().manual_seed(int(entropy.generate_state(1)[0]))


def _read_array(path: Path) -> np.ndarray:
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        reason = " ".join(str(error).split())
        raise TextureError(f"cannot be read as .npy ({reason})") from None


def _as_texture(picture: SrgbArray) -> SrgbTexture:
    return SrgbTexture(torch.from_numpy(picture).permute(2, 0, 1).float().contiguous())
