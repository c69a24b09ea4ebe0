"""Scene files are read here, and what is wrong in one is said in one line."""

from __future__ import annotations

import reprlib
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from cnca.core.errors import SceneError, did_you_mean
from cnca.core.yaml_text import read_yaml
from cnca.scene.schema import CarlaCamera, OrbitCamera, Scene, VehicleSection
from cnca.scene.shipped import scene_file


def load_scene(path: str | Path) -> Scene:
    """Read and check a scene file, or the shipped one that ``builtin:NAME`` stands for.

    Raises:
        SceneError: the file is missing, is not YAML, or a key or value in it is wrong.
    """
    path = scene_file(path)
    try:
        content = read_yaml(path, SceneError)
    except SceneError:
        raise
    except FileNotFoundError:
        raise SceneError(f"{path}: no such scene file; see scenes/ for examples") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {_one_line(error)}") from None
    except Exception as error:  # PyYAML lets through what impossible dates and numbers raise
        raise SceneError(f"{path}: not valid YAML: {_one_line(error)}") from None
    if content is None:
        content = {}
    if not isinstance(content, dict):
        raise SceneError(f"{path}: a scene file is a mapping of sections, got {_short(content)}")
    if "base" in content:
        raise SceneError(f"{path}: base: unknown key; paths always start at the file's folder")
    try:
        return Scene.model_validate({**content, "base": path.parent})
    except ValidationError as error:
        raise SceneError(f"{path}: {_explain(error)}") from None


def vehicle_section(content: dict[str, Any]) -> VehicleSection:
    """The keys of a scene's vehicle; raises SceneError where one of them or its value is wrong."""
    try:
        return Scene.model_validate({"vehicle": content}).vehicle
    except ValidationError as error:
        raise SceneError(_explain(error)) from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _short(value: Any) -> str:
    """The beginning of its text; aliases can make the whole text enormous."""
    return f"{reprlib.repr(value):.80}"


def _explain(error: ValidationError) -> str:
    """The first problem as ``key: what is wrong (got value)``, with the nearest right key."""
    problem = _most_relevant(error.errors())
    location = [part for part in problem["loc"] if part not in _UNION_TAGS]
    where = ".".join(str(part) for part in location) or "scene"
    if problem["type"] == "extra_forbidden":
        section = _section_at(location[:-1], problem["loc"])
        hint = did_you_mean(str(location[-1]), section.model_fields) if section else ""
        return f"{where}: unknown key{hint}"
    return (
        f"{where}: {problem['msg'].removeprefix('Value error, ')} (got {_short(problem['input'])})"
    )


_UNION_TAGS = {"OrbitCamera", "CarlaCamera"}


def _most_relevant(problems: list[Any]) -> Any:
    """A misspelt key is the cause of a missing one; a camera is tried as both of its kinds."""
    problems = sorted(problems, key=lambda p: p["type"] != "extra_forbidden")
    first = problems[0]
    if "cameras" not in first["loc"]:
        return first
    index = first["loc"][1] if len(first["loc"]) > 1 else None
    here = [p for p in problems if p["loc"][:2] == ("cameras", index)]
    is_carla = not any(p["loc"][2:] == ("CarlaCamera", "carla") for p in here)
    kind = "CarlaCamera" if is_carla else "OrbitCamera"
    return next((p for p in here if kind in p["loc"]), first)


def _section_at(location: list[Any], tagged: tuple[Any, ...]) -> type[BaseModel] | None:
    """The model whose keys were allowed at ``location``."""
    if "cameras" in location:
        return CarlaCamera if "CarlaCamera" in tagged else OrbitCamera
    model: type[BaseModel] = Scene
    for key in location:
        kinds = [model.model_fields[key].annotation, *get_args(model.model_fields[key].annotation)]
        models = [k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)]
        if not models:
            return None
        model = models[0]
    return model
