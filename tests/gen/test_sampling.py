import dataclasses
import gc

import pytest
import torch
from diffusers import DDIMScheduler, StableDiffusionPipeline

from cnca.core.errors import GeneratorError
from cnca.gen import feature, noise
from cnca.gen.live_memory import LiveMemory
from cnca.gen.pipeline import Pipeline
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.scene.protocols import NoisyTextureGenerator, TextureGenerator


def seeded(seed: int = 3) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def noise_feature(spread: float = 0.5) -> torch.Tensor:
    return feature.initial((2, 128), spread=spread, generator=seeded(1))


def test_is_a_texture_generator(tiny):
    generator = DiffusionTextureGenerator(tiny, tokens=2, steps=2)
    assert isinstance(generator, TextureGenerator)
    assert isinstance(generator, NoisyTextureGenerator)


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

    theirs = pipeline_of_diffusers(tiny)(
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


def pipeline_of_diffusers(tiny: Pipeline) -> StableDiffusionPipeline:
    reference = StableDiffusionPipeline(
        **vars(tiny), safety_checker=None, feature_extractor=None, requires_safety_checker=False
    )
    reference.set_progress_bar_config(disable=True)
    return reference


def test_latents_of_all_twenty_steps_agree_with_the_pipeline_of_diffusers(tiny):
    sampler = DiffusionTextureGenerator(tiny, guidance=7.5)
    text, empty = sampler.encode("zebra strips"), sampler.encode("")
    theirs = pipeline_of_diffusers(tiny)(
        prompt_embeds=text[None],
        negative_prompt_embeds=empty[None],
        num_inference_steps=20,
        guidance_scale=7.5,
        generator=seeded(),
        output_type="latent",
    ).images
    ours = sampler.sample(text, None, seeded())
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0.0)


def test_gradient_agrees_with_that_of_the_pipeline_of_diffusers(tiny):
    """Theirs without checkpoints: its ``__call__`` under ``no_grad`` hides a function that has."""
    for part in (tiny.vae, tiny.unet, tiny.text_encoder):
        part.double()
    sampler = DiffusionTextureGenerator(tiny, feature="replace", tokens=2, steps=5, guidance=5.0)
    text, empty = sampler.encode("zebra strips"), sampler.encode("")
    extra = noise_feature().double().requires_grad_()
    reference = pipeline_of_diffusers(tiny)
    latents = type(reference).__call__.__wrapped__(
        reference,
        prompt_embeds=torch.cat([text[:-2], text[-2:] + extra])[None],
        negative_prompt_embeds=empty[None],
        num_inference_steps=5,
        guidance_scale=5.0,
        latents=torch.randn(1, 4, 16, 16, generator=seeded()).double(),
        output_type="latent",
        return_dict=False,
    )[0]
    (expected,) = torch.autograd.grad(latents.square().sum(), extra)
    (found,) = torch.autograd.grad(sampler.sample(text, extra, seeded()).square().sum(), extra)
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", ["concat", "replace"])
def test_elements_agree_with_finite_differences_through_all_twenty_steps(tiny, kind):
    for part in (tiny.vae, tiny.unet, tiny.text_encoder):
        part.double()
    sampler = DiffusionTextureGenerator(tiny, feature=kind, tokens=2, guidance=4.0)
    text, start = sampler.encode("zebra strips"), noise_feature().double().requires_grad_()

    def score(values: torch.Tensor) -> torch.Tensor:
        return sampler.sample(text, values, seeded()).square().sum()

    (gradient,) = torch.autograd.grad(score(start), start)
    for token, element in ((0, 3), (0, 100), (1, 64)):
        step = torch.zeros_like(start)
        step[token, element] = h = 1e-4
        with torch.no_grad():
            expected = (score(start + step) - score(start - step)) / (2 * h)
        # Central differences: relative error h² times curvature, and rounding 1e-16 / h.
        torch.testing.assert_close(gradient[token, element], expected, rtol=1e-5, atol=1e-8)


NOISE_SHAPE = (6, 4, 16, 16)
"""Of five steps of the tiny pipeline."""


