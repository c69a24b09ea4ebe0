"""Text-to-image sampling that is differentiable in the adversarial feature and in the noises.

=====================  ===============================================================
in the code            in the paper (section 3.3, equations 7 and 8) and in DDIM
=====================  ===============================================================
``text_feature``       F_txt = enc(P_txt)
``adversarial_feature``  κ(F_adv), already projected
``generate``           T_adv = T2I([κ(F_adv), F_txt])
``latents``            x_t, Song et al. 2021 (DDIM), equation 12 with η = 0
``noises``             x_T and each step's ε_t, equation 16 with η = 1
``guidance``           w + 1 of Ho & Salimans 2022 (classifier-free guidance), equation 6
=====================  ===============================================================
"""

from __future__ import annotations

from copy import copy
from functools import partial
from pathlib import Path
from typing import Any, final

import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from cnca.core import parallel
from cnca.core.errors import GeneratorError, NonFiniteError
from cnca.core.types import SrgbTexture
from cnca.gen import GUIDANCE
from cnca.gen.choices import CONCAT, REPLACE, check_kind
from cnca.gen.feature import check_finite, default_tokens
from cnca.gen.noise import Noises, noisy_step, standardized
from cnca.gen.pipeline import SHIPPED, Pipeline, load_pipeline
from cnca.gen.repeats import rolled, rolled_back, shift, tiled, wrapped

TextFeature = Float[Tensor, "tokens width"]


