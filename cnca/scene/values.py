"""Values of a scene file and the ranges that they lie in."""

from __future__ import annotations

from typing import Annotated, Literal

from PIL import ImageColor
from pydantic import AfterValidator, BeforeValidator, Field, StringConstraints

from cnca.scene.weather import MOST_ASYMMETRY


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"a range is written [low, high], got [{pair[0]:g}, {pair[1]:g}]")
    return pair


def _as_color(value: object) -> object:
    """The three numbers that a name or hexadecimal digits stand for; all else as it is."""
    if value is not None and not isinstance(value, str):
        return value
    try:
        return tuple(channel / 255 for channel in ImageColor.getrgb(value or "")[:3])
    except ValueError:
        raise ValueError(
            'a color is [red, green, blue] from 0 to 1, a name such as red, or "#ff0000" in quotes'
        ) from None


def _as_word(switch: object) -> object:
    """YAML reads ``on`` and ``off`` as truth values."""
    return ("on" if switch else "off") if isinstance(switch, bool) else switch


Switch = Annotated[Literal["auto", "on", "off"], BeforeValidator(_as_word)]
Unit = Annotated[float, Field(ge=0, le=1)]
Color = Annotated[tuple[Unit, Unit, Unit], BeforeValidator(_as_color)]
"""sRGB: three numbers in [0, 1], ``"#ff0000"`` or a name of CSS such as red."""
Altitude = Annotated[float, Field(ge=-90, le=90)]
Elevation = Annotated[float, Field(ge=-90, le=90)]
Azimuth = Annotated[float, Field(ge=-360, le=720)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Coordinate = Annotated[float, Field(allow_inf_nan=False)]
FieldOfView = Annotated[float, Field(gt=0, lt=180)]
Asymmetry = Annotated[float, Field(ge=-MOST_ASYMMETRY, le=MOST_ASYMMETRY)]

Label = Annotated[str, StringConstraints(strip_whitespace=True, to_lower=True, min_length=1)]

Range = Annotated[tuple[Coordinate, Coordinate], AfterValidator(_ascending)]
PositiveRange = Annotated[tuple[Positive, Positive], AfterValidator(_ascending)]
AltitudeRange = Annotated[tuple[Altitude, Altitude], AfterValidator(_ascending)]
ElevationRange = Annotated[tuple[Elevation, Elevation], AfterValidator(_ascending)]