@pytest.mark.parametrize("schedule", [None, EPSILON_SCHEDULE])
def test_noises_agree_with_the_stochastic_pipeline_of_diffusers(tiny, schedule, monkeypatch):
    """Theirs is handed our noises, standardised, in place of those that it would draw."""
    if schedule:
        tiny = dataclasses.replace(tiny, scheduler=DDIMScheduler(**schedule))
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=5, guidance=4.0)
    assert sampler.noise_shape == NOISE_SHAPE
    noises = torch.randn(NOISE_SHAPE, generator=seeded())
    white = (noises - noises.mean((2, 3), True)) / noises.std((2, 3), correction=0, keepdim=True)
    first, *others = white.split(1)
    monkeypatch.setattr(
        "diffusers.schedulers.scheduling_ddim.randn_tensor", lambda *_, **__: others.pop(0)
    )
    text, empty = sampler.encode("zebra strips"), sampler.encode("")
    theirs = pipeline_of_diffusers(tiny)(
        prompt_embeds=text[None],
        negative_prompt_embeds=empty[None],
        num_inference_steps=5,
        guidance_scale=4.0,
        eta=1.0,
        latents=first,
        output_type="latent",
    ).images
    assert len(others) <= 1  # that of the last step, where it has no variance
    ours = sampler.sample(text, None, seeded(), noises=noises)
    # The same formula in another order of float32: a few of its last digits.
    torch.testing.assert_close(ours, theirs, atol=5e-5, rtol=0.0)
    assert not torch.allclose(ours, sampler.sample(text, None, seeded()), atol=0.1)


def test_the_noises_of_a_seed_are_those_that_diffusers_draws(tiny):
    """x_T, then one a step, from one generator: for large latents standardising changes little."""
    drawn = noise.draw(NOISE_SHAPE, seeded())
    rng = seeded()
    assert torch.equal(
        drawn, torch.cat([torch.randn(1, 4, 16, 16, generator=rng) for _ in range(6)])
    )


def test_noises_agree_with_finite_differences_through_all_steps(tiny):
    for part in (tiny.vae, tiny.unet, tiny.text_encoder):
        part.double()
    sampler = DiffusionTextureGenerator(tiny, tokens=2, guidance=4.0)
    text, shape = sampler.encode("zebra strips"), sampler.noise_shape
    start = noise.draw(shape, seeded()).double().requires_grad_()

    def score(values: torch.Tensor) -> torch.Tensor:
        return sampler.sample(text, None, seeded(), noises=values).square().sum()

    (gradient,) = torch.autograd.grad(score(start), start)
    for place in ((0, 0, 3, 4), (1, 2, 8, 0), (10, 3, 15, 15), (19, 1, 7, 7)):
        step = torch.zeros_like(start)
        step[place] = h = 1e-4
        with torch.no_grad():
            expected = (score(start + step) - score(start - step)) / (2 * h)
        assert abs(expected) > 1e-6
        torch.testing.assert_close(gradient[place], expected, rtol=1e-5, atol=1e-8)
    assert (gradient[20] == 0).all()  # the schedule ends without noise


def test_scaled_and_shifted_noises_are_the_same_noises(tiny):
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=3)
    noises, text = noise.draw(sampler.noise_shape, seeded()), sampler.encode("zebra")
    one, two = (sampler.generate(text, None, seeded(), noises=x) for x in (noises, 3 * noises - 1))
    torch.testing.assert_close(one, two, atol=1e-4, rtol=0.0)


def test_noises_that_are_none_are_named(tiny):
    sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=3)
    noises, text = noise.draw(sampler.noise_shape, seeded()), sampler.encode("zebra")
    with pytest.raises(GeneratorError, match=r"noises have shape \(3, 4, 16, 16\), .* \(4, 4, 16"):
        sampler.generate(text, None, seeded(), noises=noises[1:])
    noises[0, 0, 0, 0] = float("inf")
    with pytest.raises(GeneratorError, match="the noises have 1 of 4096 values"):
        sampler.generate(text, None, seeded(), noises=noises)


def test_replacing_agrees_with_the_pipeline_that_reads_the_clamped_tokens(tiny):
    """The released code: the prompt's last tokens, moved by at most τ from its embedding."""
    sampler = DiffusionTextureGenerator(tiny, feature="replace", steps=3, guidance=4.0)
    assert sampler.feature_shape == (40, 128)
    text, empty = sampler.encode("zebra strips"), sampler.encode("")
    wanted = text[-40:] + torch.randn(40, 128, generator=seeded(2))
    tau = 0.3
    theirs = pipeline_of_diffusers(tiny)(
        prompt_embeds=torch.cat([text[:37], wanted.clamp(text[-40:] - tau, text[-40:] + tau)])[
            None
        ],
        negative_prompt_embeds=empty[None],
        num_inference_steps=3,
        guidance_scale=4.0,
        generator=seeded(),
        output_type="latent",
    ).images
    ours = sampler.sample(text, feature.project(wanted - text[-40:], tau), seeded())
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=0.0)


