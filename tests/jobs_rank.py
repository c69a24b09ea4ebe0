"""One of the processes of ``tests/jobs/attack/test_divided_jobs.py``: evaluations and a training.

    python -m torch.distributed.run --nproc-per-node 2 -m tests.jobs_rank FOLDER

All are small; ``FOLDER/takenN`` gets the number of times that process N rendered.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import torch
from rich.console import Console

from cnca.core import parallel
from cnca.jobs.evaluate.evaluation import evaluate_scenes
from cnca.jobs.evaluate.photos import evaluate_photos
from cnca.jobs.evaluate.request import EvaluationRequest, PhotoRequest
from cnca.judge import stage
from cnca.train.efr import train
from cnca.train.loop import TrainingLoop
from tests.train.test_efr import shots

SCENE = """
vehicle: {mesh: builtin:sedan, texture_size: 32}
variation: {distance: [6, 7], elevation: [10, 20]}
image: {width: 64, height: 64, samples: 2}
"""
QUIET = Console(quiet=True)
PHOTOS = 5


def write_inputs(folder: Path) -> None:
    (folder / "scene.yaml").write_text(SCENE)
    images, annotations = [], []
    for k in range(PHOTOS):
        path = folder / "photos" / "normal" / f"{k}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.random.default_rng(k).integers(0, 255, (64, 64, 3), np.uint8))
        images.append({"id": k, "file_name": f"normal/{k}.png", "width": 64, "height": 64})
        annotations.append({"image_id": k, "category_id": 1, "bbox": [8, 8, 40, 40]})
    categories = [{"id": 1, "name": "car"}]
    labels = {"images": images, "annotations": annotations, "categories": categories}
    (folder / "labels.json").write_text(json.dumps(labels))


def run_jobs(folder: Path) -> None:
    taken, photograph = [], stage.photograph

    def counted(*arguments):
        taken.append(arguments)
        return photograph(*arguments)

    stage.photograph = counted
    evidence = EvaluationRequest(folder / "evidence", (folder / "scene.yaml",), views=8)
    evaluate_scenes(evidence, QUIET)
    stage.photograph = photograph
    photos = PhotoRequest(folder / "photos", folder / "labels.json", folder / "table2")
    evaluate_photos(photos, QUIET)
    torch.set_default_dtype(torch.float64)  # Adam makes much of the rounding of small gradients
    outcome = train(TrainingLoop(None, 0), shots(3, seed=0), shots(3, seed=1), epochs=2)
    torch.set_default_dtype(torch.float32)
    outcome.network.save(folder / f"efr{parallel.rank()}.safetensors")
    (folder / f"taken{parallel.rank()}").write_text(str(len(taken)))


if __name__ == "__main__":
    with parallel.joined():
        run_jobs(Path(sys.argv[1]))
