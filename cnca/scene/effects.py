"""Which effects a scene calls for: what is rendered how, and why."""

from __future__ import annotations

from cnca.scene.weather import Weather


def explain(weather: Weather, *, has_sun: bool, bounces: int) -> list[dict[str, str]]:
    """One row (effect, model, why) for each effect; what a scene does not name is off."""
    fog = weather.fog
    if fog is None:
        air = ("none", "the scene has no fog")
    elif fog.height == 0:
        air = ("none", "the layer has no height")
    else:
        why = (
            f"visibility {fog.visibility:g} m, up to {fog.height:g} m: solved once, then looked up"
        )
        air = ("plane-parallel field", why)
    sun = ("direction", f"altitude {weather.sun_altitude:g}°")
    if not has_sun:
        sun = (
            "off",
            f"no light at altitude {weather.sun_altitude:g}°, scale {weather.sun_scale:g}",
        )
    reflections = f"{bounces} reflection{'s' if bounces > 1 else ''}"
    rows = [
        ("fog", *air),
        ("sun", *sun),
        ("sky", "map", f"Hosek–Wilkie, turbidity {weather.turbidity:g}"),
        ("interreflection", reflections, "light from the ground lifts the sills"),
        ("gradient", "texture only", "nothing else is optimized"),
    ]
    return [dict(zip(("effect", "model", "why"), row, strict=True)) for row in rows]
