"""What a user may say about an ONNX file, in a YAML file of the same stem beside it."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.yaml_text import read_yaml
from cnca.detect.classes import CLASS_LISTS
from cnca.detect.preprocess import Entry, Fit

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Pixels = Annotated[int, Field(gt=0)]
Layout = Literal["detections", "rows", "detr", "grid", "yolo", "yolox", "distribution"]


class Options(BaseModel):
    """Everything is found from the graph where it can be; a value given here wins."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    layout: Layout | None = None
    """How boxes leave the network; see :mod:`cnca.detect.onnx_layouts`."""
    outputs: tuple[str, ...] | None = None
    """The outputs to read, where the graph has others besides."""
    classes: str | tuple[str, ...] | None = None
    """``coco`` (80 names), ``coco91`` (by COCO's numbers), ``voc``, or a list of names."""
    size: tuple[Pixels, Pixels] | None = None
    """Height and width of the input in pixels, for graphs that leave them open."""
    channels: Literal["rgb", "bgr"] | None = None
    """Order of the colors at the input."""
    white: Positive | None = None
    """Value of white at the input, before ``mean`` and ``std``: 1 or 255."""
    mean: tuple[Finite, Finite, Finite] | None = None
    """Subtracted from the channels, in their order at the input and in units of ``white``."""
    std: tuple[Positive, Positive, Positive] | None = None
    """What the channels are then divided by."""
    fit: Fit | None = None
    """How pictures are fitted into the input."""
    fill: Annotated[float, Field(ge=0, le=255)] | None = None
    """Grey beside the picture, 0 to 255."""
    strides: tuple[Pixels, ...] | None = None
    """Pixels per cell of each level, in the order of the output."""
    centre: Finite | None = None
    """Where a cell's reference point lies: 0 at its corner, 0.5 in its middle."""
    activation: Literal["none", "sigmoid", "softmax"] | None = None
    """What is still to be applied to the scores."""
    boxes: Literal["cxcywh", "xyxy", "yxyx"] | None = None
    """Notation of the boxes."""
    units: Literal["pixels", "picture"] | None = None
    """Unit of the boxes: pixels of the input, or its whole width and height."""

    def names(self) -> Sequence[str] | None:
        """The class names, or None where nothing is said."""
        return CLASS_LISTS[self.classes] if isinstance(self.classes, str) else self.classes

    def entry(self, usual: Entry) -> Entry:
        """How pictures enter: as ``usual`` for the layout, except for what is said here."""
        said = self.model_dump(include={"channels", "white", "mean", "std", "fit", "fill"})
        return Entry(**{**vars(usual), **{k: v for k, v in said.items() if v is not None}})


def read_options(path: Path) -> Options:
    """Read ``path``; without such a file nothing is said.

    Raises:
        DetectorError: the file is not a YAML mapping, or a key or value in it is wrong.
    """
    try:
        content = read_yaml(path, DetectorError) or {}
        options = Options.model_validate(content)
    except FileNotFoundError:
        return Options()
    except DetectorError:
        raise
    except ValidationError as error:
        raise DetectorError(f"{path}: {_explain(error)}") from None
    except Exception as error:  # PyYAML lets through what impossible dates and numbers raise
        reason = " ".join(str(error).split())
        raise DetectorError(f"{path}: cannot be read as YAML ({reason})") from error
    if isinstance(options.classes, str) and options.classes not in CLASS_LISTS:
        known = f"give {', '.join(CLASS_LISTS)} or a list of names"
        hint = did_you_mean(options.classes, CLASS_LISTS)
        raise DetectorError(f"{path}: classes: unknown list '{options.classes}'; {known}{hint}")
    return options


def _explain(error: ValidationError) -> str:
    """The first problem, misspelt keys before all others."""
    problems = sorted(error.errors(), key=lambda p: p["type"] != "extra_forbidden")
    key = str(problems[0]["loc"][0]) if problems[0]["loc"] else "file"
    if problems[0]["type"] == "extra_forbidden":
        return f"{key}: unknown key{did_you_mean(key, Options.model_fields)}"
    return f"{key}: {problems[0]['msg']} (got {reprlib.repr(problems[0]['input']):.80})"
