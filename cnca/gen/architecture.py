"""The shipped generator's parts: Stable Diffusion's classes (Rombach et al. 2022) at small size.

Sizes were chosen by measuring on two CPU cores; every part is an ordinary diffusers or
transformers class, so the same code loads and samples Stable Diffusion v1.5.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from jaxtyping import Float
from tokenizers import Tokenizer, models, pre_tokenizers, trainers
from torch import Tensor
from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

from cnca.gen.pyramid_start import start_as_pyramid

TEXT_WIDTH = 128
"""Width of a text token and of a token of F_adv."""

PICTURE_CHANNELS, POSITION_CHANNELS = 4, 2
"""Latent channels that the autoencoder uses, and further ones that say where they are."""

POSITION_RANGE = 3.0
"""Value of a position channel at the right or lower border, minus it at the other: louder than
noise from the first steps on."""

TEXT_POSITIONS = 77
"""CLIP's number of text tokens, start and end included."""


def autoencoder() -> AutoencoderKL:
    """256×256 sRGB in [−1, 1] ↔ latents (4, 32, 32)."""
    vae = AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * 4,
        up_block_types=("UpDecoderBlock2D",) * 4,
        latent_channels=PICTURE_CHANNELS,
        block_out_channels=(16, 24, 48, 96),
        layers_per_block=1,
        norm_num_groups=1,
        sample_size=256,
        mid_block_add_attention=False,
    )
    start_as_pyramid(vae)
    return vae


def positions(side: int) -> Float[Tensor, "2 side side"]:
    """The position channels of square latents: how far right, how far down.

    A U-Net of Stable Diffusion's kind has no position embedding; without one, attention cannot
    carry what a token of F_adv says to a place.
    """
    ramp = torch.linspace(-POSITION_RANGE, POSITION_RANGE, side)
    return torch.stack(torch.meshgrid(ramp, ramp, indexing="xy"))


@torch.no_grad()
def with_position_channels(vae: AutoencoderKL) -> AutoencoderKL:
    """The same autoencoder for latents with position channels, which its decoder disregards."""
    wider = AutoencoderKL.from_config(
        vae.config,
        latent_channels=PICTURE_CHANNELS + POSITION_CHANNELS,
        # diffusers takes its default for what was not given when the autoencoder was made
        scaling_factor=vae.config["scaling_factor"],
    )
    for name, weights in wider.state_dict().items():
        weights.zero_()
        narrow = vae.state_dict()[name]
        # Mean and log-variance of the encoder lie one after the other along the first axis.
        halves = 2 if name.startswith(("encoder.conv_out", "quant_conv")) else 1
        rows = weights.unflatten(0, (halves, -1))[:, : len(narrow) // halves]
        rows = rows if narrow.ndim == 1 else rows[:, :, : narrow.shape[1]]
        rows.copy_(narrow.unflatten(0, (halves, -1)))
    return wider


def denoiser() -> UNet2DConditionModel:
    """The U-Net: cross-attention at 8×8 and 16×16, and all tokens pooled into the time embedding.

    The pooling (``addition_embed_type``) is the short way for colors: with cross-attention alone
    the text still had no effect after 2,000 steps.
    """
    return UNet2DConditionModel(
        sample_size=32,
        in_channels=PICTURE_CHANNELS + POSITION_CHANNELS,
        out_channels=PICTURE_CHANNELS + POSITION_CHANNELS,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D", "CrossAttnDownBlock2D"),
        up_block_types=("CrossAttnUpBlock2D", "CrossAttnUpBlock2D", "UpBlock2D"),
        block_out_channels=(32, 64, 96),
        layers_per_block=1,
        cross_attention_dim=TEXT_WIDTH,
        attention_head_dim=4,  # diffusers reads this as the number of heads, as for v1.5
        norm_num_groups=8,
        addition_embed_type="text",
        addition_embed_type_num_heads=4,
    )


def text_encoder(tokenizer: CLIPTokenizer) -> CLIPTextModel:
    """CLIP's text transformer with two random layers, never trained: every word is a direction.

    Trained together with the U-Net it collapsed: the features of all prompts became one.
    """
    encoder = CLIPTextModel(
        CLIPTextConfig(
            vocab_size=len(tokenizer),
            hidden_size=TEXT_WIDTH,
            intermediate_size=2 * TEXT_WIDTH,
            projection_dim=TEXT_WIDTH,
            num_hidden_layers=2,
            num_attention_heads=4,
            max_position_embeddings=TEXT_POSITIONS,
            bos_token_id=tokenizer.bos_token_id,
            eos_token_id=tokenizer.eos_token_id,
            pad_token_id=tokenizer.pad_token_id,
        )
    )
    words = encoder.get_input_embeddings().weight
    positions = encoder.get_parameter("embeddings.position_embedding.weight")
    with torch.no_grad():
        # Padding has no word of its own: a third of it repeats the words before it, the rest
        # tells where it stands, by which F_adv's tokens are told apart.
        words.normal_()[tokenizer.pad_token_id] = 0.0
        positions.normal_(std=0.1)
    return encoder


def scheduler() -> DDIMScheduler:
    """Stable Diffusion's noise schedule, v-prediction, with no signal left at the last step.

    Zero terminal SNR (Lin et al. 2024) lets the sampler choose the mean color freely.
    """
    return DDIMScheduler(
        beta_start=0.00085,
        beta_end=0.012,
        beta_schedule="scaled_linear",
        clip_sample=False,
        prediction_type="v_prediction",
        rescale_betas_zero_snr=True,
        steps_offset=1,  # unused by trailing timesteps; the pipeline insists on it
        timestep_spacing="trailing",
    )


def word_pieces(captions: Iterable[str]) -> CLIPTokenizer:
    """CLIP's byte-pair tokenizer with a vocabulary learned from ``captions``.

    Every byte is in the vocabulary, inside and at the end of a word: every prompt can be encoded.
    """
    start, end = "<|startoftext|>", "<|endoftext|>"
    clip = CLIPTokenizer().backend_tokenizer  # for CLIP's own way to split text into words
    learner = Tokenizer(models.BPE(unk_token=end, end_of_word_suffix="</w>"))
    learner.normalizer, learner.pre_tokenizer = clip.normalizer, clip.pre_tokenizer
    alphabet = sorted(pre_tokenizers.ByteLevel.alphabet())
    trainer = trainers.BpeTrainer(
        special_tokens=[start, end],
        initial_alphabet=alphabet,
        end_of_word_suffix="</w>",
        show_progress=False,
    )
    learner.train_from_iterator(sorted(set(captions)), trainer)
    learnt = json.loads(learner.to_str())["model"]
    vocabulary: dict[str, int] = learnt["vocab"]
    last = [letter + "</w>" for letter in alphabet if letter + "</w>" in vocabulary]
    # the learner numbers these in no fixed order
    vocabulary |= dict(zip(last, sorted(vocabulary[letter] for letter in last), strict=True))
    for letter in alphabet:
        vocabulary.setdefault(letter + "</w>", len(vocabulary))
    merges = [tuple(pair) for pair in learnt["merges"]]
    return CLIPTokenizer(vocab=vocabulary, merges=merges, model_max_length=TEXT_POSITIONS)
