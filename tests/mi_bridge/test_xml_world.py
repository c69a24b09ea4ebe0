"""A scene in Mitsuba's XML as a world: moved as a whole, its materials and lamps Mitsuba's own."""

import numpy as np
import pytest
import torch

from cnca.core.errors import MeshError
from cnca.mi_bridge.renderer import MitsubaRenderer
from cnca.mi_bridge.variant import mi
from cnca.mi_bridge.xml_world import _reason, refuse_unknown_plugins, xml_shapes
from cnca.scene.weather import Weather
from cnca.world.model import Place
from cnca.world.xml_world import load_xml_world
from tests.mi_bridge.conftest import orbit

HALL = """<scene version="3.0.0">
    <shape type="rectangle" id="ground">
        <transform name="to_world"><scale value="40"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.3, 0.3, 0.3"/></bsdf>
    </shape>
    <shape type="sphere" id="ball">
        <point name="center" x="6" y="1" z="1"/>
        <bsdf type="twosided"><bsdf type="diffuse"/></bsdf>
    </shape>
    <shape type="rectangle" id="strip">
        <transform name="to_world">
            <rotate x="1" angle="180"/><translate x="6" y="0" z="5"/>
        </transform>
        <emitter type="area"><rgb name="radiance" value="0.01, 0.005, 0.001"/></emitter>
    </shape>
    <emitter type="point">
        <point name="position" x="8" y="0" z="4"/>
        <rgb name="intensity" value="0.001"/>
    </emitter>
</scene>"""


@pytest.fixture
def hall(tmp_path):
    path = tmp_path / "hall.xml"
    path.write_text(HALL)
    return path


def test_shapes_and_lamps_move_around_the_vehicle(hall):
    world = load_xml_world(hall, up="z").around(Place(6.0, 0.0, 0.0, 90.0))
    loaded = xml_shapes(world.xml, lit=True)
    boxes = {shape.id(): shape.bbox() for shape in loaded.solid}
    np.testing.assert_allclose(np.array(boxes["ball"].center()), [1, 0, 1], atol=1e-5)
    np.testing.assert_allclose(np.array(boxes["strip"].center()), [0, 0, 5], atol=1e-5)
    (point,) = (lamp for lamp in loaded.lamps if lamp.get_shape() is None)
    position = np.array(mi.traverse(point)["position"]).ravel()
    np.testing.assert_allclose(position, [0, -2, 4], atol=1e-5)
    assert not xml_shapes(world.xml, lit=False).lamps


def test_its_lamps_light_the_vehicle_at_night(hall, vehicle):
    world = load_xml_world(hall, up="z").around(Place(6.0, 0.0))
    renderer = MitsubaRenderer(vehicle, texture_size=8, samples=32, worlds=lambda spot: world)
    grey, view = torch.full((3, 8, 8), 0.4, requires_grad=True), orbit(width=12, height=12)
    image = renderer.render(grey, [view], Weather(sun_altitude=-30), seed=0)[0]
    covered = torch.from_numpy(renderer.vehicle_mask([view])[0] == 1)
    red, _, blue = image.detach()[:, covered].mean(dim=1)
    assert red > 1.5 * blue > 0
    image.mean().backward()
    assert float(grey.grad.abs().sum()) > 0


def test_a_plugin_that_does_not_exist_is_one_line(hall):
    hall.write_text(HALL.replace('type="diffuse"', 'type="difuse"'))
    with pytest.raises(MeshError, match="difuse") as raised:
        refuse_unknown_plugins(hall)
    assert "\n" not in str(raised.value)


def test_what_mitsuba_lists_stands_behind_what_it_says_of_it():
    error = RuntimeError(
        '[parser.cpp] While loading:\nFound 1 unreferenced property:\n  - float "x"'
    )
    assert _reason(error) == 'Found 1 unreferenced property: - float "x"'
