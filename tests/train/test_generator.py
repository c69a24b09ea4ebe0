from functools import partial

import pytest
import torch
from torch import nn

from cnca.core.errors import NonFiniteError, RunError
from cnca.gen import architecture
from cnca.gen.pipeline import load_pipeline
from cnca.gen.sampling import DiffusionTextureGenerator
from cnca.train import corpus
from cnca.train.denoiser import GRID, ImagePrompt
from cnca.train.generator import train_generator
from cnca.train.loop import TrainingLoop
from cnca.train.scorer import train_scorer


@pytest.fixture
def pictures(tmp_path):
    return corpus.prepare(tmp_path, count=4, seed=0)


def test_the_untrained_autoencoder_is_a_colour_pyramid(pictures):
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


class Line(nn.Module):
    def __init__(self):
        super().__init__()
        self.slope = nn.Parameter(torch.zeros(3))

    def loss(self, generator: torch.Generator) -> torch.Tensor:
        x = torch.randn(16, 3, generator=generator)
        return ((x @ self.slope - x @ torch.tensor([1.0, -2.0, 0.5])) ** 2).mean()


def fit(folder, steps, *, resume=False, seed=0):
    line = Line()
    loop = TrainingLoop(folder, seed, resume, save_every=5, warm_up=3)
    averaged = loop.run("line", line, line.loss, steps=steps, learning_rate=0.1, average=0.9)
    return line.slope.detach(), averaged.slope.detach()


def test_the_loop_finds_the_minimum(tmp_path):
    _, averaged = fit(tmp_path, 200)
    torch.testing.assert_close(averaged, torch.tensor([1.0, -2.0, 0.5]), atol=0.02, rtol=0.0)


def test_an_interrupted_run_goes_on_as_if_it_had_not_been(tmp_path, monkeypatch):
    (tmp_path / "whole").mkdir()
    (tmp_path / "broken").mkdir()
    whole = fit(tmp_path / "whole", 20)
    honest = Line.loss
    calls = iter(range(100))

    def breaks_at_12(self, generator):
        if next(calls) == 12:
            raise KeyboardInterrupt
        return honest(self, generator)

    monkeypatch.setattr(Line, "loss", breaks_at_12)
    with pytest.raises(KeyboardInterrupt):
        fit(tmp_path / "broken", 20)
    resumed = fit(tmp_path / "broken", 20, resume=True)
    assert next(calls) == 12 + 1 + (20 - 10)  # it went on from the checkpoint at step 10
    for one, other in zip(whole, resumed, strict=True):
        torch.testing.assert_close(one, other)


def test_a_loss_that_is_not_finite_stops_the_training_and_says_where(tmp_path):
    loop = TrainingLoop(tmp_path, 0, False)
    with pytest.raises(NonFiniteError, match="the loss of line is nan at step 0"):
        loop.run(
            "line",
            Line(),
            lambda _: torch.tensor(float("nan")),
            steps=3,
            learning_rate=0.1,
            average=0.9,
        )


def test_a_folder_that_holds_a_training_is_refused_before_any_work(tmp_path):
    fit(tmp_path, 5)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    for train in (train_generator, partial(train_scorer, data=tmp_path / "corpus")):
        with pytest.raises(RunError, match="already holds a training; add --resume or choose"):
            train(tmp_path, resume=False)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_damaged_checkpoint_is_refused(tmp_path):
    fit(tmp_path, 5)
    (tmp_path / "line.pt").write_bytes((tmp_path / "line.pt").read_bytes()[:-100])
    with pytest.raises(RunError, match="line.pt: not a checkpoint of this model; remove it"):
        fit(tmp_path, 10, resume=True)


def test_a_checkpoint_of_another_model_is_refused(tmp_path):
    torch.save({"step": 3, "model": {}, "averaged": {}, "optimizer": {}}, tmp_path / "line.pt")
    with pytest.raises(RunError, match="not a checkpoint of this model"):
        fit(tmp_path, 5, resume=True)