@final
class DiffusionTextureGenerator:
    """Paints textures with a frozen diffusion model (implements ``TextureGenerator``).

    ``feature`` says what F_adv does to the text (see :mod:`cnca.gen.feature`), ``tokens`` is its
    number of tokens (by default all that the encoder reads for ``concat``, the last 40 of 77 for
    ``replace``), ``steps`` the number of DDIM steps, ``guidance`` the scale of classifier-free
    guidance (1 switches it off), ``size`` the side in pixels of what is generated (by default the
    model's own); with ``repeats`` above 1 that has no seams, and is repeated as often per side of
    the texture.  Gradients flow through all steps, or through the last ``gradient_steps`` only.
    With ``gradient_checkpointing`` memory holds one step's activations, whatever ``steps`` is;
    without, it holds all of them, and nothing is computed twice: the same gradient in two thirds of
    the time.  ``half`` is the type of the U-Net's products and convolutions (autocast), such as
    bfloat16; weights, latents and the autoencoder stay as they are.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        *,
        feature: str = CONCAT,
        tokens: int | None = None,
        steps: int = 20,
        guidance: float = GUIDANCE,
        size: int | None = None,
        repeats: int = 1,
        gradient_steps: int | None = None,
        gradient_checkpointing: bool = True,
        half: torch.dtype | None = None,
    ) -> None:
        gradient_steps = steps if gradient_steps is None else gradient_steps
        tokens = default_tokens(feature, _length(pipeline)) if tokens is None else tokens
        _require_positive(
            tokens=tokens, steps=steps, gradient_steps=gradient_steps, repeats=repeats
        )
        if gradient_steps > steps:
            raise GeneratorError(f"gradient_steps is {gradient_steps}: there are {steps} steps")
        if tokens > _length(pipeline):
            raise GeneratorError(f"tokens is {tokens}: the encoder reads {_length(pipeline)}")
        self._pipeline = pipeline
        self._replaces = check_kind(feature) == REPLACE
        self._guidance, self._repeats = guidance, repeats
        self._gradient_steps = gradient_steps
        self._gradient_checkpointing = gradient_checkpointing
        self._half = half
        self._latent_shape = _latent_shape(pipeline, size)
        pipeline.scheduler.set_timesteps(steps, device=pipeline.unet.device)
        self.feature_shape = (tokens, pipeline.unet.config.cross_attention_dim)
        self.noise_shape = (1 + steps, *self._latent_shape[1:])
        self._empty_feature = self.encode("")

    @classmethod
    def load(
        cls, path: Path | None = None, *, device: torch.device | str = "cpu", **options: Any
    ) -> DiffusionTextureGenerator:
        """Load a Stable Diffusion folder (the shipped one by default), weights in float32.

        ``options`` are the constructor's.  Raises :class:`GeneratorError` where the folder, the
        device or an option cannot be used.
        """
        return cls(load_pipeline(path or SHIPPED, device=device), **options)

    def repeating(self, repeats: int) -> DiffusionTextureGenerator:
        """The same generator with another number of repeats."""
        _require_positive(repeats=repeats)
        other = copy(self)
        other._repeats = repeats
        return other

    @torch.no_grad()
    def encode(self, prompt: str) -> TextFeature:
        """Return F_txt on the CPU, padded to the encoder's length (77).

        Raises :class:`GeneratorError` for a prompt that is longer.
        """
        tokenizer, encoder = self._pipeline.tokenizer, self._pipeline.text_encoder
        words = tokenizer(prompt, padding="max_length", return_tensors="pt", verbose=False)
        count, most = words.input_ids.shape[1], _length(self._pipeline)
        if count > most:
            raise GeneratorError(
                f"the prompt '{prompt[:30]}…' has {count} tokens, the encoder reads {most}; "
                "shorten it"
            )
        return encoder(words.input_ids.to(encoder.device)).last_hidden_state[0].cpu()

    def generate(
        self,
        text_feature: TextFeature,
        adversarial_feature: Float[Tensor, "extra _"] | None,
        generator: torch.Generator,
        *,
        noises: Noises | None = None,
        together: bool = False,
    ) -> SrgbTexture:
        """Return T2I([F_adv, F_txt]), sRGB in [0, 1], shape (3, size · repeats, size · repeats).

        ``generator`` draws the initial noise of deterministic DDIM; the same state gives the same
        texture.  With ``noises`` of :attr:`noise_shape`, x_T and that of each step, DDIM is
        stochastic (η = 1) and nothing is drawn; each of their channels is standardised first.  The
        last is without effect where the schedule ends without noise.

        The texture comes back to the device of ``text_feature``.  With ``together`` the processes
        of a job, which all ask for this texture at once, divide the branches of the guidance.
        """
        latents = self.sample(
            text_feature, adversarial_feature, generator, noises=noises, together=together
        )
        return SrgbTexture(self._decode(latents).to(text_feature.device))

    def sample(
        self,
        text_feature: TextFeature,
        adversarial_feature: Float[Tensor, "extra _"] | None,
        generator: torch.Generator,
        *,
        noises: Noises | None = None,
        together: bool = False,
    ) -> Float[Tensor, "1 channels rows columns"]:
        """Return the latents x_0 from which :meth:`generate` decodes the texture."""
        condition = self._condition(text_feature, adversarial_feature)
        condition = condition.to(self._pipeline.unet.device)
        timesteps = self._pipeline.scheduler.timesteps
        first, rest = self._noises(noises, generator, len(timesteps))
        latents = self._pipeline.scheduler.init_noise_sigma * first.to(condition)
        first_with_gradient = len(timesteps) - self._gradient_steps
        step = partial(self._ddim_step, together=together)
        if self._gradient_checkpointing:
            step = partial(checkpoint, step, use_reentrant=False)
        for i, t in enumerate(timesteps):
            with torch.set_grad_enabled(torch.is_grad_enabled() and i >= first_with_gradient):
                by = shift(i, latents) if self._repeats > 1 else (0, 0)
                noise = rest[i]
                noise = None if noise is None else rolled(noise, by)
                latents = rolled_back(step(rolled(latents, by), t, condition, noise), by)
        return latents

    def _noises(
        self, noises: Noises | None, generator: torch.Generator, steps: int
    ) -> tuple[Tensor, list[Tensor | None]]:
        """x_T, and the noise of each step: none where DDIM is deterministic."""
        if noises is None:
            device = generator.device
            return torch.randn(self._latent_shape, generator=generator, device=device), [
                None
            ] * steps
        if tuple(noises.shape) != self.noise_shape:
            raise GeneratorError(
                f"noises have shape {tuple(noises.shape)}, this generator takes {self.noise_shape}"
            )
        check_finite(noises, "the noises have")
        first, *rest = standardized(noises).split(1)
        return first, [noise.to(self._pipeline.unet.device) for noise in rest]

    def _condition(
        self, text_feature: TextFeature, adversarial_feature: Tensor | None
    ) -> Float[Tensor, "branches read width"]:
        """Stack what the branches read: with guidance the unconditional one first.

        ``concat``: F_adv comes first, as in equation 8, each of its tokens added to a padding token
        of the empty prompt: F_adv = 0 then asks for nothing, while a token of zeros would be none
        that the model knows; the unconditional branch reads as many tokens, with F_adv = 0.
        ``replace``: F_adv is added to the prompt's last tokens; the unconditional branch is that of
        the empty prompt.
        """
        without, with_text = self._empty_feature.to(text_feature), text_feature
        if adversarial_feature is not None:
            self._check(adversarial_feature)
            count = len(adversarial_feature)
            neutral = without[-count:]
            if self._replaces:
                replaced = with_text[-count:] + adversarial_feature
                with_text = torch.cat([with_text[:-count], replaced])
            else:
                with_text = torch.cat([neutral + adversarial_feature, with_text])
                without = torch.cat([neutral, without])
        return torch.stack([without, with_text] if self._guidance > 1.0 else [with_text])

    def _ddim_step(
        self,
        latents: Float[Tensor, "1 channels rows columns"],
        t: Tensor,
        condition: Float[Tensor, "branches read width"],
        noise: Float[Tensor, "1 channels rows columns"] | None,
        *,
        together: bool,
    ) -> Float[Tensor, "1 channels rows columns"]:
        """x_t → x_{t−1}; deterministic without noise."""
        predict = partial(self._predict, latents, t, condition)
        predicted = parallel.divided(predict, len(condition)) if together else predict(slice(None))
        if self._guidance > 1.0:
            without, with_text = predicted.chunk(2)
            predicted = without + self._guidance * (with_text - without)
        moved = self._pipeline.scheduler.step(predicted, t, latents, eta=0.0)
        if noise is None:
            return moved.prev_sample
        return noisy_step(self._pipeline.scheduler, int(t), moved, noise.to(latents))

    def _predict(
        self, latents: Tensor, t: Tensor, condition: Tensor, branches: slice
    ) -> Float[Tensor, "branches channels rows columns"]:
        """What the U-Net predicts of x_t in some of the branches."""
        condition = condition[branches]
        same = latents.expand(len(condition), -1, -1, -1)
        with torch.autocast(same.device.type, self._half, enabled=self._half is not None):
            predicted = self._pipeline.unet(
                same, t, encoder_hidden_states=condition, return_dict=False
            )[0]
        return predicted.to(latents)

    def _decode(self, latents: Float[Tensor, "1 channels rows columns"]) -> SrgbTexture:
        vae = self._pipeline.vae
        latents = latents / vae.config.scaling_factor
        if self._repeats == 1:
            decoded = vae.decode(latents, return_dict=False)[0][0]
        else:
            decoded = vae.decode(wrapped(latents), return_dict=False)[0][0]
            decoded = tiled(decoded, _per_latent(self._pipeline), self._repeats)
        if not torch.isfinite(decoded).all():
            raise NonFiniteError("the generated texture is not finite: F_adv or guidance too large")
        return (0.5 * decoded + 0.5).clamp(0.0, 1.0)

    def _check(self, feature: Tensor) -> None:
        width = self.feature_shape[1]
        most = len(self._empty_feature)
        if feature.ndim != 2 or feature.shape[1] != width or not 1 <= len(feature) <= most:
            raise GeneratorError(
                f"F_adv has shape {tuple(feature.shape)}, "
                f"this generator reads (1 to {most} tokens, {width})"
            )
        check_finite(feature)


def _length(pipeline: Pipeline) -> int:
    """Tokens that the text encoder reads, start and end included: 77 for CLIP."""
    return pipeline.tokenizer.model_max_length


def _latent_shape(pipeline: Pipeline, size: int | None) -> tuple[int, int, int, int]:
    """Shape of x_t for a texture of ``size`` pixels; the model's own size for None."""
    per_latent = _per_latent(pipeline)
    unit = per_latent * 2 ** (len(pipeline.unet.config.block_out_channels) - 1)
    size = pipeline.unet.config.sample_size * per_latent if size is None else size
    if size <= 0 or size % unit:
        raise GeneratorError(f"texture size {size} is not a positive multiple of {unit} pixels")
    return (1, pipeline.unet.config.in_channels, size // per_latent, size // per_latent)


def _per_latent(pipeline: Pipeline) -> int:
    """Pixels per side that the autoencoder makes of one latent."""
    return 2 ** (len(pipeline.vae.config.block_out_channels) - 1)


def _require_positive(**counts: int) -> None:
    for name, count in counts.items():
        if count < 1:
            raise GeneratorError(f"{name} is {count}; give at least 1")
