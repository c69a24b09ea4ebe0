"""Loading a Stable Diffusion pipeline folder, the shipped one or v1.5, without running its code."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from torch import nn
from transformers import CLIPTextModel, CLIPTokenizer
from transformers.utils.logging import disable_progress_bar

from cnca.core.errors import GeneratorError

SHIPPED = Path(__file__).parents[1] / "assets" / "generator"
"""The small generator that comes with CNCA; see the model card in that folder."""

ARCHITECTURE = "StableDiffusionPipeline"
WEIGHTS = ("diffusion_pytorch_model.safetensors", "model.safetensors")
SHARDS = ("diffusion_pytorch_model-", "model-")
"""How the names of weights in several files begin."""
PARTS = {
    "vae": "AutoencoderKL",
    "unet": "UNet2DConditionModel",
    "text_encoder": "CLIPTextModel",
    "tokenizer": "CLIPTokenizer",
}
"""Folders that must be there and the class that ``model_index.json`` must name for each."""


@dataclass(frozen=True)
class Pipeline:
    """The frozen parts of a text-to-image diffusion model, and DDIM with its noise schedule."""

    vae: AutoencoderKL
    unet: UNet2DConditionModel
    text_encoder: CLIPTextModel
    tokenizer: CLIPTokenizer
    scheduler: DDIMScheduler

    def __post_init__(self) -> None:
        for part in (self.vae, self.unet, self.text_encoder):
            freeze(part)


def freeze(part: nn.Module) -> None:
    """Evaluation mode, no gradient to the weights."""
    part.eval().requires_grad_(False)


def load_pipeline(
    folder: Path, *, device: torch.device | str = "cpu", dtype: torch.dtype = torch.float32
) -> Pipeline:
    """Load the safetensors weights in ``folder``; its scheduler's betas are used with DDIM.

    Raises :class:`GeneratorError` where the folder is missing, is no Stable Diffusion pipeline,
    or cannot be read, or where torch has no such device.
    """
    _check_index(folder)
    _check_device(device)
    disable_progress_bar()  # a second's work, and errors are to be one line
    options = {"use_safetensors": True, "local_files_only": True}
    vae, unet, text = (
        options | {"variant": _variant(folder / part)} for part in ("vae", "unet", "text_encoder")
    )
    try:
        return Pipeline(
            vae=AutoencoderKL.from_pretrained(folder / "vae", torch_dtype=dtype, **vae).to(device),
            unet=UNet2DConditionModel.from_pretrained(
                folder / "unet", torch_dtype=dtype, **unet
            ).to(device),
            text_encoder=CLIPTextModel.from_pretrained(
                folder / "text_encoder", dtype=dtype, **text
            ).to(device),
            tokenizer=CLIPTokenizer.from_pretrained(folder / "tokenizer", local_files_only=True),
            scheduler=DDIMScheduler.from_pretrained(folder / "scheduler", local_files_only=True),
        )
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        reason = str(error).strip().splitlines()[0]
        raise GeneratorError(
            f"{folder}: cannot load the pipeline ({reason}); copy the folder anew, "
            "with safetensors weights"
        ) from error


def _variant(part: Path) -> str | None:
    """What stands before ``.safetensors``, such as fp16, where there are no weights without it."""
    names = sorted(path.name for path in part.glob("*.safetensors"))
    if any(name in WEIGHTS or name.startswith(SHARDS) for name in names):
        return None
    return next((name.split(".")[1] for name in names if name.count(".") == 2), None)


def _check_device(device: torch.device | str) -> None:
    try:
        torch.empty(0, device=device)
    except (AssertionError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise GeneratorError(f"device '{device}': cannot be used ({reason}); take cpu") from error


def _check_index(folder: Path) -> None:
    """Compare ``model_index.json`` with the architecture that the sampler is written for."""
    index_file = folder / "model_index.json"
    advice = "give the folder of a Stable Diffusion v1 pipeline saved by diffusers"
    if not folder.is_dir():
        raise GeneratorError(f"{folder}: no such folder; {advice}")
    if not index_file.is_file():
        raise GeneratorError(f"{folder}: no model_index.json in this folder; {advice}")
    try:
        index = json.loads(index_file.read_text(encoding="utf-8"))
        name, parts = index["_class_name"], {part: index.get(part) for part in PARTS}
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise GeneratorError(f"{index_file}: not a diffusers index; {advice}") from error
    if name != ARCHITECTURE:
        raise GeneratorError(f"{index_file}: _class_name is {name}, not {ARCHITECTURE}; {advice}")
    for part, expected in PARTS.items():
        if not isinstance(parts[part], list) or parts[part][-1] != expected:
            raise GeneratorError(f"{index_file}: {part} is {parts[part]}, not {expected}; {advice}")
