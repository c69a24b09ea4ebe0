import pytest
import torch

from cnca.efr.unet import EnvironmentFeatureRenderer, weighted_bce
from cnca.errors import CncaError
from cnca.protocols import Residual
from cnca.types import PlainPictures


def pictures(seed: int, height: int = 37, width: int = 50) -> torch.Tensor:
    return torch.rand(2, 3, height, width, generator=torch.Generator().manual_seed(seed))


def plain(traced: torch.Tensor) -> PlainPictures:
    """A renderer that draws the plain paint a bit too bright."""
    return PlainPictures(traced, 1.1 * traced)


def test_is_the_identity_before_training_at_odd_sizes():
    images = pictures(0)
    assert torch.equal(EnvironmentFeatureRenderer()(images, plain(pictures(1))), images)


def test_gloss_and_light_that_a_renderer_leaves_out_come_back():
    """The closed form of the module's docstring, with the network's maps held at one number."""
    efr, paint, own_paint = EnvironmentFeatureRenderer((4, 8)), pictures(0), pictures(1)
    light, gloss = pictures(2), pictures(3)
    with torch.no_grad():
        efr.left_out.fill_(1)
        efr.maps.bias[: len(efr.maps.bias) // 2] = 0.25 - 1
    reference = PlainPictures(0.25 * light * own_paint + gloss, light * own_paint)
    torch.testing.assert_close(efr(light * paint, reference), 0.25 * light * paint + gloss)


def test_is_a_residual():
    assert isinstance(EnvironmentFeatureRenderer(), Residual)


def test_learns_a_tint():
    torch.manual_seed(0)
    efr, images, dark = EnvironmentFeatureRenderer((4, 8)), pictures(0), 0.1 * pictures(1)
    truth, reference = images * 0.5, PlainPictures(dark, 2 * dark)
    optimizer = torch.optim.Adam(efr.parameters(), lr=0.02)
    for _ in range(60):
        optimizer.zero_grad()
        (efr(images, reference) - truth).abs().mean().backward()
        optimizer.step()
    before = (images - truth).abs().mean()
    assert (efr(images, reference) - truth).abs().mean() < 0.2 * before


def test_what_both_pictures_share_stays_as_it_is():
    """The background, in pictures and in whole ones."""
    efr, images = EnvironmentFeatureRenderer(), pictures(0)
    torch.nn.init.normal_(efr.maps.weight)
    reference, changed = images.clone(), torch.zeros(2, 1, 37, 50, dtype=torch.bool)
    changed[0, :, 10:21, 5:30] = changed[1, :, 12:25, 8:33] = True
    reference = torch.where(changed, reference + 0.1, reference)
    corrected = efr(images, plain(reference))
    different = (corrected != images).any(dim=1, keepdim=True)
    assert not different[~changed].any()
    assert different[changed].float().mean() > 0.9
    assert torch.equal(efr(images, plain(images)), images)


def test_a_picture_is_corrected_alike_whatever_stands_beside_it():
    """As in training, where each picture is cut to its vehicle."""
    efr, images, reference = EnvironmentFeatureRenderer(), pictures(0), pictures(0)
    torch.nn.init.normal_(efr.maps.weight)
    reference[0, :, 3:12, 4:18] += 0.1
    reference[1, :, 20:35, 30:48] += 0.1
    alone = [efr(images[k : k + 1], plain(reference[k : k + 1])) for k in range(2)]
    torch.testing.assert_close(efr(images, plain(reference)), torch.cat(alone))
    cut = (slice(1, 2), slice(None), slice(20, 35), slice(30, 48))
    torch.testing.assert_close(efr(images[cut], plain(reference[cut])), alone[1][:, *cut[1:]])


def test_saved_weights_come_back(tmp_path):
    torch.manual_seed(1)
    efr = EnvironmentFeatureRenderer()
    torch.nn.init.normal_(efr.maps.weight)
    efr.save(tmp_path / "efr.safetensors")
    images, reference = pictures(2), plain(pictures(3))
    again = EnvironmentFeatureRenderer.load(tmp_path / "efr.safetensors")
    assert torch.equal(again(images, reference), efr(images, reference))


def test_other_files_are_refused_in_one_line(tmp_path):
    (tmp_path / "efr.safetensors").write_bytes(b"not weights")
    with pytest.raises(CncaError, match=r"efr\.safetensors: no EFR weights"):
        EnvironmentFeatureRenderer.load(tmp_path / "efr.safetensors")


def test_small_vehicles_weigh_more():
    truth = pictures(4).clamp(0.1, 0.9)
    wide, narrow = torch.zeros(2, 1, 37, 50), torch.zeros(2, 1, 37, 50)
    wide[..., :40], narrow[..., :10] = 1, 1
    ratio = weighted_bce(truth, truth, narrow) / weighted_bce(truth, truth, wide)
    assert ratio.item() == pytest.approx(4.0, rel=1e-5)
    assert torch.isfinite(weighted_bce(truth, truth, torch.zeros_like(wide)))