@pytest.mark.parametrize("kind", ["concat", "replace"])
@pytest.mark.parametrize("tokens", [1, 33, 77])
def test_any_number_of_tokens(tiny, kind, tokens):
    sampler = DiffusionTextureGenerator(tiny, feature=kind, tokens=tokens, steps=1)
    extra = feature.initial(sampler.feature_shape, spread=0.5, generator=seeded()).requires_grad_()
    sampler.generate(sampler.encode("zebra"), extra, seeded()).sum().backward()
    assert (extra.grad.abs().sum(dim=1) > 0).all()


def test_replacing_by_nothing_leaves_the_prompt(tiny):
    sampler = DiffusionTextureGenerator(tiny, feature="replace", steps=2)
    text = sampler.encode("zebra")
    still = sampler.generate(text, torch.zeros(sampler.feature_shape), seeded())
    assert torch.equal(still, sampler.generate(text, None, seeded()))


def test_half_precision_is_finite_and_near(tiny):
    full, half = (
        DiffusionTextureGenerator(tiny, tokens=2, guidance=4.0, half=half)
        for half in (None, torch.bfloat16)
    )
    text, extra = full.encode("zebra"), noise_feature().requires_grad_()
    one, two = (g.generate(text, extra, seeded()) for g in (full, half))
    (gradient,) = torch.autograd.grad(two.mean(), extra)
    assert two.dtype == torch.float32
    assert torch.isfinite(gradient).all()
    assert gradient.abs().max() > 0
    # Each of the 20 predictions is rounded to 8 bits; guidance multiplies their difference by 4.
    assert 0 < (one - two).abs().mean() < 20 * 4 * 2**-8


def test_weights_in_half_precision_stay_finite(tiny):
    for part in (tiny.vae, tiny.unet, tiny.text_encoder):
        part.bfloat16()
    sampler = DiffusionTextureGenerator(tiny, tokens=2)
    extra = noise_feature().bfloat16().requires_grad_()
    texture = sampler.generate(sampler.encode("zebra"), extra, seeded())
    (gradient,) = torch.autograd.grad(texture.float().mean(), extra)
    assert torch.isfinite(texture).all()
    assert torch.isfinite(gradient).all()


def test_gradient_steps_shorten_the_gradient_but_not_the_texture(tiny):
    extra = noise_feature().requires_grad_()
    results = []
    for last in (None, 4, 1):
        sampler = DiffusionTextureGenerator(tiny, tokens=2, steps=4, gradient_steps=last)
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


def test_without_checkpointing_texture_and_gradient_are_the_same(tiny):
    extra = noise_feature().requires_grad_()
    for steps in (None, 2):
        options = {"tokens": 2, "steps": 4, "gradient_steps": steps, "guidance": 4.0}
        with_it = DiffusionTextureGenerator(tiny, **options)
        without = DiffusionTextureGenerator(tiny, **options, gradient_checkpointing=False)
        textures = [g.generate(g.encode("zebra"), extra, seeded()) for g in (with_it, without)]
        gradients = [torch.autograd.grad(texture.mean(), extra)[0] for texture in textures]
        assert torch.equal(*textures)
        torch.testing.assert_close(*gradients)


def peak_bytes(tiny: Pipeline, steps: int, checkpointing: bool) -> int:
    sampler = DiffusionTextureGenerator(
        tiny, tokens=2, steps=steps, guidance=4.0, gradient_checkpointing=checkpointing
    )
    text, extra = sampler.encode("zebra"), noise_feature().requires_grad_()
    gc.collect()
    with LiveMemory() as memory:
        sampler.generate(text, extra, seeded()).sum().backward()
    return memory.peak


def test_memory_does_not_grow_with_the_steps(tiny):
    """Each further step keeps its latents and the few numbers of its schedule, nothing else."""
    latents = 4 * 16 * 16 * 4
    few, many = (peak_bytes(tiny, steps, checkpointing=True) for steps in (3, 23))
    assert many - few <= 20 * 2 * latents
    few, many = (peak_bytes(tiny, steps, checkpointing=False) for steps in (3, 23))
    assert many - few > 20 * 20 * latents  # the check sees what it is to see


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
        ({"gradient_steps": 0}, "gradient_steps is 0"),
        ({"gradient_steps": 5, "steps": 4}, "gradient_steps is 5: there are 4 steps"),
        ({"tokens": 78}, "tokens is 78: the encoder reads 77"),
        ({"feature": "replaced"}, "did you mean 'replace'"),
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
