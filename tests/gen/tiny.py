"""A tiny random pipeline: small enough for finite differences."""

from pathlib import Path

import torch
from diffusers import AutoencoderKL, StableDiffusionPipeline, UNet2DConditionModel

from cnca.gen import architecture
from cnca.gen.pipeline import Pipeline


def tiny_pipeline() -> Pipeline:
    """32×32 textures from latents (4, 16, 16); text as in the shipped generator."""
    torch.manual_seed(0)
    tokenizer = architecture.word_pieces(["yellow black graffiti", "zebra strips"])
    return Pipeline(
        vae=AutoencoderKL(
            down_block_types=("DownEncoderBlock2D",) * 2,
            up_block_types=("UpDecoderBlock2D",) * 2,
            block_out_channels=(8, 16),
            norm_num_groups=4,
            mid_block_add_attention=False,
            scaling_factor=0.7,
        ),
        unet=UNet2DConditionModel(
            sample_size=16,
            down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
            up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
            block_out_channels=(8, 16),
            layers_per_block=1,
            cross_attention_dim=architecture.TEXT_WIDTH,
            attention_head_dim=2,
            norm_num_groups=4,
        ),
        text_encoder=architecture.text_encoder(tokenizer),
        tokenizer=tokenizer,
        scheduler=architecture.scheduler(),
    )


def save_pipeline(pipeline: Pipeline, folder: Path) -> Path:
    """The folder, written as diffusers itself saves a pipeline."""
    StableDiffusionPipeline(
        **vars(pipeline),
        safety_checker=None,
        feature_extractor=None,
        requires_safety_checker=False,
    ).save_pretrained(folder)
    return folder
