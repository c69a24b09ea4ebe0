"""What ``cnca train-detector`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cnca.core.options import OUTPUT, STRENGTH, Flag


@dataclass(frozen=True)
class DetectorRequest:
    """One training of a built-in detector."""

    out: Annotated[Path, Flag("Folder for pictures and weights.", OUTPUT)]
    kind: Annotated[str, Flag("yolo, anchor-free or transformer.")] = "yolo"
    pictures: Annotated[int, Flag("Pictures to render on an empty plane.", STRENGTH)] = 300
    streets: Annotated[int, Flag("Pictures to render of streets full of traffic.", STRENGTH)] = 128
    frames: Annotated[
        Path | None, Flag("Folder of labelled frames to learn from, too: images, labels.")
    ] = None
    """See :func:`cnca.train.detector.frames.gather_frames`."""
    held_out: Annotated[
        tuple[str, ...], Flag("Frames whose names begin so are for testing; repeatable.")
    ] = ()
    fine_tune: Annotated[
        bool, Flag("Begin with the shipped weights and take smaller steps.", STRENGTH)
    ] = False
    epochs: Annotated[int, Flag("Passes over the pictures.", STRENGTH)] = 25
    batch: Annotated[int, Flag("Pictures in a step.", STRENGTH)] = 16
    seed: Annotated[int, Flag("Seed of everything random.", STRENGTH)] = 0
