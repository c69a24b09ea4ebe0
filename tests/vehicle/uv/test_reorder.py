"""The unfolded layout: no overlaps, the shape unchanged, panels side by side."""

import numpy as np
import pytest
import trimesh

from cnca.core.errors import MeshError
from cnca.vehicle.builtin.sedan import build_sedan
from cnca.vehicle.mesh.load_mesh import load_vehicle
from cnca.vehicle.mesh.write_mesh import write_obj
from cnca.vehicle.model import Part, Vehicle
from cnca.vehicle.uv import unfold
from cnca.vehicle.uv.layout import measure, seam_length
from cnca.vehicle.uv.masks import pad_mask, paint_mask
from cnca.vehicle.uv.rebake import rebake, shown_in
from cnca.vehicle.uv.reorder import reorder
from cnca.vehicle.uv.skin import Skin


@pytest.fixture(scope="module")
def sedan():
    return build_sedan()


@pytest.fixture(scope="module")
def reordered(sedan):
    return reorder(sedan)


def box(size=(4.0, 2.0, 1.0), cells=8) -> Vehicle:
    """An upright box of square cells without a bottom: it unfolds without any stretch."""
    grids = []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1)):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        u, v = np.meshgrid(*(np.linspace(-0.5, 0.5, cells + 1),) * 2, indexing="ij")
        points = np.zeros((cells + 1, cells + 1, 3))
        points[..., axis], points[..., a], points[..., b] = 0.5 * sign, u, v
        index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
        i, j, k, m = (
            index[r, c].ravel()
            for r, c in (
                (slice(-1), slice(-1)),
                (slice(1, None), slice(-1)),
                (slice(1, None), slice(1, None)),
                (slice(-1), slice(1, None)),
            )
        )
        faces = np.concatenate([np.stack([i, j, k], 1), np.stack([i, k, m], 1)])
        grids.append((points.reshape(-1, 3) * size, faces if sign > 0 else faces[:, ::-1]))
    starts = np.cumsum([0] + [len(points) for points, _ in grids[:-1]])
    vertices = np.concatenate([points for points, _ in grids])
    faces = np.concatenate([f + start for (_, f), start in zip(grids, starts, strict=True)])
    normals = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return Vehicle("box", (Part("box", "paint", vertices, faces, normals, None),))


def test_a_box_unfolds_without_stretch_and_with_four_seams():
    result = reorder(box())
    layout = measure(Skin.of(result.vehicle), result.outside)
    assert result.placed.all()
    assert layout.charts == 5  # a strip of air between them; what meets does so across it
    assert layout.stretch == pytest.approx(1, abs=1e-3)
    # Coordinates are rounded to 1e-7; a cell is at least 1/8 m of some 7 m.
    assert layout.density_spread == pytest.approx(1, abs=4 * 1e-7 * 8 * 7)
    assert layout.overlap == 0
    # Only the four upright edges, 1 m each, cannot lie side by side.  Borders near an end of such
    # an edge, within 2 cm, count too.
    assert layout.seam_length == pytest.approx(4.0, abs=0.3)


def test_a_box_has_its_sides_where_they_belong():
    vehicle = box()
    skin = Skin.of(vehicle)
    outside, placed, flat = unfold.unfold(skin.vertices, skin.faces, np.zeros((0, 3, 3)))
    assert outside.all()
    assert placed.all()
    side = unfold.sides(skin.vertices, skin.faces)
    middle = [flat[side == i].mean(axis=(0, 1)) for i in range(5)]
    top, left, right, nose, tail = middle
    assert left[1] < top[1] < right[1]
    assert nose[0] < top[0] < tail[0]
    crosses = np.linalg.det(flat[:, 1:] - flat[:, :1])
    assert (crosses > 0).all()  # seen from outside, nothing is mirrored


def test_the_shape_stays(sedan, reordered):
    for old, new in zip(sedan.parts, reordered.vehicle.parts, strict=True):
        np.testing.assert_array_equal(old.vertices[old.faces], new.vertices[new.faces])
        np.testing.assert_array_equal(old.normals[old.faces], new.normals[new.faces])
    assert reordered.vehicle.parts[0] is sedan.parts[0]


def test_the_sedan_gains_connection_and_loses_little(sedan, reordered):
    before, after = (measure(Skin.of(v), reordered.outside) for v in (sedan, reordered.vehicle))
    assert after.seam_length < 0.5 * before.seam_length
    assert after.overlap < 0.01
    assert after.density_spread < 1.3
    assert after.used > 0.25
    corners = Skin.of(reordered.vehicle).corners
    assert corners.min() >= 0
    assert corners.max() <= 1


def test_less_weight_against_shear_lets_charts_follow_the_edge(sedan):
    """The mean gap between corners that the sides and the top share shrinks with it."""
    skin = Skin.of(sedan)
    none = np.zeros((0, 3, 3))
    stiff, soft = (unfold.unfold(skin.vertices, skin.faces, none, shear=s) for s in (10.0, 0.002))
    lengths = []
    for outside, placed, flat in (stiff, soft):
        assert placed.sum() > 0.9 * outside.sum()
        triangles = skin.vertices[skin.faces[placed]]
        lengths.append(seam_length(triangles, flat[placed], 1.0))
    assert lengths[1] < 0.8 * lengths[0]


