"""Textures of other kinds on the vehicle: a box whose every texel is known."""

import numpy as np
import pytest

from cnca.core.errors import TextureError
from cnca.vehicle.builtin.sedan import BUILTIN_VEHICLES, build_sedan
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.uv.texels import draw_faces, map_texels, project_pattern

SIZE = 64
QUARTERS = np.array([[[1.0, 0, 0], [0, 1.0, 0]], [[0, 0, 1.0], [1.0, 1.0, 1.0]]], np.float32)
RED, GREEN, BLUE, WHITE = QUARTERS.reshape(4, 3)
"""Top left, top right, bottom left, bottom right of a pattern."""


def square(origin, right, up, uv, normal):
    """A square of 2 m; its UVs fill a quarter of the texture, right and up as in space."""
    right, up = np.array(right, float), np.array(up, float)
    steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    vertices = np.array(origin, float) + 2 * steps[:, :1] * right + 2 * steps[:, 1:] * up
    return vertices, np.tile(np.array(normal, float), (4, 1)), np.array(uv) + 0.5 * steps


def box() -> Vehicle:
    """Left side, front and roof of a cube of 2 m around the z axis, standing on the ground."""
    sides = [
        square((-1, 1, 0), (1, 0, 0), (0, 0, 1), (0.0, 0.0), (0, 1, 0)),
        square((1, -1, 0), (0, 1, 0), (0, 0, 1), (0.5, 0.0), (1, 0, 0)),
        square((-1, -1, 2), (1, 0, 0), (0, 1, 0), (0.0, 0.5), (0, 0, 1)),
    ]
    vertices, normals, uvs = (np.concatenate(each) for each in zip(*sides, strict=True))
    faces = np.array(
        [[4 * k + i for i in corner] for k in range(3) for corner in ((0, 1, 2), (0, 2, 3))]
    )
    return Vehicle("box", (Part("box", "paint", vertices, faces, normals, uvs),))


def at(image, u, v):
    """The texel at these coordinates."""
    return image[int((1 - v) * SIZE), int(u * SIZE)]


def test_positions_and_normals():
    texels = map_texels(box(), SIZE)
    # The middle of the left side; a texel is 2 m / 32 wide, half of one is the rounding.
    assert at(texels.position, 0.25, 0.25) == pytest.approx([0, 1, 1], abs=0.04)
    assert at(texels.position, 0.75, 0.25) == pytest.approx([1, 0, 1], abs=0.04)
    assert at(texels.position, 0.1, 0.9) == pytest.approx([-0.6, 0.6, 2], abs=0.04)
    assert at(texels.normal, 0.1, 0.9) == pytest.approx([0, 0, 1])
    assert texels.texel_length == pytest.approx(2 / 32)
    assert texels.faces == 6
    assert texels.weights.sum(axis=-1) == pytest.approx(1)


def test_texels_off_the_charts_show_the_nearest_point_on_one():
    texels = map_texels(box(), SIZE)
    assert at(texels.position, 0.95, 0.51) == pytest.approx([1, 0.8, 2], abs=0.07)


@pytest.mark.parametrize(
    ("u", "v", "axes"),
    [
        # u, v of a point on the left side (right is x, up is z), the front (y, z), the roof (x, y)
        (0.30, 0.05, (0.2, 0.2)),
        (0.80, 0.05, (0.2, 0.2)),
        (0.30, 0.80, (0.2, 0.2)),
    ],
)
def test_a_pattern_of_two_metres_lies_along_the_axes(u, v, axes):
    """Its lower left quarter begins at the origin: blue up to 1 m in both directions."""
    drawn = project_pattern(map_texels(box(), SIZE), np.kron(QUARTERS, np.ones((8, 8, 1), "f")), 2)
    assert at(drawn, u, v) == pytest.approx(BLUE)
    step = 0.25  # 1 m to the right
    assert at(drawn, u - step, v) == pytest.approx(
        WHITE
    )  # one metre to the left is as to the right
    assert at(drawn, u - 0.04 * 2 - 0.01, v) == pytest.approx(WHITE)


def test_rows_of_a_pattern_run_down():
    drawn = project_pattern(map_texels(box(), SIZE), np.kron(QUARTERS, np.ones((8, 8, 1), "f")), 2)
    assert at(drawn, 0.3, 0.05) == pytest.approx(BLUE)
    assert at(drawn, 0.3, 0.30) == pytest.approx(RED)
    assert at(drawn, 0.2, 0.30) == pytest.approx(GREEN)


