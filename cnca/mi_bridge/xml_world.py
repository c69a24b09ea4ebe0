"""Shapes, materials and lamps of a scene in Mitsuba's XML, loaded by Mitsuba."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cnca.core.errors import MeshError
from cnca.mi_bridge.variant import mi
from cnca.world.mitsuba_xml import MitsubaXml, read_mitsuba_xml


@dataclass(frozen=True)
class XmlShapes:
    """What such a scene holds."""

    solid: list[mi.Shape]
    holed: list[mi.Shape]
    """Those that light passes without a bend."""
    lamps: list[mi.Emitter]


def xml_shapes(xml: MitsubaXml, *, lit: bool) -> XmlShapes:
    """Load it, moved to where it stands around the vehicle; its lamps only where they are ``lit``.

    Raises MeshError for what Mitsuba refuses, such as a plugin that does not exist.
    """
    try:
        scene = mi.load_string(xml.text(lit=lit))
    except Exception as error:  # Mitsuba raises RuntimeError for all that it does not like
        raise MeshError(f"{xml.path}: Mitsuba refuses it: {_reason(error)}") from None
    shapes = list(scene.shapes())
    holed = [shape for shape in shapes if mi.has_flag(shape.bsdf().flags(), mi.BSDFFlags.Null)]
    solid = [shape for shape in shapes if shape not in holed]
    return XmlShapes(solid, holed, list(scene.emitters()))


def refuse_unknown_plugins(path: Path) -> None:
    """Let Mitsuba load a scene once; raises MeshError where it refuses."""
    xml_shapes(read_mitsuba_xml(path), lit=True)


def _reason(error: Exception) -> str:
    """The last thing that Mitsuba says: what it stumbled over, without the way there.

    A list belongs to the line above it.
    """
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    heads = [number for number, line in enumerate(lines) if not line.startswith("-")]
    return " ".join(lines[max(heads, default=0) :]) or type(error).__name__
