"""Scenes in Mitsuba's XML: what is read, moved and refused without Mitsuba."""

import numpy as np
import pytest

from cnca.core.errors import MeshError
from cnca.world.checkup import check_world
from cnca.world.mitsuba_xml import read_mitsuba_xml, to_world
from cnca.world.xml_world import load_xml_world

SCENE = """<scene version="3.0.0">
    <integrator type="path"/>
    <default name="half" value="20"/>
    <emitter type="constant"/>
    <shape type="rectangle" id="ground">
        <transform name="to_world">
            <scale x="$half" y="10"/><rotate x="1" angle="-90"/><translate value="1, 2, 3"/>
        </transform>
        <bsdf type="diffuse"/>
    </shape>
    <emitter type="point">
        <point name="position" x="1" y="4" z="2"/><rgb name="intensity" value="1"/>
    </emitter>
    {more}
</scene>"""


@pytest.fixture
def scene(tmp_path):
    def write(more="", name="scene.xml"):
        path = tmp_path / name
        path.write_text(SCENE.format(more=more))
        return path

    return write


def test_shapes_stand_where_their_transforms_and_the_axes_put_them(scene):
    """Scaled, laid on y = 2, moved; then from y up to z up and to half the size."""
    (ground,) = load_xml_world(scene(), scale=0.5).pieces
    low, high = ground.vertices.min(axis=0), ground.vertices.max(axis=0)
    sides = sorted((high - low).round(6).tolist())
    assert sides == [0.0, 10.0, 20.0]
    np.testing.assert_allclose([low[2], high[2]], 1.0, atol=1e-6)


def test_cameras_and_the_environment_are_left_out_and_said_so(scene):
    xml = read_mitsuba_xml(scene())
    assert xml.ignored == ("integrator path", "emitter constant")
    assert xml.lamps == 1
    assert "integrator" not in xml.text(lit=True)
    assert "emitter" not in xml.text(lit=False)
    findings = check_world(scene()).findings
    assert any("emitter constant: left out" in line for line in findings)


def test_a_rotation_is_counter_clockwise_and_a_camera_looks_along_z():
    import xml.etree.ElementTree as ET

    def matrix(steps):
        return to_world(
            ET.fromstring(f"<shape><transform name='to_world'>{steps}</transform></shape>")
        )

    turned = matrix("<rotate z='1' angle='90'/>") @ [1, 0, 0, 1]
    np.testing.assert_allclose(turned, [0, 1, 0, 1], atol=1e-9)
    looks = matrix("<lookat origin='1,0,0' target='1,5,0' up='0,0,1'/>")
    np.testing.assert_allclose(looks @ [0, 0, 1, 1], [1, 1, 0, 1], atol=1e-9)


def test_includes_are_read_from_their_own_folder(scene, tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "box.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    part = "<string name='filename' value='box.obj'/>"
    (tmp_path / "parts" / "more.xml").write_text(
        f"<scene version='3.0.0'><shape type='obj'>{part}</shape></scene>"
    )
    world = load_xml_world(scene("<include filename='parts/more.xml'/>"))
    assert len(world.pieces) == 2
    assert {path.rsplit("/", 1)[-1] for path in world.source} == {
        "scene.xml",
        "more.xml",
        "box.obj",
    }


def test_an_instance_is_the_shapes_of_its_group(scene):
    move = "<transform name='to_world'><translate {}/></transform>"
    inner, outer = move.format("x='1'"), move.format("y='2'")
    group = f"<shape type='shapegroup' id='g'><shape type='cube' id='c'>{inner}</shape></shape>"
    instance = f"<shape type='instance'><ref id='g'/>{outer}</shape>"
    twice = load_xml_world(scene(group + instance + instance))
    cube = move.format("x='1' y='2'")
    once = load_xml_world(scene(f"<shape type='cube'>{cube}</shape>"))
    assert len(twice.pieces) == len(once.pieces) + 1
    for copied in twice.pieces[-2:]:
        np.testing.assert_allclose(copied.vertices, once.pieces[-1].vertices, atol=1e-6)


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        ("<include filename='scene.xml'/>", "includes itself: scene.xml → scene.xml"),
        ("<include filename='none.xml'/>", "none.xml: no such file .included by scene.xml."),
        (
            "<shape type='obj'><string name='filename' value='no.obj'/></shape>",
            "names no.obj, which is not there",
        ),
        ("<shape type='cube'><transform name='to_world'><skew/></transform></shape>", "<skew>"),
        ("<shape type='cube'><float name='x' value='$size'/></shape>", "size has no value"),
        (
            "<emitter type='point'><rgb name='intensity' value='1, nan, 1'/></emitter>",
            "a lamp has intensity 1, nan, 1",
        ),
        (
            "<shape type='instance'><ref id='g'/></shape>",
            "an instance of g, which is no shapegroup",
        ),
        ("</scene><scene>", "is no XML"),
    ],
)
def test_what_is_broken_is_one_line(scene, more, complaint):
    with pytest.raises(MeshError, match=complaint) as raised:
        load_xml_world(scene(more))
    assert "\n" not in str(raised.value)


def test_a_scene_of_nothing_is_refused(tmp_path):
    path = tmp_path / "empty.xml"
    path.write_text("<scene version='3.0.0'/>")
    with pytest.raises(MeshError, match="holds no shapes"):
        load_xml_world(path)
