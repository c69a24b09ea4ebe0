"""How well does the vehicle of a scene meet the CARLA frames whose poses its cameras have?

    python benchmarks/outlines.py scenes/etron_carla.yaml

prints, for each frame, the scene's lift and the fitted one in metres, and the median and the 90th
percentile of the distances between the drawn and the photographed outline in pixels.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from cnca import build
from cnca.scene.carla import read_carla_frame
from cnca.scene.load_scene import load_scene
from cnca.scene.schema import CarlaCamera
from cnca.scene.views import build_views
from cnca.vehicle.outline import fit_lift, outline_distances, photographed_silhouette, silhouette


def main() -> None:
    """Measure the scene as it is, print one line of JSON for each frame."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    scene = load_scene(parser.parse_args().scene)
    vehicle = build.build_vehicle(scene)
    for camera, view in zip(scene.cameras, build_views(scene), strict=True):
        if not isinstance(camera, CarlaCamera):
            continue
        photograph = read_carla_frame(scene.base / camera.carla).image
        drawn = silhouette(vehicle, view)
        distances = outline_distances(drawn, photographed_silhouette(drawn, photograph))
        row = {
            "frame": view.name,
            "lift": camera.lift,
            "fitted": round(camera.lift + fit_lift(vehicle, view, photograph), 3),
            "median": round(float(np.median(distances)), 1),
            "percentile_90": round(float(np.percentile(distances, 90)), 1),
        }
        print(json.dumps(row))


if __name__ == "__main__":
    main()
