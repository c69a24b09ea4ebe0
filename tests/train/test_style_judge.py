"""Training of the judge of style: its pictures, their variations, and the file that comes out."""

import json

import torch

from cnca.gen.palettes import COLOR_WORDS
from cnca.gen.textures import STYLES
from cnca.judge.style import SIDE, StyleJudge
from cnca.train.generator import corpus
from cnca.train.loop import TrainingState
from cnca.train.style_judge import StyleJudgeTask, labels, train_style_judge, varied

SMALL = {"pictures": 8, "steps": 2, "batch": 4, "held_out": 4}


def test_end_to_end_twice_the_same(tmp_path):
    first, second = (train_style_judge(tmp_path / name, **SMALL) for name in ("a", "b"))
    assert first.file.read_bytes() == second.file.read_bytes()
    assert first.pictures == 4
    assert 0 <= first.style <= 1
    shares = StyleJudge.load(first.file).judge(torch.rand(3, 64, 64), ["zebra", "plaid"])
    torch.testing.assert_close(shares.sum(), torch.tensor(1.0))
    manifest = json.loads((tmp_path / "a" / "manifest.json").read_text())
    assert manifest["job"] == "train-style-judge"


def test_its_pictures_are_not_those_of_the_generator(tmp_path):
    train_style_judge(tmp_path, **SMALL)
    ours, tested = (
        corpus.prepare(tmp_path, count=count, seed=seed)
        for count, seed in ((8, 20_011), (4, 40_022))
    )
    assert len(list(tmp_path.glob("pictures-*.npy"))) == 2  # none was painted anew
    theirs = corpus.prepare(tmp_path / "generator", count=8, seed=0)
    for first, second in ((ours, theirs), (ours, tested), (tested, theirs)):
        assert not any((a == b).all() for a in first.pictures for b in second.pictures)


def test_labels_say_pattern_and_colors():
    styles, colors = labels(["large yellow black graffiti", "zebra texture"])
    assert [list(STYLES)[style] for style in styles] == ["graffiti", "zebra"]
    named = [{w for w, on in zip(COLOR_WORDS, row, strict=True) if on} for row in colors]
    assert named == [{"yellow", "black"}, {"black", "white"}]


def test_variations_are_pictures_and_follow_from_their_generator():
    pictures = torch.rand(4, 3, 128, 128, generator=torch.Generator().manual_seed(9))
    for seed in range(8):
        first, second = (varied(pictures, torch.Generator().manual_seed(seed)) for _ in range(2))
        assert torch.equal(first, second)
        assert first.shape == (4, 3, SIDE, SIDE)
        assert first.min() >= 0
        assert first.max() <= 1
    assert not torch.equal(first, varied(pictures, torch.Generator().manual_seed(99)))


def test_a_few_steps_on_the_same_batch_lower_the_loss(tmp_path, monkeypatch):
    torch.manual_seed(0)
    task = StyleJudgeTask(corpus.prepare(tmp_path, count=8, seed=0), steps=200, batch=8)
    batch = task.batch(0, torch.Generator().manual_seed(0))
    monkeypatch.setattr(task, "batch", lambda step, rng: batch)
    state = TrainingState(task, seed=0)
    losses = [state.step(99) for _ in range(10)]  # where the step size is the largest
    assert losses[-1] < 0.6 * losses[0]
