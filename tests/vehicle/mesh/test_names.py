"""Names are read as words."""

import pytest

from cnca.vehicle.mesh.names import guess_material, words

KNOWN = {
    "paint": "Paint_Red carpaint CarPaint body body_light_gray exterior MI_Body Metallic_Paint "
    "Mat_Vehicle_Paint body_metal LightGrey_Body Door_FL Hood bumper_front Livery",
    "trim": "MI_Interior seat_body SeatBody steering_wheel dashboard window_trim entire template "
    "nobody Highlight slight grille door_handle Door_Interior cabin",
    "metal": "BrakeDisc brake_caliper chrome Side_Mirror rim rim_paint LightAlloy chrome_trim "
    "wheel_metal",
    "tyre": "tyre tire Tire_FL Rubber_Black wheel Wheels_01",
    "glass": "glass Windscreen windshield rearWindow GlassTinted glass_interior",
    "light": "light Headlights headlight_glass front_lamp lens turn_signal",
    "tail_light": "TailLight taillights tail_lamp brake_light BrakeLights rear_lamp lights_red "
    "red_glass",
    "plate": "LicensePlate number_plate",
    "underbody": "underBody underbody chassis wheel_arch WheelWell",
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