def test_a_pattern_repeats():
    """Every half metre the same: texels that lie 8 apart are equal."""
    pattern = np.random.default_rng(0).random((16, 16, 3)).astype(np.float32)
    texels = map_texels(box(), SIZE)
    drawn = project_pattern(texels, pattern, 0.5)
    # Texels whose centre lies beyond their triangle show its border instead.
    inside = texels.weights.min(axis=-1) > 0
    side, inside = (each[SIZE // 2 :, : SIZE // 2] for each in (drawn, inside))
    assert inside.mean() > 0.9
    for axis in (0, 1):
        same = np.roll(inside, 8, axis) & inside
        assert np.roll(side, 8, axis)[same] == pytest.approx(side[same], abs=1e-4)
    assert side.std() > 0.05


def test_a_pattern_finer_than_texels_is_averaged():
    checks = np.indices((64, 64)).sum(axis=0) % 2
    fine = np.repeat(checks[..., None], 3, axis=2).astype(np.float32)
    drawn = project_pattern(map_texels(box(), SIZE), fine, 0.125)
    assert drawn == pytest.approx(0.5, abs=0.01)


def test_colors_of_faces():
    colors = np.random.default_rng(0).random((6, 3)).astype(np.float32)
    drawn = draw_faces(map_texels(box(), SIZE), colors)
    assert at(drawn, 0.4, 0.1) == pytest.approx(colors[0])
    assert at(drawn, 0.1, 0.4) == pytest.approx(colors[1])
    assert at(drawn, 0.9, 0.1) == pytest.approx(colors[2])


def test_cubes_of_colors_are_read_at_the_barycentric_coordinates():
    """A cube whose value is its index: near a corner of the triangle that axis is at its end."""
    cubes = np.zeros((1, 6, 4, 4, 4, 3), np.float32)
    index = np.indices((4, 4, 4)) / 3
    cubes[..., :] = np.moveaxis(index, 0, -1)
    drawn = draw_faces(map_texels(box(), SIZE), cubes)
    assert at(drawn, 0.02, 0.005) == pytest.approx([1, 0, 0])
    assert at(drawn, 0.49, 0.01) == pytest.approx([0, 1, 0])
    assert at(drawn, 0.49, 0.45) == pytest.approx([0, 0, 1])


@pytest.mark.parametrize(
    ("colors", "words"),
    [
        (np.zeros((5, 3)), "has 6 faces"),
        (np.zeros((6, 4)), "has 6 faces"),
        (np.zeros((6, 2, 2, 3, 3)), "has 6 faces"),
        (np.zeros(6), "has 6 faces"),
        (np.full((6, 3), -0.5), r"span \[-0.5, -0.5\]"),
        (np.full((6, 3), np.nan), "span"),
    ],
)
def test_wrong_colors_are_refused(colors, words):
    with pytest.raises(TextureError, match=words):
        draw_faces(map_texels(box(), SIZE), colors)


@pytest.mark.parametrize(("shape", "side"), [((4, 6, 3), 1.0), ((4, 4, 3), 0.0), ((4, 4, 3), -1.0)])
def test_wrong_patterns_are_refused(shape, side):
    with pytest.raises(TextureError, match="pattern"):
        project_pattern(map_texels(box(), SIZE), np.zeros(shape, np.float32), side)


def test_a_pattern_does_not_jump_at_seams_of_the_atlas():
    """Two texels of the sedan that show nearly the same point and face alike look alike."""
    vehicle = build_sedan(BUILTIN_VEHICLES["sedan"], "sedan")
    texels = map_texels(vehicle, 256)
    waves = (0.5 + 0.5 * np.sin(np.indices((64, 64)) / 64 * 2 * np.pi)).transpose(1, 2, 0)
    pattern = np.concatenate([waves, waves[..., :1]], axis=2).astype(np.float32)
    drawn = project_pattern(texels, pattern, 1.0)
    facing = np.abs(texels.normal).argmax(axis=-1)
    expected = 0.5 + 0.5 * np.sin(2 * np.pi * texels.position)
    for axis, (right, _) in enumerate(((1, 2), (0, 2), (0, 1))):
        on = facing == axis
        # Columns hold the second channel of the waves; a pixel is 1/64 of the period or coarser.
        assert np.abs(drawn[on][:, 1] - expected[on][:, right]).mean() < 2 * np.pi / 64
