"""Scenes in Mitsuba's XML, read without Mitsuba: one tree, what it names, and its transforms.

Mitsuba loads the shapes, materials and lamps from that tree (:mod:`cnca.mi_bridge.xml_world`).
"""

from __future__ import annotations

import copy
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cnca.core.errors import MeshError

Matrix = Float[np.ndarray, "4 4"]
UNUSED = ("sensor", "integrator", "sampler", "film", "rfilter")
"""What a scene has beside the things in it."""
ENVIRONMENTS = ("envmap", "constant", "sky", "sun", "sunsky", "directional")
"""Emitters that are infinitely far away: our own sky takes their place."""
TO_WORLD = ("to_world", "toWorld")


@dataclass(frozen=True)
class MitsubaXml:
    """A scene of Mitsuba's as one tree, its includes and defaults filled in."""

    path: Path
    root: ET.Element = field(repr=False)
    files: tuple[Path, ...]
    """All that it is made of, the file itself first."""
    ignored: tuple[str, ...]
    """Kinds of things that were left out."""
    to_here: Matrix = field(default_factory=lambda: np.eye(4))
    """From the file's axes to the world's."""

    @property
    def lamps(self) -> int:
        """How many emitters there are."""
        return sum(1 for _ in self.root.iter("emitter"))

    def text(self, *, lit: bool) -> str:
        """XML for Mitsuba, all things moved by :attr:`to_here`; ``lit`` keeps the emitters."""
        root = copy.deepcopy(self.root)
        if not lit:
            for parent in list(root.iter()):
                for emitter in parent.findall("emitter"):
                    parent.remove(emitter)
        for thing in root:
            if thing.tag in ("shape", "emitter") and thing.get("type") != "shapegroup":
                _move(thing, self.to_here)
        return ET.tostring(root, encoding="unicode")


def read_mitsuba_xml(path: Path) -> MitsubaXml:
    """Read a scene and all that it includes.

    Raises:
        MeshError: a file is missing, is not XML, includes itself, or is not a Mitsuba scene.
    """
    files: list[Path] = []
    root = _included(path, (), files)
    values = {d.get("name", ""): d.get("value", "") for d in root.iter("default")}
    _fill_in(root, values, path)
    _refuse_impossible_light(root, path)
    _unpack_instances(root, path)
    ignored = []
    for thing in list(root):
        kind = thing.get("type", "")
        far = thing.tag == "emitter" and kind in ENVIRONMENTS
        if thing.tag in UNUSED or thing.tag in ("default", "path") or far:
            root.remove(thing)
            if thing.tag not in ("default", "path"):
                ignored.append(f"{thing.tag} {kind}".strip())
    return MitsubaXml(path, root, tuple(files), tuple(dict.fromkeys(ignored)))


def _included(path: Path, above: tuple[Path, ...], files: list[Path]) -> ET.Element:
    path = path.resolve() if above else path
    if path.resolve() in above:
        names = " → ".join(file.name for file in (*above, path))
        raise MeshError(f"{path}: includes itself: {names}; take one of the includes out")
    try:
        root = ET.fromstring(path.read_bytes())
    except FileNotFoundError:
        by = f" (included by {above[-1].name})" if above else ""
        hint = "paths start at the folder of the file that names them"
        raise MeshError(f"{path}: no such file{by}; {hint}") from None
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ET.ParseError as error:
        raise MeshError(f"{path}: is no XML ({error}); save the scene again") from None
    if root.tag != "scene":
        raise MeshError(f"{path}: begins with <{root.tag}>; a scene of Mitsuba's with <scene>")
    files.append(path)
    _find_files(root, path, files)
    children = list(root)
    root[:] = []
    for child in children:
        if child.tag == "include":
            name = child.get("filename", "")
            root.extend(_included(path.parent / name, (*above, path.resolve()), files))
        else:
            root.append(child)
    return root


def _find_files(root: ET.Element, path: Path, files: list[Path]) -> None:
    """Make the names of files absolute; raises MeshError for what is not there."""
    for string in root.iter("string"):
        if string.get("name") != "filename" or "$" in string.get("value", ""):
            continue
        file = (path.parent / string.get("value", "")).resolve()
        if not file.is_file():
            raise MeshError(f"{path}: names {string.get('value')}, which is not there; put it back")
        string.set("value", str(file))
        files.append(file)


def _fill_in(root: ET.Element, values: dict[str, str], path: Path) -> None:
    """Put the defaults in place of ``$name``; longer names first, as Mitsuba does.

    Raises MeshError for a name without a default.
    """
    for element in root.iter():
        for key, text in element.attrib.items():
            for name in sorted(values, key=len, reverse=True):
                text = text.replace(f"${name}", values[name])
            if "$" in text and not Path(text).is_file():
                raise MeshError(f"{path}: {text} has no value; add a <default> of that name")
            element.set(key, text)


