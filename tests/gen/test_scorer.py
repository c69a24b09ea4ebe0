"""Prompt scorers: the shipped kind learns and keeps, CLIP agrees with its own code."""

import json
from pathlib import Path

import pytest
import torch
from transformers import CLIPConfig, CLIPModel, CLIPTokenizer

from cnca.core.errors import GeneratorError
from cnca.gen import architecture, scorer
from cnca.gen.clip_scorer import DEVIATION, MEAN
from cnca.gen.scorer import BagScorer, load_scorer, right_prompts, words
from cnca.train import scorer as train_scorer

COLORS = {"red": (1.0, 0, 0), "green": (0, 1.0, 0), "blue": (0, 0, 1.0), "white": (1.0, 1, 1)}


def plain(color: str) -> torch.Tensor:
    return torch.tensor(COLORS[color]).view(3, 1, 1).expand(3, 64, 64)


def test_words_are_lower_case_letters():
    assert words("Yellow-Black graffiti, 2!") == ["yellow", "black", "graffiti"]


def test_a_scorer_learns_colors_and_comes_back_from_its_file(tmp_path):
    torch.manual_seed(0)
    model = BagScorer([*COLORS, "paint"])
    pictures = torch.stack([plain(name) for name in COLORS])
    prompts = [f"{name} paint" for name in COLORS]
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    for _ in range(60):
        optimizer.zero_grad()
        train_scorer.contrastive_loss(model, pictures, prompts).backward()
        optimizer.step()
    model.save(tmp_path / "scorer.safetensors")
    back = load_scorer(tmp_path / "scorer.safetensors")
    cosines = back.score(pictures, prompts)
    assert (cosines.argmax(dim=1) == torch.arange(4)).all()
    torch.testing.assert_close(cosines, model.score(pictures, prompts), atol=0.01, rtol=0)
    unknown_beside = back.score(pictures, ["shiny red paint"])
    assert unknown_beside.argmax() == 0
    with pytest.raises(GeneratorError, match="knows none of its words"):
        back.score(pictures, ["Zèbre"])


def test_loss_of_captions_of_the_same_words():
    """Two pictures of one caption: either answer is right, so the loss is that of two in four."""

    class Fixed(torch.nn.Module):
        log_scale = torch.tensor(0.0)

        def see_pictures(self, pictures):
            return torch.eye(4)

        def read_prompts(self, prompts):
            return torch.zeros(4, 4)

    prompts = ["red paint", "paint red", "blue", "green"]
    loss = train_scorer.contrastive_loss(Fixed(), torch.zeros(4, 3, 8, 8), prompts)
    assert loss.item() == pytest.approx(torch.log(torch.tensor(4.0)).item())


class Perfect:
    """Cosine 1 where the picture's brightness is the prompt's number of words."""

    def score(self, pictures, prompts):
        counts = torch.tensor([float(len(words(p))) for p in prompts])
        return 1 - (pictures.mean(dim=(1, 2, 3))[:, None] - counts).abs()


def test_right_prompts_counts_hits_among_other_words():
    prompts = ["a", "b a", "c b a", "d c b a"]
    pictures = torch.tensor([1.0, 2.0, 3.0, 1.0]).view(4, 1, 1, 1).expand(4, 3, 2, 2)
    assert right_prompts(Perfect(), pictures, prompts, choices=4, seed=0) == [True] * 3 + [False]
    with pytest.raises(GeneratorError, match="4 prompts: too few to choose one of 10"):
        right_prompts(Perfect(), pictures, prompts, choices=10, seed=0)


def test_varied_pictures_keep_their_mean_color():
    pictures = torch.rand(6, 3, 64, 64, generator=torch.Generator().manual_seed(0))
    changed = train_scorer.varied(pictures, torch.Generator().manual_seed(1))
    assert changed.shape == pictures.shape
    assert not torch.equal(changed, pictures)
    means = [p.mean(dim=(2, 3)) for p in (pictures, changed)]
    torch.testing.assert_close(*means, atol=0.01, rtol=0)


@pytest.fixture
def clip_folder(tmp_path) -> Path:
    torch.manual_seed(0)
    tokenizer = architecture.word_pieces(["zebra strips"])
    text = {"vocab_size": len(tokenizer), "hidden_size": 32, "intermediate_size": 32}
    text |= {"num_hidden_layers": 1, "num_attention_heads": 2, "projection_dim": 16}
    text |= {"eos_token_id": tokenizer.eos_token_id, "bos_token_id": tokenizer.bos_token_id}
    vision = {"hidden_size": 32, "intermediate_size": 32, "num_hidden_layers": 1}
    vision |= {"num_attention_heads": 2, "image_size": 32, "patch_size": 8, "projection_dim": 16}
    config = CLIPConfig(text_config=text, vision_config=vision, projection_dim=16)
    CLIPModel(config).save_pretrained(tmp_path / "clip")
    tokenizer.save_pretrained(tmp_path / "clip")
    return tmp_path / "clip"


def test_clip_agrees_with_transformers(clip_folder):
    pictures = torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    prompts = ["zebra", "zebra strips zebra"]
    found = load_scorer(clip_folder).score(pictures, prompts)
    model = CLIPModel.from_pretrained(clip_folder).eval()
    inputs = CLIPTokenizer.from_pretrained(clip_folder)(prompts, padding=True, return_tensors="pt")
    mean, deviation = (torch.tensor(v).view(3, 1, 1) for v in (MEAN, DEVIATION))
    with torch.no_grad():
        output = model(**inputs, pixel_values=(pictures - mean) / deviation)
    expected = output.logits_per_image / model.logit_scale.exp()
    torch.testing.assert_close(found, expected, atol=1e-6, rtol=1e-5)


def test_clip_refuses_long_prompts(clip_folder):
    with pytest.raises(GeneratorError, match="shorten it"):
        load_scorer(clip_folder).score(torch.zeros(1, 3, 32, 32), ["zebra " * 90])


def test_other_files_and_folders_are_refused_in_one_line(tmp_path, clip_folder):
    notes = tmp_path / "notes.safetensors"
    notes.write_text("no tensors\n" * 3)
    (tmp_path / "empty").mkdir()
    other = clip_folder / "config.json"
    other.write_text(json.dumps(json.loads(other.read_text()) | {"model_type": "bert"}))
    for path in (notes, tmp_path / "missing.safetensors", tmp_path / "empty", clip_folder):
        with pytest.raises(GeneratorError) as caught:
            load_scorer(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.skipif(not scorer.SHIPPED_SCORER.exists(), reason="the scorer is not trained yet")
def test_the_shipped_scorer_is_small_and_picks_the_prompts_of_unseen_textures():
    assert scorer.SHIPPED_SCORER.stat().st_size < 2e6
    pictures, captions = train_scorer.held_out_textures(40, seed=1)
    hits = right_prompts(load_scorer(), pictures, captions, choices=10, seed=1)
    # Of 40 draws with a chance of 0.9 or more, fewer than 31 have a probability of 1 %.
    assert sum(hits) >= 31
