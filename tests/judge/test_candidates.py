"""Candidates by name, and the controls that go with them."""

import numpy as np
import pytest
import torch

from cnca.core.color import srgb_to_linear
from cnca.core.errors import TextureError
from cnca.core.images import write_texture_srgb
from cnca.judge.candidates import (
    CONTROLS,
    controls_of,
    make_coats,
    named,
    parse_candidates,
    read_candidate,
)
from cnca.scene.paint import Paint
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES, build_sedan
from cnca.vehicle.uv.texels import map_texels, project_pattern

PAINT = Paint(torch.full((3, 32, 32), 0.5), torch.ones(1, 32, 32))


@pytest.mark.parametrize(
    ("spec", "pair"),
    [
        ("a.png", (None, "a.png")),
        ("DTA=x/a.png", ("DTA", "x/a.png")),
        ("dir/a=b.png", (None, "dir/a=b.png")),
        ("n=a=b.png", ("n", "a=b.png")),
    ],
)
def test_names(spec, pair):
    assert named(spec) == pair


@pytest.mark.parametrize(
    ("specs", "words"),
    [
        (["a.png", "x/a.png"], "the name 'a' is taken"),
        (["normal=a.png"], "the name 'normal' is taken"),
        (["my car=a.png"], "letters and digits"),
        (["=a.png"], "letters and digits"),
    ],
)
def test_names_that_would_be_mixed_up_are_refused(specs, words):
    with pytest.raises(TextureError, match=words):
        parse_candidates(specs)


def test_a_runs_folder_brings_its_prompt(tmp_path):
    folder = tmp_path / "zebra"
    for name in ("texture.png", "texture_prompt.png"):
        write_texture_srgb(folder / name, np.zeros((4, 4, 3), np.float32))
    (run,) = parse_candidates([str(folder)])
    assert (run.name, run.picture) == ("zebra", folder / "texture.png")
    assert run.prompt_picture == folder / "texture_prompt.png"
    (plain,) = parse_candidates([str(folder / "texture.png")])
    assert plain.prompt_picture is None


def coats(seed=0, **more):
    chance = torch.Generator().manual_seed(0)
    textures = {name: torch.rand(3, 32, 32, generator=chance) for name in ("A", "B")}
    prompts = {"prompt": torch.zeros(3, 8, 8), "A prompt": torch.ones(3, 8, 8)}
    return make_coats(PAINT, textures, prompts, seed=seed, **more), textures


def test_rows_and_what_each_candidate_is_compared_with():
    rows = list(coats()[0])
    assert rows == [
        "normal", "uniform", "random", "prompt", "A prompt", "A shuffled", "A mirrored",
        "A mean", "A",
        "B shuffled", "B mirrored", "B mean", "B",
    ]  # fmt: skip
    common, of_its_own = ["normal", "uniform", "random", "prompt"], CONTROLS[-3:]
    assert controls_of("A", rows, ["A", "B"]) == [
        *common,
        "A prompt",
        *(f"A {c}" for c in of_its_own),
    ]
    assert controls_of("B", rows, ["A", "B"]) == [*common, *(f"B {c}" for c in of_its_own)]
    assert list(coats(wanted=())[0]) == ["normal", "A", "B"]
    assert list(coats(wanted=("random",))[0]) == ["normal", "random", "A", "B"]


def test_controls_change_with_the_weather_and_candidates_do_not():
    made, textures = coats()
    for name in ("uniform", "random", "A shuffled"):
        assert not torch.equal(made[name](0), made[name](1))
        assert torch.equal(made[name](1), coats()[0][name](1))
        assert not torch.equal(made[name](1), coats(seed=1)[0][name](1))
    assert torch.equal(made["A"](0), made["A"](1))
    assert torch.allclose(made["A"](0), srgb_to_linear(textures["A"]), atol=1e-6)
    assert torch.allclose(made["normal"](0), srgb_to_linear(PAINT.base))


def test_shuffling_keeps_the_palette():
    made, _ = coats()
    one, other = (made[name](0).flatten(1).T for name in ("A", "A shuffled"))
    assert torch.allclose(one.sort(dim=0).values, other.sort(dim=0).values, atol=1e-6)


SEDAN = build_sedan(BUILTIN_VEHICLES["sedan"], "sedan")
FACES = sum(len(part.faces) for part in SEDAN.parts if part.material == "paint")


def read(spec):
    (candidate,) = parse_candidates([spec])
    return candidate, read_candidate(candidate, SEDAN, 64)


def test_a_picture_is_taken_as_it_is_and_a_pattern_is_projected(tmp_path):
    chance = np.random.default_rng(0)
    picture = (chance.integers(0, 256, (8, 8, 3)) / 255).astype(np.float32)
    write_texture_srgb(tmp_path / "p.png", picture)
    candidate, texture = read(str(tmp_path / "p.png"))
    assert (candidate.name, candidate.side) == ("p", None)
    assert torch.equal(texture, torch.from_numpy(picture).permute(2, 0, 1))
    candidate, texture = read(f"DTA={tmp_path / 'p.png'}@0.5m")
    assert (candidate.name, candidate.side) == ("DTA", 0.5)
    expected = project_pattern(map_texels(SEDAN, 64), picture, 0.5)
    assert torch.equal(texture, torch.from_numpy(expected).permute(2, 0, 1))


def test_colors_of_faces_come_from_an_array(tmp_path):
    np.save(tmp_path / "FCA.npy", np.full((1, FACES, 2, 2, 2, 3), 0.25))
    _, texture = read(str(tmp_path / "FCA.npy"))
    assert texture.shape == (3, 64, 64)
    assert (texture == 0.25).all()


def test_arrays_and_patterns_that_do_not_fit_name_their_file(tmp_path):
    np.save(tmp_path / "few.npy", np.zeros((5, 3)))
    with pytest.raises(TextureError, match=r"few\.npy: .* has \d+ faces"):
        read(str(tmp_path / "few.npy"))
    (tmp_path / "text.npy").write_text("no array")
    with pytest.raises(TextureError, match=r"text\.npy: cannot be read as \.npy"):
        read(str(tmp_path / "text.npy"))
    with pytest.raises(TextureError, match="gone"):
        read(str(tmp_path / "gone.npy"))
    write_texture_srgb(tmp_path / "wide.png", np.zeros((4, 6, 3), np.float32))
    with pytest.raises(TextureError, match=r"wide\.png: .*cut it to a square"):
        read(f"{tmp_path / 'wide.png'}@1m")
