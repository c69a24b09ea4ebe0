"""Names are read as words."""

import pytest

from cnca.vehicle.mesh.names import guess_material, words

KNOWN = {
    "paint": "Paint_Red carpaint CarPaint body body_light_gray exterior MI_Body Metallic_Paint",
    "trim": "MI_Interior seat_body SeatBody steering_wheel dashboard window_trim entire template",
    "metal": "BrakeDisc brake_caliper chrome Side_Mirror rim rim_paint LightAlloy",
    "tyre": "tyre tire Tire_FL Rubber_Black wheel Wheels_01",
    "glass": "glass Windscreen windshield rearWindow GlassTinted glass_interior",
    "light": "light Headlights headlight_glass front_lamp lens",
    "tail_light": "TailLight taillights tail_lamp brake_light BrakeLights rear_lamp",
    "plate": "LicensePlate number_plate",
    "underbody": "underBody underbody chassis",
}


@pytest.mark.parametrize(
    ("name", "kind"), [(name, kind) for kind, names in KNOWN.items() for name in names.split()]
)
def test_names_say_what_things_are_made_of(name, kind):
    assert guess_material(name) == kind


def test_words():
    assert {"brake", "disc"} <= words("BrakeDisc_02")
    assert {"mi", "interior"} <= words("MI_Interior")
    assert {"tail", "light"} <= words("taillights")
    assert "bus" in words("city-bus.v2")
    assert "bus" not in words("business")
