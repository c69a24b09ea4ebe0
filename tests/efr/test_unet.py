import gc

import pytest
import torch

from cnca.core.errors import CncaError
from cnca.core.types import PlainPictures
from cnca.efr.unet import EnvironmentFeatureRenderer, paint_slope, weighted_bce
from cnca.scene.protocols import Residual


def pictures(seed: int, count: int = 1, height: int = 37, width: int = 50) -> torch.Tensor:
    return torch.rand(count, 3, height, width, generator=torch.Generator().manual_seed(seed))


def plain(traced: torch.Tensor) -> list[PlainPictures]:
    """A renderer that draws the plain paint a bit too bright."""
    return [PlainPictures(one, 1.1 * one) for one in traced.split(1)]


def scrambled() -> EnvironmentFeatureRenderer:
    """One that does something everywhere."""
    efr = EnvironmentFeatureRenderer()
    torch.nn.init.normal_(efr.maps.weight)
    return efr


def test_is_the_identity_before_training_at_odd_sizes():
    images = pictures(0, count=2)
    assert torch.equal(EnvironmentFeatureRenderer()(images, plain(pictures(1, count=2))), images)


def test_gloss_and_light_that_a_renderer_leaves_out_come_back():
    """The closed form of the module's docstring, with the network's maps held at one number."""
    efr, paint, own_paint = EnvironmentFeatureRenderer((4, 8)), pictures(0), pictures(1)
    light, gloss = pictures(2), pictures(3)
    with torch.no_grad():
        efr.left_out.fill_(1)
        efr.maps.bias[: len(efr.maps.bias) // 2] = 0.25 - 1
    reference = PlainPictures(0.25 * light * own_paint + gloss, light * own_paint)
    torch.testing.assert_close(efr(light * paint, [reference]), 0.25 * light * paint + gloss)


def test_a_colorful_paint_tells_shadow_from_grey_gloss():
    """Without any training of the maps: X_ren is the truth in every other paint."""
    efr, light, shadow = EnvironmentFeatureRenderer((4, 8)), pictures(0), pictures(1)
    red, gloss = torch.tensor([0.6, 0.1, 0.1]).reshape(1, 3, 1, 1), pictures(2)
    light, shadow, gloss = (x.mean(dim=1, keepdim=True) + 0.5 for x in (light, shadow, gloss))
    with torch.no_grad():
        efr.left_out.fill_(1)
        efr.slope.fill_(1)
    reference = PlainPictures(shadow * light * red + gloss, light * red)
    drawn = light * pictures(3)
    before = (drawn - (shadow * drawn + gloss)).abs().mean()
    error = (efr(drawn, [reference]) - (shadow * drawn + gloss)).abs()
    gain = efr.correction(reference).gain.mean().item()
    assert error.mean() < 0.02 * before  # the prior's pull
    assert gain == pytest.approx(shadow.mean().item(), rel=0.02)


def test_a_grey_paint_tells_nothing():
    grey = pictures(0).mean(dim=1, keepdim=True).expand(-1, 3, -1, -1)
    torch.testing.assert_close(paint_slope(0.3 * grey + 0.1, grey), torch.ones(1, 1, 37, 50))


def test_is_a_residual():
    assert isinstance(EnvironmentFeatureRenderer(), Residual)


def test_learns_a_tint():
    torch.manual_seed(0)
    efr, images, dark = EnvironmentFeatureRenderer((4, 8)), pictures(0), 0.1 * pictures(1)
    truth, reference = images * 0.5, PlainPictures(dark, 2 * dark)
    optimizer = torch.optim.Adam(efr.parameters(), lr=0.02)
    for _ in range(60):
        optimizer.zero_grad()
        (efr(images, [reference]) - truth).abs().mean().backward()
        optimizer.step()
    before = (images - truth).abs().mean()
    assert (efr(images, [reference]) - truth).abs().mean() < 0.2 * before


def test_pictures_are_affine_in_the_render():
    """So a gradient is scaled by the gain, whatever the paint."""
    efr, reference = scrambled(), plain(pictures(1))
    images = (2 + pictures(0)).requires_grad_()
    with torch.no_grad():  # nothing is clipped at 0
        efr.maps.weight *= 1e-3
    efr(images, reference).sum().backward()
    assert images.grad.std() > 1e-4
    torch.testing.assert_close(images.grad, efr.correction(reference[0]).gain)


def test_once_trained_the_same_pictures_and_gradients_come_faster():
    """The gradient by hand is that of autograd, clipped pixels and untouched ones included."""
    efr, found = scrambled(), []
    traced = pictures(1, count=2)
    drawn = traced.clone()
    drawn[0, :, 3:12, 4:18] += 0.1
    drawn[1, :, 20:35, 30:48] *= 0.5
    pairs = zip(traced.split(1), drawn.split(1), strict=True)
    references = [PlainPictures(*pair) for pair in pairs]
    for training in (True, False):
        images = pictures(0, count=2)
        images[0, :, :20] = 0  # at the edge of the clipped
        images.requires_grad_()
        corrected = efr.train(training)(images, references)
        (corrected * pictures(5, count=2)).sum().backward()
        found.append((corrected.detach(), images.grad))
    assert (found[0][0] == 0).any()
    torch.testing.assert_close(found[0], found[1])


def test_what_both_pictures_share_stays_as_it_is():
    """The background, in pictures and in whole ones."""
    efr, images = scrambled(), pictures(0, count=2)
    traced, changed = images.clone(), torch.zeros(2, 1, 37, 50, dtype=torch.bool)
    changed[0, :, 10:21, 5:30] = changed[1, :, 12:25, 8:33] = True
    drawn = torch.where(changed, traced + 0.1, traced)
    pairs = zip(traced.split(1), drawn.split(1), strict=True)
    corrected = efr(images, [PlainPictures(*pair) for pair in pairs])
    different = (corrected != images).any(dim=1, keepdim=True)
    assert not different[~changed].any()
    assert different[changed].float().mean() > 0.9
    nothing = [PlainPictures(one, one) for one in traced.split(1)]
    assert torch.equal(efr(images, nothing), images)


@pytest.mark.parametrize("training", [True, False])
def test_a_picture_is_corrected_alike_whatever_stands_beside_it(training):
    """As in training, where each picture is cut to its vehicle."""
    efr = scrambled().train(training)
    images, traced = pictures(0, count=2), pictures(1, count=2)
    drawn = traced.clone()
    drawn[0, :, 3:12, 4:18] += 0.1
    drawn[1, :, 20:35, 30:48] += 0.1
    pairs = zip(traced.split(1), drawn.split(1), strict=True)
    references = [PlainPictures(*pair) for pair in pairs]
    alone = [efr(images[k : k + 1], references[k : k + 1]) for k in range(2)]
    torch.testing.assert_close(efr(images, references), torch.cat(alone))
    cut = (slice(1, 2), slice(None), slice(20, 35), slice(30, 48))
    found = efr(images[cut], [PlainPictures(traced[cut], drawn[cut])])
    torch.testing.assert_close(found, alone[1][:, *cut[1:]])


def test_a_correction_is_kept_as_long_as_its_reference(monkeypatch):
    efr, looks = scrambled().eval(), []
    inner = efr._maps
    monkeypatch.setattr(efr, "_maps", lambda *given: looks.append(1) or inner(*given))
    (reference,) = plain(pictures(1))
    with torch.no_grad():
        first, again = (efr(pictures(0), [reference]) for _ in range(2))
    assert torch.equal(first, again)
    assert len(looks) == len(efr._kept) == 1
    del reference
    gc.collect()
    assert len(efr._kept) == 0
    efr.train()(pictures(0), plain(pictures(1)))  # in training nothing is kept
    assert len(looks) == 2
    assert len(efr._kept) == 0


def test_training_on_forgets_what_was_kept():
    efr, references = scrambled().eval(), plain(pictures(1))
    with torch.no_grad():
        first = efr(pictures(0), references)
        torch.nn.init.normal_(efr.train().maps.weight)
        assert not torch.equal(efr.eval()(pictures(0), references), first)


def test_saved_weights_come_back(tmp_path):
    torch.manual_seed(1)
    efr = scrambled()
    efr.save(tmp_path / "efr.safetensors")
    images, references = pictures(2, count=2), plain(pictures(3, count=2))
    again = EnvironmentFeatureRenderer.load(tmp_path / "efr.safetensors")
    assert torch.equal(again(images, references), efr(images, references))


def test_other_files_are_refused_in_one_line(tmp_path):
    (tmp_path / "efr.safetensors").write_bytes(b"not weights")
    with pytest.raises(CncaError, match=r"efr\.safetensors: no EFR weights"):
        EnvironmentFeatureRenderer.load(tmp_path / "efr.safetensors")


def test_small_vehicles_weigh_more():
    truth = pictures(4, count=2).clamp(0.1, 0.9)
    wide, narrow = torch.zeros(2, 1, 37, 50), torch.zeros(2, 1, 37, 50)
    wide[..., :40], narrow[..., :10] = 1, 1
    ratio = weighted_bce(truth, truth, narrow) / weighted_bce(truth, truth, wide)
    assert ratio.item() == pytest.approx(4.0, rel=1e-5)
    assert torch.isfinite(weighted_bce(truth, truth, torch.zeros_like(wide)))
