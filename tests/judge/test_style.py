"""The judge of style reads prompts, keeps out of every loss, and is right about what it knows."""

import ast
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

import cnca
from cnca.core.errors import GeneratorError
from cnca.gen.palettes import COLOR_WORDS
from cnca.gen.textures import PAPER_PROMPTS, STYLES, draw
from cnca.judge.style import SHIPPED_JUDGE, TEN_PROMPTS, WINDOW, StyleJudge, meaning, windows

ROOMS_OF_AN_ATTACK = ("core", "scene", "vehicle", "world", "effects", "mi_bridge", "gen", "efr")
ROOMS_OF_AN_ATTACK += ("detect", "attack")


@pytest.fixture(scope="module")
def shipped():
    return StyleJudge.load()


def knows_the_judge(source: str) -> bool:
    """Whether a source imports it, inside functions too, or names the file of its weights."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return any("style_judge" in name or "judge.style" in name for name in found)


def test_no_room_that_an_attack_is_made_of_knows_the_judge():
    """Neither by import nor by the file of its weights; build.py makes the attack's parts."""
    package = Path(cnca.__file__).parent
    files = [file for room in ROOMS_OF_AN_ATTACK for file in (package / room).rglob("*.py")]
    files += [package / "build.py"]
    assert len(files) > 100
    assert [file for file in files if knows_the_judge(file.read_text())] == []


@pytest.mark.parametrize(
    "source",
    ["def f():\n    from cnca.judge.style import StyleJudge", 'load("assets/style_judge/a")'],
)
def test_a_file_that_knows_the_judge_is_seen(source):
    assert knows_the_judge(source)


def test_its_answers_carry_no_gradient(shipped):
    texture = torch.rand(3, 64, 64, requires_grad=True)
    assert not shipped.judge(texture, TEN_PROMPTS).requires_grad


@pytest.mark.parametrize(
    ("prompt", "style", "colors"),
    [
        ("zebra strips", "zebra", {"black", "white"}),
        ("black white stripes", "stripes", {"black", "white"}),
        ("Large Yellow-Black GRAFFITI!", "graffiti", {"yellow", "black"}),
        ("snake texture", "snake", {"green", "brown"}),
        ("a snake", "snake", {"green", "brown"}),
        ("colorful balls", "balls", {"colorful"}),
        ("forest camouflage texture", "camouflage", {"forest"}),
    ],
)
def test_reads_prompts(prompt, style, colors):
    read = meaning(prompt)
    assert list(STYLES)[read.style] == style
    assert {w for w, there in zip(COLOR_WORDS, read.colors, strict=True) if there} == colors


def test_the_ten_prompts_are_the_papers_six_and_four_that_mean_something_else():
    assert set(PAPER_PROMPTS) < set(TEN_PROMPTS)
    meant = {(read.style, *read.colors.tolist()) for read in map(meaning, TEN_PROMPTS)}
    assert len(meant) == len(TEN_PROMPTS) == 10


def test_a_prompt_without_a_pattern_is_refused():
    with pytest.raises(GeneratorError, match="'red zebr': names no pattern .* 'zebra'"):
        meaning("red zebr")


def test_shares_are_those_of_both_classifiers():
    """By hand: a judge whose logits are its biases, whatever it sees."""
    judge = StyleJudge().eval()
    torch.manual_seed(0)
    for head in (judge.style, judge.colors):
        head.weight.data.zero_()
        head.bias.data.normal_()
    prompts = ["yellow black graffiti", "colorful balls"]
    probability = judge.style.bias.softmax(dim=0)
    there = judge.colors.bias.sigmoid()
    joint = []
    for prompt in map(meaning, prompts):
        words = torch.where(prompt.colors > 0, there, 1 - there)
        joint.append(probability[prompt.style] * words.prod())
    expected = torch.stack(joint) / sum(joint)
    torch.testing.assert_close(judge.judge(torch.rand(3, 300, 300), prompts), expected.detach())


@pytest.mark.parametrize(("side", "count"), [(64, 1), (256, 1), (300, 4), (512, 9), (1024, 49)])
def test_windows_cover_a_texture(side, count):
    places = torch.arange(side * side, dtype=torch.float32).reshape(1, side, side).expand(3, -1, -1)
    cuts = windows(places)
    assert len(cuts) == count
    assert cuts.shape[-1] == min(side, WINDOW)
    assert len(cuts[:, 0].unique()) == side * side


def test_what_is_saved_comes_back(tmp_path):
    torch.manual_seed(0)
    judge = StyleJudge().eval()
    judge.save(tmp_path / "judge.safetensors")
    texture = torch.rand(3, 96, 96)
    expected = judge.judge(texture, TEN_PROMPTS)
    again = StyleJudge.load(tmp_path / "judge.safetensors").judge(texture, TEN_PROMPTS)
    torch.testing.assert_close(again, expected, atol=5e-3, rtol=0)


@pytest.mark.parametrize("fault", ["cut", "other", "nan", "missing"])
def test_other_files_are_refused(tmp_path, fault):
    path = tmp_path / "judge.safetensors"
    StyleJudge().save(path)
    if fault == "cut":
        path.write_bytes(path.read_bytes()[:-10])
    elif fault == "other":
        save_file({"a": torch.zeros(1)}, path)
    elif fault == "missing":
        path.unlink()
    else:
        from safetensors import safe_open

        with safe_open(path, "pt") as file:
            known = file.metadata()
        weights = load_file(path)
        weights["style.bias"][0] = float("nan")
        save_file(weights, path, known)
    with pytest.raises(GeneratorError, match="no judge of style .*; give a file of cnca train"):
        StyleJudge.load(path)


def test_the_shipped_judge_is_small():
    assert SHIPPED_JUDGE.stat().st_size <= 2_000_000


@pytest.mark.parametrize("factor", [1, 2])
def test_the_shipped_judge_knows_freshly_painted_textures(shipped, factor):
    """256² and 512², of the same patterns twice as large or four of them side by side."""
    cases = {
        "colorful graffiti": ("graffiti", "colorful"),
        "yellow black graffiti": ("graffiti", "yellow black"),
        "colorful camouflage": ("camouflage", "colorful"),
        "colorful balls": ("balls", "colorful"),
        "snake texture": ("snake", ""),
        "zebra strips": ("zebra", ""),
        "green camouflage": ("camouflage", "green"),
        "black white stripes": ("stripes", "black white"),
        "orange black leopard": ("leopard", "orange black"),
        "blue waves": ("waves", "blue"),
    }
    assert set(cases) == set(TEN_PROMPTS)
    right = 0
    for prompt, (style, colors) in cases.items():
        for seed in range(4):
            picture = draw(style, colors, "", np.random.default_rng(90 + seed))
            texture = torch.from_numpy(picture).permute(2, 0, 1).float().clamp(0, 1)
            shares = shipped.judge(texture.repeat(1, factor, factor), TEN_PROMPTS)
            right += TEN_PROMPTS[shares.argmax()] == prompt
    assert right >= 34  # of 40; one of ten by chance


def test_tints_and_crops_do_not_change_its_mind(shipped):
    picture = draw("zebra", "", "", np.random.default_rng(7))
    texture = torch.from_numpy(picture).permute(2, 0, 1).float().clamp(0, 1)
    tint = torch.tensor([0.85, 1.0, 0.9])[:, None, None]
    for changed in (texture[:, 40:, :216], texture * tint, texture.flip(2), texture * 0.8 + 0.1):
        assert TEN_PROMPTS[shipped.judge(changed, TEN_PROMPTS).argmax()] == "zebra strips"
