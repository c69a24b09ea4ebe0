"""What materials and parts are probably made of, by the words in their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping

STEMS = (
    "windscreen", "windshield", "interior", "exterior", "headlight", "rubber", "chrome", "window",
    "mirror", "wheel", "brake", "steel", "paint", "glass", "plate", "light",
    "metal", "lamp", "tyre", "seat", "body", "rim",
)  # fmt: skip
"""Words that are written together with others: carpaint, taillight, underbody."""
WHOLE = {
    "metallic", "template", "platelet", "platemail", "lens", "trim", "prim", "scrim", "grim",
    "light", "slight", "flight", "delight", "highlight", "sunlight", "daylight", "lightweight",
    "chassis", "glass", "nobody", "somebody", "antibody", "bodyguard",
}  # fmt: skip
"""Words that are not taken apart, though they begin or end like others."""
SHADED = {
    "gray", "grey", "black", "white", "silver", "red", "blue", "green", "yellow",
    "orange", "brown", "beige", "gold", "purple", "pink", "bronze", "champagne", "wood",
    "oak", "alloy", "leather", "fabric", "metal",
}  # fmt: skip
"""What ``light`` and ``dark`` may be a shade of."""

Words = frozenset[str]


def words(name: str) -> Words:
    """The words of a name in lower case and in the singular, joined ones also taken apart.

    ``BrakeDisc_02`` has brake and disc, ``carpaint`` has carpaint, car and paint.
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    found: set[str] = set()
    for word in re.findall(r"[^\W\d_]+", spaced):
        found |= _parts(word.lower())
    return frozenset(found)


def known_material(name: str) -> str | None:
    """Our material that something of this name is probably made of; None if it says nothing."""
    given = words(name)
    if given & {"light", "dark"} and given & SHADED and "lights" not in name.lower():
        given -= {"light", "dark"}  # no lamp is called light gray
    return next((kind for kind, fits in _RULES if fits(given)), None)


def guess_material(name: str) -> str:
    """The same, but a silent name stands for trim."""
    return known_material(name) or "trim"


def material_kinds(names: Iterable[str], chosen: Mapping[str, str]) -> dict[str, str]:
    """The file's material names → ours: as chosen, else guessed.

    A file with one material is all paint; where no name speaks of paint, a single silent one is.
    """
    names = list(names)
    if len(names) == 1 and not chosen:
        return dict.fromkeys(names, "paint")
    kinds = {name: chosen.get(name) or guess_material(name) for name in names}
    silent = [name for name in names if name not in chosen and known_material(name) is None]
    if "paint" not in kinds.values() and len(silent) == 1:
        kinds[silent[0]] = "paint"
    return kinds


def _parts(word: str) -> set[str]:
    found = {word}
    if word in WHOLE:
        return found
    if len(word) > 3 and word.endswith("s") and not word.endswith("ss"):
        return _parts(word[:-1])
    for stem in STEMS:
        if word != stem and word.endswith(stem):
            return found | {stem} | _parts(word.removesuffix(stem))
        if word != stem and word.startswith(stem) and len(stem) > 3:
            return found | {stem} | _parts(word.removeprefix(stem))
    return found


def _any(text: str) -> Callable[[Words], bool]:
    known = frozenset(text.split())
    return lambda given: bool(given & known)


_inside = _any(
    "interior seat dash dashboard steering cockpit carpet leather fabric headliner pedal gauge "
    "console driver inside cloth upholstery cabin airbag engine"
)
_at_the_back = _any("tail brake stop rear back red")
_lamp = _any("light lamp headlight headlamp foglamp bulb blinker indicator signal lens drl")
_pane = _any("glass window windscreen windshield glazing")
_edge = _any("trim seal gasket molding moulding plastic vinyl frame wiper grille grill handle")
_well = _any("arch house well liner")
_wheel = _any("tyre tire rubber wheel")
_rim = _any("rim hub hubcap alloy caliper brake disc rotor spoke")
_body = _any("paint body bodywork lacquer exterior coachwork livery")
_panel = _any("door hood bonnet trunk tailgate bootlid fender roof bumper quarter")

_RULES: tuple[tuple[str, Callable[[Words], bool]], ...] = (
    ("trim", lambda w: _inside(w) and not _pane(w)),
    ("underbody", lambda w: "chassis" in w or {"under", "body"} <= w or "undercarriage" in w),
    ("tail_light", lambda w: _lamp(w) and _at_the_back(w)),
    ("light", _lamp),
    ("trim", lambda w: _edge(w) and not w & {"paint", "chrome"}),
    ("tail_light", lambda w: {"red", "glass"} <= w),
    ("glass", _pane),
    ("underbody", lambda w: _wheel(w) and _well(w)),
    ("metal", _rim),
    ("metal", lambda w: {"wheel", "metal"} <= w),
    ("tyre", _wheel),
    ("paint", lambda w: "paint" in w or {"body", "metal"} <= w),
    ("metal", _any("chrome metal mirror steel aluminium aluminum exhaust")),
    ("plate", lambda w: "plate" in w and not w & {"skid", "scuff", "kick"}),
    ("paint", _body),
    ("paint", _panel),
)
"""Kinds, and whether a name's words speak for one; the first match wins."""
