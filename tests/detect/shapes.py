"""A data set of colored shapes on noise: rectangles are the objects, discs are none."""

import json

import cv2
import numpy as np

GROUPS = ("bright", "dark", "empty")


def write_shapes(folder, count, *, size=64, seed=0):
    """One disc in each picture and, but for group ``empty``, one rectangle; a quarter is test."""
    random = np.random.default_rng(seed)
    pictures, boxes = [], []
    for index in range(count):
        background = random.uniform(60, 190, (8, 8, 3)).astype(np.float32)
        picture = cv2.resize(background, (size, size), interpolation=cv2.INTER_CUBIC)
        group = GROUPS[index % 3]
        centre = random.integers(size // 5, 4 * size // 5, 2).tolist()
        cv2.circle(picture, centre, size // 8, random.uniform(0, 255, 3).tolist(), -1)
        boxes.append([])
        if group != "empty":
            extent = random.integers(size // 4, size // 2, 2)
            low = random.integers(0, size - extent)
            left, top, right, bottom = (*low.tolist(), *(low + extent).tolist())
            color = random.uniform(200, 255, 3) if group == "bright" else random.uniform(0, 50, 3)
            cv2.rectangle(picture, (left, top), (right - 1, bottom - 1), color.tolist(), -1)
            boxes[-1].append([left, top, right, bottom, 0])
        pictures.append(np.clip(picture, 0, 255).astype(np.uint8))
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "images.npy", np.stack(pictures))
    labels = {
        "class_names": ["rectangle"],
        "boxes": boxes,
        "group": [GROUPS[index % 3] for index in range(count)],
        "split": ["test" if index % 4 == 3 else "train" for index in range(count)],
    }
    (folder / "labels.json").write_text(json.dumps(labels))
    return folder
