from functools import partial

import pytest
import torch
from torch import nn

from cnca.core.errors import RunError
from cnca.gen import architecture
from cnca.gen.pipeline import load_pipeline
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.train.generator import corpus
from cnca.train.generator.denoiser import GRID, ImagePrompt
from cnca.train.generator.pipeline import train_generator
from cnca.train.scorer import train_scorer


@pytest.fixture
def pictures(tmp_path):
    return corpus.prepare(tmp_path, count=4, seed=0)


def test_the_untrained_autoencoder_is_a_color_pyramid(pictures):
    images = torch.from_numpy(pictures.pictures.copy()).permute(0, 3, 1, 2) / 127.5 - 1.0
    torch.manual_seed(0)
    vae = architecture.autoencoder().eval()
    with torch.no_grad():
        decoded = vae.decode(vae.encode(images).latent_dist.mean).sample
    small, expected = (nn.functional.avg_pool2d(x, 32).flatten() for x in (decoded, images))
    assert torch.corrcoef(torch.stack([small, expected]))[0, 1] > 0.95


def test_the_corpus_is_painted_once_and_its_pictures_do_not_depend_on_the_count(tmp_path):
    few, more = (corpus.prepare(tmp_path, count=n, seed=3) for n in (2, 4))
    assert (few.pictures == more.pictures[:2]).all()
    assert few.captions == more.captions[:2]
    written = next(tmp_path.glob("pictures-2-3.npy")).stat().st_mtime_ns
    corpus.prepare(tmp_path, count=2, seed=3)
    assert next(tmp_path.glob("pictures-2-3.npy")).stat().st_mtime_ns == written


def test_image_prompts_lie_in_the_box():
    tokens = ImagePrompt()(torch.randn(400, 4, 32, 32, generator=torch.Generator().manual_seed(0)))
    assert tokens.shape == (400, 77, architecture.TEXT_WIDTH)
    assert tokens.abs().max() <= 1.0


def test_each_token_describes_a_cell_of_the_picture():
    rows, columns = GRID
    latents = torch.zeros(1, 4, 2 * rows, 2 * columns)
    latents[:, :, 4:6, 6:8] = 1.0  # row 2, column 3
    heard = (ImagePrompt()(latents) != 0).any(dim=2)[0]
    assert heard.nonzero().flatten().tolist() == [2 * columns + 3]


def test_position_channels_tell_right_from_left_and_down_from_up():
    across, down = architecture.positions(16)
    assert (across.diff(dim=1) > 0).all()
    assert (across.diff(dim=0) == 0).all()
    assert torch.equal(down, across.T)
    assert across.max() == -across.min() == architecture.POSITION_RANGE


def test_the_decoder_disregards_position_channels():
    vae = architecture.autoencoder().eval()
    wider = architecture.with_position_channels(vae)
    latents = torch.randn(1, 6, 8, 8)
    images = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        torch.testing.assert_close(wider.decode(latents).sample, vae.decode(latents[:, :4]).sample)
        means = wider.encode(images).latent_dist.mean
        torch.testing.assert_close(means[:, :4], vae.encode(images).latent_dist.mean)
    assert (means[:, 4:] == 0).all()


def test_the_tokenizer_numbers_letters_in_their_order():
    """Its learner numbers the last letters of words by chance, anew in every process."""
    vocabulary = architecture.word_pieces(["h c f a e b g d"]).get_vocab()
    numbers = [vocabulary[f"{letter}</w>"] for letter in "abcdefgh"]
    assert numbers == sorted(numbers)


def test_the_wider_autoencoder_keeps_the_scale_of_its_latents():
    """diffusers forgets what was set after an autoencoder was made, when another is made of it."""
    vae = architecture.autoencoder()
    vae.register_to_config(scaling_factor=0.8)
    assert architecture.with_position_channels(vae).config["scaling_factor"] == 0.8


def test_training_end_to_end_gives_a_folder_that_paints(tmp_path):
    options = {"pictures": 4, "autoencoder_steps": 1, "denoiser_steps": (1, 1, 1, 1), "batch": 2}
    folder = train_generator(tmp_path, seed=1, **options)
    generator = DiffusionTextureGenerator.load(folder, steps=1)
    assert generator.feature_shape == (77, 128)
    picture = generator.generate(
        generator.encode("red balls"),
        torch.zeros(generator.feature_shape),
        torch.Generator().manual_seed(0),
    )
    assert picture.shape == (3, 256, 256)
    vae, data = load_pipeline(folder).vae, corpus.prepare(tmp_path, count=4, seed=1)
    pictures = torch.from_numpy(data.pictures.copy()).permute(0, 3, 1, 2) / 127.5 - 1.0
    means = vae.encode(pictures).latent_dist.mean[:, : architecture.PICTURE_CHANNELS]
    # half precision of weights and kept latents leaves three digits
    assert (vae.config["scaling_factor"] * means).std() == pytest.approx(1.0, abs=5e-3)


def test_a_folder_that_holds_a_training_is_refused_before_any_work(tmp_path):
    (tmp_path / "autoencoder.pt").touch()
    for train in (train_generator, partial(train_scorer, data=tmp_path / "corpus")):
        with pytest.raises(RunError, match="already holds a training; add --resume or choose"):
            train(tmp_path, resume=False)
    assert [file.name for file in tmp_path.iterdir()] == ["autoencoder.pt"]


def test_resumed_stages_give_the_same_pipeline(tmp_path):
    """All stages are done already but the last, which is done anew."""
    options = {"pictures": 4, "autoencoder_steps": 1, "denoiser_steps": (1, 1, 1, 1), "batch": 2}
    folder = train_generator(tmp_path, seed=1, **options)
    before = {file.name: file.read_bytes() for file in folder.rglob("*.safetensors")}
    (tmp_path / "denoiser-32.pt").unlink()
    train_generator(tmp_path, seed=1, **options)
    assert {file.name: file.read_bytes() for file in folder.rglob("*.safetensors")} == before
