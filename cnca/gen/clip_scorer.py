"""Prompt scores from a CLIP model in a local folder (Radford et al. 2021)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor
from transformers import CLIPModel, CLIPTokenizer

from cnca.core.errors import GeneratorError
from cnca.core.types import SrgbImages
from cnca.gen.scorer import Cosines

MEAN, DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Of the pixels that CLIP was trained on, per channel, where the folder does not say otherwise."""


class ClipScorer:
    """Cosines of CLIP's projected features (implements ``PromptScorer``)."""

    def __init__(
        self,
        model: CLIPModel,
        tokenizer: CLIPTokenizer,
        mean: Sequence[float] = MEAN,
        deviation: Sequence[float] = DEVIATION,
    ) -> None:
        self._model = model.eval().requires_grad_(False)
        self._tokenizer = tokenizer
        self._mean, self._deviation = (
            torch.tensor(values).view(3, 1, 1) for values in (mean, deviation)
        )

    @classmethod
    def load(cls, folder: Path) -> ClipScorer:
        """Load model, tokenizer and the pictures' normalisation, without running code.

        Raises :class:`GeneratorError` where the folder holds no CLIP model.
        """
        options = {"local_files_only": True, "use_safetensors": True}
        try:
            config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
            if config.get("model_type") != "clip":
                raise ValueError(f"config.json: model_type is {config.get('model_type')}, not clip")
            model = CLIPModel.from_pretrained(folder, dtype=torch.float32, **options)
            tokenizer = CLIPTokenizer.from_pretrained(folder, local_files_only=True)
            preprocessing = folder / "preprocessor_config.json"
            values = json.loads(preprocessing.read_text()) if preprocessing.exists() else {}
        except (OSError, ValueError, RuntimeError, KeyError, AttributeError) as error:
            reason = str(error).strip().splitlines()[0]
            raise GeneratorError(
                f"{folder}: no CLIP model ({reason}); give a folder of transformers' CLIPModel"
            ) from error
        return cls(
            model,
            tokenizer,
            values.get("image_mean", MEAN),
            values.get("image_std", DEVIATION),
        )

    def score(self, pictures: SrgbImages, prompts: Sequence[str]) -> Cosines:
        """Return the cosine of every picture with every prompt."""
        seen = self._model.visual_projection(
            self._model.vision_model(self._prepared(pictures)).pooler_output
        )
        tokens = self._tokenizer(list(prompts), padding=True, return_tensors="pt", verbose=False)
        most = self._model.config.text_config.max_position_embeddings
        if tokens.input_ids.shape[1] > most:
            raise GeneratorError(
                f"a prompt has {tokens.input_ids.shape[1]} tokens, the scorer reads {most}; "
                "shorten it"
            )
        read = self._model.text_projection(self._model.text_model(**tokens).pooler_output)
        return F.normalize(seen, dim=1) @ F.normalize(read, dim=1).T

    def _prepared(self, pictures: SrgbImages) -> Tensor:
        side = self._model.config.vision_config.image_size
        sized = F.interpolate(pictures, (side, side), mode="bicubic", antialias=True)
        return (sized.clamp(0, 1) - self._mean) / self._deviation
