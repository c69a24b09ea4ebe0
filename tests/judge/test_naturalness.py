"""Naturalness against closed forms."""

import pytest
import torch

from cnca.core.errors import RunError
from cnca.core.images import write_texture_srgb
from cnca.judge.naturalness import naturalness, of_run, total_variation


class Half:
    """A scorer that gives every picture one half."""

    def score(self, pictures, prompts):
        return torch.full((len(pictures), len(prompts)), 0.5)


def plain(*color: float) -> torch.Tensor:
    return torch.tensor(color).view(3, 1, 1).expand(3, 64, 64)


def test_a_plain_grey_is_natural_and_without_variation():
    found = naturalness(plain(0.5, 0.5, 0.5), plain(0.5, 0.5, 0.8), "grey", Half())
    assert found.prompt_score == 0.5
    assert found.distance == pytest.approx((0.3**2 / 3) ** 0.5)
    assert found.total_variation == 0
    assert found.real_colours == 1
    assert found.chroma == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize(
    ("color", "real"),
    [
        ((0.6, 0.1, 0.1), 1),  # a car's red
        ((0.95, 0.95, 0.95), 1),
        ((0.03, 0.03, 0.03), 1),
        ((0.0, 1.0, 0.0), 0),  # no pigment does this
        ((1.0, 0.0, 1.0), 0),
    ],
)
def test_colors_that_no_surface_has(color, real):
    assert naturalness(plain(*color), plain(*color), "", Half()).real_colours == real


def test_total_variation_of_stripes():
    stripes = torch.zeros(3, 8, 9)
    stripes[..., ::2] = 1.0
    assert total_variation(stripes) == 1.0
    assert total_variation(stripes.transpose(1, 2)) == 1.0


def test_a_run_is_measured_by_its_textures(tmp_path):
    for name, grey in (("texture.png", 0.2), ("texture_prompt.png", 0.6)):
        write_texture_srgb(tmp_path / name, plain(grey, grey, grey).permute(1, 2, 0).numpy())
    assert of_run(tmp_path, "grey", Half()).distance == pytest.approx(0.4, abs=1e-3)


def test_an_unfinished_run_is_named(tmp_path):
    with pytest.raises(RunError, match=r"no texture\.png; finish the run first"):
        of_run(tmp_path, "grey", Half())
