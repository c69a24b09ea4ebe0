"""The cameras that a scene file names, as views."""

from __future__ import annotations

from pathlib import Path

from cnca.core.errors import SceneError, did_you_mean
from cnca.scene.cameras import View, orbit_view
from cnca.scene.carla import carla_view, read_carla_frame
from cnca.scene.schema import CarlaCamera, Scene


def build_views(scene: Scene) -> list[View]:
    """The cameras that the scene names."""
    width, height = scene.image.width, scene.image.height
    views = []
    for camera in scene.cameras:
        if isinstance(camera, CarlaCamera):
            frame = read_carla_frame(scene.base / camera.carla)
            view = carla_view(
                frame.vehicle,
                frame.camera,
                lift=camera.lift,
                width=width,
                height=height,
                fov=camera.fov,
                name=camera.name or Path(camera.carla).stem,
            )
        else:
            view = orbit_view(
                camera.azimuth,
                camera.elevation,
                camera.distance,
                fov=camera.fov,
                width=width,
                height=height,
                target=camera.target,
                name=camera.name,
            )
        views.append(view)
    return views


def choose_views(scene: Scene, name: str | None, *, every: bool = False) -> list[View]:
    """The view called ``name``, all of them, or the first; raises SceneError for another name."""
    views = build_views(scene)
    if every:
        return views
    if name is None:
        return views[:1]
    chosen = [view for view in views if view.name == name]
    if not chosen:
        names = [view.name for view in views]
        hint = did_you_mean(name, names)
        raise SceneError(f"view '{name}': the scene has {', '.join(names)}{hint}")
    return chosen
