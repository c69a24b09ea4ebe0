"""Stable Diffusion v1.5's own configuration, with random weights."""

import json
from pathlib import Path

import pytest
import torch
from diffusers import AutoencoderKL, PNDMScheduler, UNet2DConditionModel
from transformers import CLIPTextConfig, CLIPTextModel

from cnca.gen import architecture
from cnca.gen.pipeline import Pipeline
from cnca.gen.sampling import DiffusionTextureGenerator

UNET = {
    "act_fn": "silu",
    "attention_head_dim": 8,
    "block_out_channels": [320, 640, 1280, 1280],
    "center_input_sample": False,
    "cross_attention_dim": 768,
    "down_block_types": ["CrossAttnDownBlock2D"] * 3 + ["DownBlock2D"],
    "downsample_padding": 1,
    "flip_sin_to_cos": True,
    "freq_shift": 0,
    "in_channels": 4,
    "layers_per_block": 2,
    "mid_block_scale_factor": 1,
    "norm_eps": 1e-05,
    "norm_num_groups": 32,
    "out_channels": 4,
    "sample_size": 64,
    "up_block_types": ["UpBlock2D"] + ["CrossAttnUpBlock2D"] * 3,
}
VAE = {
    "act_fn": "silu",
    "block_out_channels": [128, 256, 512, 512],
    "down_block_types": ["DownEncoderBlock2D"] * 4,
    "in_channels": 3,
    "latent_channels": 4,
    "layers_per_block": 2,
    "norm_num_groups": 32,
    "out_channels": 3,
    "sample_size": 512,
    "up_block_types": ["UpDecoderBlock2D"] * 4,
}
TEXT_ENCODER = {
    "hidden_act": "quick_gelu",
    "hidden_size": 768,
    "intermediate_size": 3072,
    "layer_norm_eps": 1e-05,
    "max_position_embeddings": 77,
    "num_attention_heads": 12,
    "num_hidden_layers": 12,
    "projection_dim": 768,
    "vocab_size": 49408,
}
SCHEDULER = {
    "beta_end": 0.012,
    "beta_schedule": "scaled_linear",
    "beta_start": 0.00085,
    "num_train_timesteps": 1000,
    "set_alpha_to_one": False,
    "skip_prk_steps": True,
    "steps_offset": 1,
}
"""As ``config.json`` of each part says on the model's page; the scheduler is PNDM, read as DDIM."""


def count(model: torch.nn.Module) -> int:
    return sum(parameter.numel() for parameter in model.parameters())


def test_parameters_are_as_many_as_published():
    with torch.device("meta"):
        assert count(UNet2DConditionModel(**UNET)) == 859_520_964
        assert count(AutoencoderKL(**VAE)) == 83_653_863
        assert count(CLIPTextModel(CLIPTextConfig(**TEXT_ENCODER))) == 123_060_480


def write_folder(folder: Path, unet: dict, vae: dict, text_encoder: dict) -> Path:
    """What v1.5's folder holds, a safety checker that is not read included."""
    torch.manual_seed(0)
    UNet2DConditionModel(**unet).save_pretrained(folder / "unet")
    AutoencoderKL(**vae).save_pretrained(folder / "vae")
    CLIPTextModel(CLIPTextConfig(**text_encoder)).save_pretrained(folder / "text_encoder")
    architecture.word_pieces(["zebra strips"]).save_pretrained(folder / "tokenizer")
    PNDMScheduler(**SCHEDULER).save_pretrained(folder / "scheduler")
    index = {
        "_class_name": "StableDiffusionPipeline",
        "feature_extractor": ["transformers", "CLIPImageProcessor"],
        "safety_checker": ["stable_diffusion", "StableDiffusionSafetyChecker"],
        "scheduler": ["diffusers", "PNDMScheduler"],
        "text_encoder": ["transformers", "CLIPTextModel"],
        "tokenizer": ["transformers", "CLIPTokenizer"],
        "unet": ["diffusers", "UNet2DConditionModel"],
        "vae": ["diffusers", "AutoencoderKL"],
    }
    (folder / "model_index.json").write_text(json.dumps(index))
    return folder


def step_with_gradient(generator: DiffusionTextureGenerator, size: int) -> None:
    text = generator.encode("zebra strips")
    extra = torch.zeros(generator.feature_shape, requires_grad=True)
    noise = torch.Generator().manual_seed(0)
    texture = generator.generate(text, extra, noise)
    (gradient,) = torch.autograd.grad(texture.mean(), extra)
    assert texture.shape == (3, size, size)
    assert torch.isfinite(gradient).all()
    assert gradient.abs().max() > 0


@pytest.mark.parametrize("feature", ["concat", "replace"])
def test_a_narrow_one_loads_from_its_folder_and_steps_with_gradient(tmp_path, feature):
    """Every key of v1.5, text features of its width, but fewer channels and layers."""
    narrow = {"block_out_channels": [32, 64, 64, 64], "layers_per_block": 1}
    folder = write_folder(
        tmp_path / "v1-5", UNET | narrow, VAE | narrow, TEXT_ENCODER | {"num_hidden_layers": 1}
    )
    generator = DiffusionTextureGenerator.load(folder, feature=feature, steps=1, size=64)
    assert generator.feature_shape == ((77 if feature == "concat" else 40), 768)
    step_with_gradient(generator, 64)


@pytest.mark.slow
def test_the_whole_one_steps_with_gradient():
    """4.3 GB of weights; one step on latents of 8×8."""
    torch.manual_seed(0)
    tokenizer = architecture.word_pieces(["zebra strips"])
    pipeline = Pipeline(
        vae=AutoencoderKL(**VAE),
        unet=UNet2DConditionModel(**UNET),
        text_encoder=CLIPTextModel(CLIPTextConfig(**TEXT_ENCODER)),
        tokenizer=tokenizer,
        scheduler=architecture.scheduler().from_config(SCHEDULER),
    )
    step_with_gradient(DiffusionTextureGenerator(pipeline, steps=1, size=64, guidance=7.5), 64)