def _refuse_impossible_light(root: ET.Element, path: Path) -> None:
    """Raises MeshError for a lamp whose light is negative, NaN or infinite."""
    for emitter in root.iter("emitter"):
        for color in (c for tag in ("rgb", "spectrum", "float") for c in emitter.iter(tag)):
            for word in re.split(r"[\s,:]+", color.get("value", "").strip()):
                try:
                    usable = 0 <= float(word) < math.inf
                except ValueError:
                    continue  # not a number at all, which is Mitsuba's to refuse
                if not usable:
                    name = f"{color.get('name', color.tag)} {color.get('value')}"
                    raise MeshError(f"{path}: a lamp has {name}; give numbers from 0 upwards")


def _unpack_instances(root: ET.Element, path: Path) -> None:
    """Put the shapes of a group wherever an instance of it stands.

    Raises MeshError for an instance without a group, or with an invalid transform.
    """
    groups = {g.get("id"): g for g in root.findall("shape[@type='shapegroup']")}
    for group in groups.values():
        root.remove(group)
    for instance in root.findall("shape[@type='instance']"):
        reference = instance.find("ref")
        name = None if reference is None else reference.get("id")
        found = groups.get(name, instance.find("shape[@type='shapegroup']"))
        if found is None:
            raise MeshError(f"{path}: an instance of {name}, which is no shapegroup; add one")
        root.remove(instance)
        for shape in copy.deepcopy(found).findall("shape"):
            for element in shape.iter():
                if element.tag != "ref":
                    element.attrib.pop("id", None)
            try:
                _move(shape, to_world(instance))
            except ValueError as error:
                raise MeshError(f"{path}: an instance cannot be read ({error})") from None
            root.append(shape)


def _move(thing: ET.Element, matrix: Matrix) -> None:
    """Let Mitsuba move a shape or an emitter once more."""
    point = next((p for p in thing.findall("point") if p.get("name") == "position"), None)
    if point is not None:
        moved = matrix @ [*numbers(point), 1.0]
        point.attrib = {"name": "position"} | dict(
            zip("xyz", map(repr, moved[:3].tolist()), strict=True)
        )
        return
    transform = next((t for t in thing.findall("transform") if t.get("name") in TO_WORLD), None)
    if transform is None:
        transform = ET.SubElement(thing, "transform", {"name": "to_world"})
    ET.SubElement(transform, "matrix", {"value": " ".join(map(repr, matrix.ravel().tolist()))})


def numbers(element: ET.Element, otherwise: float = 0.0) -> tuple[float, float, float]:
    """The numbers of a point, a translation, a scale or an axis; raises ValueError for others."""
    if "value" in element.attrib:
        values = [float(word) for word in element.get("value", "").replace(",", " ").split()]
        x, y, z = values * 3 if len(values) == 1 else values
    else:
        x, y, z = (float(element.get(axis, otherwise)) for axis in "xyz")
    return x, y, z


def to_world(thing: ET.Element) -> Matrix:
    """The transform of a shape in its file's axes; raises ValueError for an invalid one."""
    matrix = np.eye(4)
    for transform in thing.findall("transform"):
        if transform.get("name") in TO_WORLD:
            for step in transform:
                matrix = _step(step) @ matrix
    return matrix


def _step(step: ET.Element) -> Matrix:
    matrix = np.eye(4)
    if step.tag == "translate":
        matrix[:3, 3] = numbers(step)
    elif step.tag == "scale":
        matrix[:3, :3] = np.diag(numbers(step, 1.0))
    elif step.tag == "rotate":
        matrix[:3, :3] = _rotation(
            np.array(numbers(step)), math.radians(float(step.get("angle", 0)))
        )
    elif step.tag == "matrix":
        values = [float(word) for word in step.get("value", "").replace(",", " ").split()]
        size = math.isqrt(len(values))
        matrix[:size, :size] = np.reshape(values, (size, size))
    elif step.tag == "lookat":
        origin, target = (np.array(_triple(step.get(end, ""))) for end in ("origin", "target"))
        matrix = _look_at(origin, target, np.array(_triple(step.get("up", "0, 1, 0"))))
    else:
        raise ValueError(f"<{step.tag}> in a transform")
    return matrix


def _rotation(axis: Float[np.ndarray, "3"], angle: float) -> Float[np.ndarray, "3 3"]:
    """About an axis, counter-clockwise (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def _look_at(
    origin: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]
) -> Matrix:
    forward = (target - origin) / np.linalg.norm(target - origin)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(forward, left), forward, origin], axis=1)
    return matrix


def _triple(text: str) -> list[float]:
    return [float(word) for word in text.replace(",", " ").split()]
