import math

import pytest
import torch
from safetensors.torch import save_file

from cnca.core.errors import GeneratorError
from cnca.gen.choices import check_kind
from cnca.gen.feature import StoredFeature, default_tokens, initial, project


def test_projection_is_the_nearest_point_of_the_box():
    generator = torch.Generator().manual_seed(0)
    feature = 3.0 * torch.randn(8, 16, generator=generator)
    nearest = project(feature, 0.7)
    assert nearest.abs().max() <= 0.7
    inside = feature.abs() <= 0.7
    assert torch.equal(nearest[inside], feature[inside])
    for _ in range(20):  # no other point of the box is nearer
        other = (2 * torch.rand(8, 16, generator=generator) - 1) * 0.7
        assert (nearest - feature).norm() <= (other - feature).norm()


def test_projection_at_the_edges_of_tau():
    feature = torch.tensor([[-2.0, 5.0]])
    assert torch.equal(project(feature, 0.0), torch.zeros(1, 2))
    assert torch.equal(project(feature, math.inf), feature)


@pytest.mark.parametrize("tau", [-0.1, -math.inf, math.nan])
def test_tau_below_zero_is_refused(tau):
    with pytest.raises(GeneratorError, match="tau is"):
        project(torch.zeros(1, 2), tau)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_clipping_hides_nothing_that_is_not_finite(value):
    with pytest.raises(GeneratorError, match="1 of 2 values"):
        project(torch.tensor([[0.0, value]]), 1.0)


def test_initial_values():
    assert torch.equal(initial((8, 128)), torch.zeros(8, 128))
    one, two = (
        initial((8, 128), spread=0.1, generator=torch.Generator().manual_seed(4)) for _ in range(2)
    )
    assert torch.equal(one, two)
    assert 0.09 < one.std() < 0.11


@pytest.mark.parametrize("kind", ["concat", "replace"])
@pytest.mark.parametrize("tau", [0.5, math.inf])
def test_a_stored_feature_comes_back(tmp_path, tau, kind):
    stored = StoredFeature(torch.randn(8, 128), "yellow black graffiti, « grün »", tau, kind)
    stored.save(tmp_path / "feature.safetensors")
    back = StoredFeature.load(tmp_path / "feature.safetensors")
    assert torch.equal(back.feature, stored.feature)
    assert (back.prompt, back.tau, back.kind) == (stored.prompt, stored.tau, kind)
    assert [file.name for file in tmp_path.iterdir()] == ["feature.safetensors"]


def test_default_tokens_follow_the_text():
    assert (default_tokens("concat", 77), default_tokens("replace", 77)) == (77, 40)
    assert (default_tokens("concat", 8), default_tokens("replace", 8)) == (8, 4)


def test_unknown_kinds_are_refused():
    with pytest.raises(GeneratorError, match="feature 'concatt': unknown.*did you mean 'concat'"):
        check_kind("concatt")


def test_other_files_are_refused_in_one_line(tmp_path):
    text = tmp_path / "notes.safetensors"
    text.write_text("not a tensor file\n" * 9)
    foreign = tmp_path / "foreign.safetensors"
    save_file({"weight": torch.zeros(2)}, foreign)
    unlabelled = tmp_path / "unlabelled.safetensors"
    save_file({"F_adv": torch.zeros(2, 2)}, unlabelled)
    for file in (text, foreign, unlabelled, tmp_path / "missing.safetensors"):
        with pytest.raises(GeneratorError, match="no adversarial feature") as caught:
            StoredFeature.load(file)
        assert str(file) in str(caught.value)
        assert "\n" not in str(caught.value)
