import dataclasses

import pytest
import torch
from diffusers import DDIMScheduler, StableDiffusionPipeline

from cnca.errors import GeneratorError
from cnca.gen import feature
from cnca.gen.pipeline import Pipeline
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.protocols import TextureGenerator


def seeded(seed: int = 3) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def noise_feature(spread: float = 0.5) -> torch.Tensor:
    return feature.initial((2, 128), spread=spread, generator=seeded(1))


def test_is_a_texture_generator(tiny):
    assert isinstance(DiffusionTextureGenerator(tiny, tokens=2, steps=2), TextureGenerator)


EPSILON_SCHEDULE = {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear"} | {
    "clip_sample": False,
    "set_alpha_to_one": False,
    "steps_offset": 1,
}
"""The schedule of Stable Diffusion v1.5: predicts the noise, leading timesteps."""


@pytest.mark.parametrize("guidance", [1.0, 5.0])
@pytest.mark.parametrize("schedule", [None, EPSILON_SCHEDULE])
@pytest.mark.parametrize("with_feature", [True, False])
def test_agrees_with_the_pipeline_of_diffusers(tiny, guidance, schedule, with_feature):
    if schedule:
        tiny = dataclasses.replace(tiny, scheduler=DDIMScheduler(**schedule))
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=4, guidance=guidance)
    text, empty = sampler.encode("zebra strips"), sampler.encode("")
    extra, neutral = noise_feature(), empty[-2:]
    ours = sampler.generate(text, extra if with_feature else None, seeded())
    front = [[neutral + extra], [neutral]] if with_feature else [[], []]

    reference = StableDiffusionPipeline(
        **vars(tiny), safety_checker=None, feature_extractor=None, requires_safety_checker=False
    )
    reference.set_progress_bar_config(disable=True)
    theirs = reference(
        prompt_embeds=torch.cat([*front[0], text])[None],
        negative_prompt_embeds=torch.cat([*front[1], empty])[None],
        num_inference_steps=4,
        guidance_scale=guidance,
        generator=seeded(),
        output_type="pt",
    ).images[0]
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0.0)


@pytest.mark.parametrize("guidance", [1.0, 5.0])
def test_gradient_agrees_with_finite_differences(tiny, guidance):
    for part in (tiny.vae, tiny.unet, tiny.text_encoder):
        part.double()
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=3, guidance=guidance)
    text = sampler.encode("yellow black graffiti")
    weights = torch.rand(3, 32, 32, generator=seeded(5), dtype=torch.float64)
    start = noise_feature().double().requires_grad_()

    def score(values: torch.Tensor) -> torch.Tensor:
        return (weights * sampler.generate(text, values, seeded())).sum()

    (gradient,) = torch.autograd.grad(score(start), start)
    for seed in range(3):
        direction = torch.randn(start.shape, generator=seeded(seed), dtype=torch.float64)
        h = 3e-4
        with torch.no_grad():
            expected = (score(start + h * direction) - score(start - h * direction)) / (2 * h)
        torch.testing.assert_close((gradient * direction).sum(), expected, rtol=1e-5, atol=1e-8)


def test_backprop_steps_shorten_the_gradient_but_not_the_texture(tiny):
    extra = noise_feature().requires_grad_()
    results = []
    for last in (None, 4, 1):
        sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=4, backprop_steps=last)
        texture = sampler.generate(sampler.encode("zebra"), extra, seeded())
        results.append((texture.detach(), torch.autograd.grad(texture.mean(), extra)[0]))
    (full, g_full), (same, g_same), (short, g_short) = results
    torch.testing.assert_close(full, short)
    torch.testing.assert_close(full, same)
    torch.testing.assert_close(g_full, g_same)
    assert not torch.allclose(g_full, g_short, rtol=1e-2)
    assert g_short.abs().max() > 0


def test_weights_stay_frozen(tiny):
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=2)
    extra = noise_feature().requires_grad_()
    sampler.generate(sampler.encode("zebra"), extra, seeded()).mean().backward()
    parameters = [*tiny.unet.parameters(), *tiny.vae.parameters(), *tiny.text_encoder.parameters()]
    assert all(p.grad is None and not p.requires_grad for p in parameters)
    assert extra.grad is not None


def test_saved_activations_do_not_grow_with_the_steps(tiny):
    def saved_bytes(steps: int) -> int:
        total = 0

        def count(tensor: torch.Tensor) -> torch.Tensor:
            nonlocal total
            total += tensor.nbytes
            return tensor

        sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=steps)
        text, extra = sampler.encode("zebra"), noise_feature().requires_grad_()
        with torch.autograd.graph.saved_tensors_hooks(count, lambda tensor: tensor):
            sampler.generate(text, extra, seeded())
        return total

    per_step = (saved_bytes(12) - saved_bytes(2)) / 10
    latents = 4 * 16 * 16 * 4
    condition = 2 * (77 + 2) * 128 * 4
    assert per_step <= 2 * (latents + condition)


def test_same_noise_same_texture_other_noise_other_texture(tiny):
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=2)
    text = sampler.encode("zebra")
    first, again, other = (sampler.generate(text, None, seeded(s)) for s in (0, 0, 1))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_size_is_a_choice(tiny):
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=2, size=64)
    assert sampler.generate(sampler.encode(""), None, seeded()).shape == (3, 64, 64)


def test_prompts_may_hold_any_character_but_no_more_than_77_tokens(tiny):
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=2)
    assert sampler.encode("Zèbre 斑马 🦓!").shape == (77, 128)
    assert sampler.encode("zebra " * 75).shape == (77, 128)
    with pytest.raises(GeneratorError, match=r"78 tokens, the encoder reads 77") as caught:
        sampler.encode("zebra " * 76)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": 0}, "steps is 0"),
        ({"tokens": -1}, "tokens is -1"),
        ({"backprop_steps": 0}, "backprop_steps is 0"),
        ({"size": 33}, "size 33 is not a positive multiple of 4"),
        ({"size": 0}, "size 0"),
    ],
)
def test_options_out_of_range_are_named(tiny, options, message):
    with pytest.raises(GeneratorError, match=message):
        DiffusionTextureGenerator(tiny, **options)


def test_unusable_features_are_named(tiny: Pipeline):
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=2)
    text = sampler.encode("zebra")
    holed = torch.zeros(2, 128)
    holed[1, 5] = float("nan")
    with pytest.raises(GeneratorError, match="F_adv has 1 of 256 values that are NaN"):
        sampler.generate(text, holed, seeded())
    with pytest.raises(GeneratorError, match=r"F_adv has shape \(2, 64\)"):
        sampler.generate(text, torch.zeros(2, 64), seeded())