def test_of_large_faces_behind_one_another_none_share_texels():
    """Wheels as boxes before sides of two triangles: both are seen in most of their area."""
    body = trimesh.creation.box(
        (4.4, 1.6, 1), trimesh.transformations.translation_matrix((0, 0, 0.7))
    )
    places = [(x, y, 0.35) for x in (-1.4, 1.4) for y in (-0.9, 0.9)]
    wheels = [
        trimesh.creation.box((0.7, 0.3, 0.7), trimesh.transformations.translation_matrix(place))
        for place in places
    ]
    mesh = trimesh.util.concatenate([body, *wheels])
    part = Part("body", "paint", np.array(mesh.vertices), np.array(mesh.faces),
                np.array(mesh.vertex_normals), None)  # fmt: skip
    laid_out = reorder(Vehicle("boxes", (part,)))
    skin = Skin.of(laid_out.vehicle)
    assert measure(skin, np.ones(len(skin.faces), bool)).overlap < 0.005
    corners = skin.corners[~laid_out.placed]
    assert (np.linalg.det(corners[:, 1:] - corners[:, :1]) > 0).all()


def test_hidden_faces_get_a_place_of_their_own():
    """A second box inside the first is hidden from all sides."""
    outer, inner = box().parts[0], box((3.0, 1.5, 0.7)).parts[0]
    result = reorder(Vehicle("boxes", (outer, inner)))
    faces = len(outer.faces)
    assert result.outside[:faces].all()
    assert not result.outside[faces:].any()
    everything = measure(Skin.of(result.vehicle), np.ones(2 * faces, bool))
    assert everything.overlap < 0.01


def test_what_is_behind_glass_is_not_outside():
    inner = box((3.0, 1.5, 0.7)).parts[0]
    pane = box().parts[0]
    glass = Part("pane", "glass", pane.vertices, pane.faces, pane.normals, None)
    with pytest.raises(MeshError, match="no painted face can be seen"):
        reorder(Vehicle("car", (inner, glass)))


def test_a_mask_chooses_the_faces_that_are_unfolded(sedan):
    chosen = np.zeros(len(Skin.of(sedan).faces), bool)
    chosen[::2] = True
    result = reorder(sedan, chosen)
    assert not result.outside[~chosen].any()
    assert not result.placed[~chosen].any()


def test_a_vehicle_without_paint_is_refused(sedan):
    with pytest.raises(MeshError, match="no part is paint"):
        reorder(Vehicle("bare", tuple(p for p in sedan.parts if p.material != "paint")))


def test_a_seam_is_counted_once_and_gaps_between_neighbours_are_none():
    """Two unit squares 1 cm apart: side by side in the texture, then not."""
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    triangles = np.concatenate([square, square + [1.01, 0, 0]])
    near = triangles[..., :2]
    far = near + np.array([0, 0, 3, 3])[:, None, None] * [1.0, 0.0]
    assert seam_length(triangles, near, 1.0) == 0
    assert seam_length(triangles, far, 1.0) == pytest.approx(1, abs=0.03)


def test_a_picture_follows_its_faces():
    """Colors that are a linear function of the old place come back at the new one."""
    corners = np.array([[[0.1, 0.1], [0.5, 0.1], [0.1, 0.5]]])
    moved = corners[:, :, ::-1] * 0.5 + 0.4
    v, u = np.mgrid[:256, :256][:, ::-1] / 256 + 0.5 / 256
    picture = np.stack([u, v], axis=2)
    baked = rebake(picture, corners, moved, 128)
    row, column = 128 - int(0.5 * 128), int(0.5 * 128)  # inside the moved triangle
    at = np.array([column + 0.5, 128 - row - 0.5]) / 128
    np.testing.assert_allclose(baked[row, column], ((at - 0.4) / 0.5)[::-1], atol=0.003)
    assert baked.min() > 0.08  # far from the triangle its nearest color goes on
    mask = np.zeros((256, 256), bool)
    mask[128:, :128] = True  # lower left
    assert shown_in(mask, corners).tolist() == [True]
    assert shown_in(~mask, corners).tolist() == [False]


def test_a_mask_reaches_beyond_charts_but_not_into_others(sedan):
    size = 256
    used = paint_mask(sedan, size, padding=0)
    left_half = used & (np.arange(size) < size // 2)
    padded = pad_mask(left_half, sedan, 3)
    assert (padded & used == left_half).all()
    grown = padded & ~left_half
    assert grown.any()
    assert not (grown & used).any()


def test_the_file_comes_back_as_it_was(tmp_path, reordered):
    path = tmp_path / "sedan.obj"
    write_obj(path, reordered.vehicle)
    back = load_vehicle(path, up="z")
    assert {p.material for p in back.parts} == {p.material for p in reordered.vehicle.parts}
    old, new = Skin.of(reordered.vehicle), Skin.of(back)
    np.testing.assert_allclose(new.corners, old.corners, atol=1e-6)
    np.testing.assert_allclose(new.vertices[new.faces], old.vertices[old.faces], atol=1e-5)


def test_another_ending_is_refused(tmp_path, reordered):
    with pytest.raises(MeshError, match="end the name with .obj"):
        write_obj(tmp_path / "sedan.ply", reordered.vehicle)
