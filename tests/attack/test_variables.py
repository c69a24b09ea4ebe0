"""F_adv and noises are moved alike, bounded around their origin, and survive interruptions."""

import math
from dataclasses import replace

import pytest
import torch

from cnca.attack import checkpoint, variables
from cnca.attack.loop import optimize, start
from cnca.attack.settings import VARIABLES, Settings
from cnca.attack.style import Style
from cnca.core.errors import GeneratorError, NonFiniteError, RunError
from cnca.gen.feature import StoredFeature
from tests.fake_attack import NoisyGreyGenerator, attack

ATTACK = replace(attack(), generator=NoisyGreyGenerator())
SETTINGS = Settings("grey", steps=8, learning_rate=0.1, decay=True, jitter=True, check_every=3)


def run(settings, progress=None, stop_after=None, path=None, attacked=ATTACK):
    progress, records = progress or start(attacked, settings), []

    def after_step(progress, record):
        records.append(record)
        if record.step == stop_after:
            checkpoint.save(progress, path)
            raise KeyboardInterrupt

    try:
        return optimize(attacked, settings, progress, after_step), records
    except KeyboardInterrupt:
        return None, records


@pytest.mark.parametrize("kind", VARIABLES)
def test_each_kind_moves_what_it_names_and_lowers_the_score(kind):
    settings = replace(SETTINGS, variable=kind, steps=12)
    before = variables.origin(ATTACK.generator, settings)
    latents, records = run(settings)
    assert (latents.feature is not None) == (before.feature is not None) == (kind != "noise")
    assert (latents.noises is not None) == (before.noises is not None) == (kind != "feature")
    assert records[-1].D_s < records[0].D_s
    if latents.noises is not None:
        assert not torch.equal(latents.noises, before.noises)


@pytest.mark.parametrize("kind", VARIABLES)
@pytest.mark.parametrize("stop_after", [2, 5])
def test_an_interrupted_attack_ends_bit_for_bit_the_same(tmp_path, kind, stop_after):
    settings, path = replace(SETTINGS, variable=kind), tmp_path / "c.pt"
    whole, records = run(settings)
    run(settings, stop_after=stop_after, path=path)
    progress = start(ATTACK, settings)
    checkpoint.restore(progress, path)
    again, rest = run(settings, progress)
    for name in ("feature", "noises"):
        one, other = getattr(whole, name), getattr(again, name)
        assert one is other is None or torch.equal(one, other)
    assert rest[-1].D_s == records[-1].D_s


@pytest.mark.parametrize(("tau", "most"), [(0.05, 0.05), (None, math.inf)])
def test_kappa_bounds_the_way_from_the_noise_of_the_seed(tau, most):
    settings = replace(SETTINGS, variable="noise", tau=tau)
    latents, _ = run(settings)
    way = (latents.noises - variables.origin(ATTACK.generator, settings).noises).abs().max()
    assert way <= most + 1e-6
    assert way > 0.04


def test_the_bounds_are_those_of_the_variables_unless_one_is_given():
    assert [Settings("p").bound(v) for v in ("feature", "noise")] == [1.0, math.inf]
    assert [Settings("p", tau=0.3).bound(v) for v in ("feature", "noise")] == [0.3, 0.3]
    with pytest.raises(GeneratorError, match="tau is -1"):
        start(ATTACK, Settings("p", tau=-1.0, variable="noise"))


def test_noise_without_high_frequencies_is_made_whiter():
    settings = replace(SETTINGS, variable="noise", steps=30, learning_rate=0.05)
    progress = start(ATTACK, settings)
    with torch.no_grad():
        progress.variables.latents.noises.copy_(torch.linspace(-1, 1, 8).expand(2, 1, 8, 8))
    before = progress.variables.penalty().item()
    run(settings, progress)
    assert progress.variables.penalty().item() < 0.5 * before


class Grey:
    """The prompt score is the brightness of the texture."""

    def score(self, pictures, prompts):
        return pictures.mean(dim=(1, 2, 3))[:, None].expand(-1, len(prompts))


@pytest.mark.parametrize("kind", VARIABLES)
def test_the_style_term_holds_the_prompt_score(kind):
    """Dark textures hide here: without the term the score falls, with it it stays."""
    settings = replace(SETTINGS, variable=kind, steps=40, learning_rate=0.05)
    origin = variables.origin(ATTACK.generator, settings)
    unattacked = origin.texture(ATTACK.generator, "grey", 0).mean().item()
    free, _ = run(settings)
    held, _ = run(
        settings, attacked=replace(ATTACK, style=Style(Grey(), "grey", unattacked, weight=20.0))
    )
    scores = [x.texture(ATTACK.generator, "grey", 0).mean().item() for x in (free, held)]
    assert scores[0] < unattacked - 0.1
    assert scores[1] == pytest.approx(unattacked - 0.03, abs=0.05)


def test_generators_without_noises_are_told():
    with pytest.raises(GeneratorError, match="this generator has no noise_shape; take the"):
        start(attack(), Settings("grey", variable="noise"))


def test_unknown_variables_name_the_nearest():
    with pytest.raises(RunError, match="there is feature, noise, both; did you mean 'noise'"):
        Settings("grey", variable="noises")


def test_a_gradient_that_is_missing_names_its_variable():
    moved = variables.start(ATTACK.generator, replace(SETTINGS, variable="both"))
    moved.tensors[0].grad = torch.zeros_like(moved.tensors[0])
    with pytest.raises(NonFiniteError, match="step 3: the gradient of the noises is not finite"):
        moved.refuse_non_finite("step 3")


def test_noises_are_stored_beside_the_feature(tmp_path):
    latents, _ = run(replace(SETTINGS, variable="both"))
    path = tmp_path / "F_adv.safetensors"
    StoredFeature(latents.feature, "grey", 1.0, noises=latents.noises).save(path)
    stored = StoredFeature.load(path)
    assert torch.equal(stored.feature, latents.feature)
    assert torch.equal(stored.noises, latents.noises)
    StoredFeature(None, "grey", 1.0, noises=latents.noises).save(path)
    assert StoredFeature.load(path).feature is None
