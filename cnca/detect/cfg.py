"""Darknet's ``.cfg`` files as data: sections with checked keys and typed values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from cnca.core.errors import DetectorError, did_you_mean
from cnca.core.text import read_text

Value = TypeVar("Value", int, float)

# Keys that say how to train are known and ignored; every other key must be one that is read.
_TRAINING = {
    "net": """batch subdivisions momentum decay angle saturation exposure hue learning_rate burn_in
        max_batches policy steps scales mosaic mosaic_bound cutmix mixup flip max_crop min_crop
        gamma step power time_steps track augment_speed sequential_subdivisions num_steps
        optimized_memory workspace_size_limit_MB blur gaussian_noise dynamic_minibatch ema_alpha
        adversarial_lr label_smooth_eps resize_step random adam B1 B2 eps sgdr_cycle sgdr_mult
        burnin_update dropblock_size_abs mosaic_scale aspect min_ratio max_ratio contrastive
        contrastive_color contrastive_jit_flip loss_scale try_fix_nan init_delay show_details
        badlabels_rejection_percentage num_sigmas_reject_badlabels unsupervised equidistant_point
        reject_threshold weights_reject_freq seq_scales swa use_cuda_graph""",
    "convolutional": "stopbackward dontload burnin_update train_only_bn",
    "dropout": "dropblock dropblock_size_abs dropblock_size_rel",
    "yolo": """jitter ignore_thresh truth_thresh random iou_thresh cls_normalizer iou_normalizer
        iou_loss nms_kind beta_nms max max_delta obj_normalizer resize label_smooth_eps focal_loss
        objectness_smooth counters_per_class map""",
}
_READ = {
    "net": "width height channels letter_box",
    "convolutional": "filters size stride pad padding groups batch_normalize activation",
    "shortcut": "from activation",
    "route": "layers groups group_id",
    "upsample": "stride",
    "maxpool": "size stride padding",
    "dropout": "probability",
    "avgpool": "",
    "scale_channels": "from activation scale_wh",
    "sam": "from activation",
    "reorg": "stride reverse",
    "yolo": "mask anchors classes num scale_x_y new_coords",
    "anchor_free": "classes",  # our own; Darknet has no such head
}
SECTIONS = tuple(kind for kind in _READ if kind != "net")
_ALIASES = {"network": "net", "conv": "convolutional", "max": "maxpool", "avg": "avgpool"}
_DARKNETS = """region gaussian_yolo detection softmax soft cost crop connected conn local
    local_avgpool local_avg reorg3d rnn crnn lstm gru conv_lstm history deconvolutional
    normalization lrn batchnorm activation implicit contrastive empty silence
    stride_x stride_y dilation antialiasing xnor binary bin_output share_index assisted_excitation
    rotate stretch stretch_sway sway coordconv deform wait_stream maxpool_depth out_channels scale
    weights_type weights_normalization embedding_layer"""
"""Sections and keys that Darknet has besides: suggesting a similar one would change the network.

Source: AlexeyAB/darknet, ``src/parser.c``.
"""


@dataclass(frozen=True)
class Section:
    """One ``[kind]`` of a file with its ``key=value`` lines."""

    kind: str
    where: str
    """File, number of the layer and line, for messages."""
    options: dict[str, str] = field(default_factory=dict)

    def error(self, problem: str) -> DetectorError:
        """An error that starts with the place."""
        return DetectorError(f"{self.where}: {problem}")

    def text(self, key: str, default: str) -> str:
        """The value as it stands."""
        return self.options.get(key, default)

    def integer(self, key: str, default: int | None = None, *, least: int = 0) -> int:
        """An integer of at least ``least``; without a default the key is required."""
        if key not in self.options and default is not None:
            return default
        values = self.integers(key)
        if len(values) != 1 or values[0] < least:
            raise self.error(f"{key}={self.options[key]} must be one integer of at least {least}")
        return values[0]

    def number(self, key: str, default: float) -> float:
        """A real number."""
        if key not in self.options:
            return default
        values = self.numbers(key)
        if len(values) != 1 or not math.isfinite(values[0]):
            raise self.error(f"{key}={self.options[key]} must be one finite number")
        return values[0]

    def integers(self, key: str) -> tuple[int, ...]:
        """Integers separated by commas."""
        return self._values(key, int)

    def numbers(self, key: str) -> tuple[float, ...]:
        """Real numbers separated by commas."""
        return self._values(key, float)

    def _values(self, key: str, convert: Callable[[str], Value]) -> tuple[Value, ...]:
        if key not in self.options:
            raise self.error(f"key '{key}' is missing; add {key}=…")
        try:
            return tuple(convert(part) for part in self.options[key].split(",") if part.strip())
        except ValueError:
            kind = "integers" if convert is int else "numbers"
            raise self.error(f"{key}={self.options[key]} must be {kind}") from None


@dataclass(frozen=True)
class Config:
    """A network: its input and its layers in order."""

    path: Path
    net: Section
    layers: tuple[Section, ...]

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of the network's input in pixels."""
        return self.net.integer("height", least=1), self.net.integer("width", least=1)


def read_config(path: Path) -> Config:
    """Read and check a Darknet configuration.

    Raises:
        DetectorError: the file cannot be read, or a section or key in it is unknown.
    """
    try:
        text = read_text(path, DetectorError)
    except OSError as error:
        raise DetectorError(f"{path}: cannot be read as a Darknet .cfg ({error})") from error
    return parse_config(text, path)


def parse_config(text: str, path: Path) -> Config:
    """Check the text of a Darknet configuration; ``path`` is its name in messages.

    Raises:
        DetectorError: a section or key is unknown.
    """
    sections: list[Section] = []
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.split("#")[0].strip()
        if not content or content.startswith(";"):
            continue
        if content.startswith("["):
            sections.append(_open_section(path, content, number, len(sections)))
        elif not sections:
            raise DetectorError(f"{path}, line {number}: '{content}' stands before any [section]")
        else:
            _add_option(sections[-1], content, number)
    if not sections or sections[0].kind != "net":
        raise DetectorError(f"{path}: must begin with a [net] section; is it a Darknet .cfg?")
    return Config(path, sections[0], tuple(sections[1:]))


def _open_section(path: Path, content: str, number: int, count: int) -> Section:
    kind = content.strip("[] ").lower()
    kind = _ALIASES.get(kind, kind)
    place = "" if kind == "net" else f"layer {count - 1} "  # as Darknet counts, without [net]
    where = f"{path}, {place}[{kind}] at line {number}"
    if kind not in _READ or (kind == "net") != (count == 0):
        hint = _hint(kind, SECTIONS)
        problem = "must be the first section" if count == 0 or kind == "net" else "is not supported"
        first = "[net]" if count == 0 else f"[{kind}]"
        raise DetectorError(f"{where}: {first} {problem}{hint}")
    return Section(kind, where)


def _add_option(section: Section, content: str, number: int) -> None:
    key, equals, value = (part.strip() for part in content.partition("="))
    if not equals:
        raise section.error(f"line {number}: '{content}' is no key=value")
    known = _READ[section.kind].split()
    if key in _TRAINING.get(section.kind, "").split():
        return
    if key not in known:
        raise section.error(f"unknown key '{key}' at line {number}{_hint(key, known)}")
    if section.options.setdefault(key, value) != value:
        raise section.error(
            f"line {number}: {key}={value}, but {key}={section.options[key]} before"
        )


def _hint(word: str, known: Sequence[str]) -> str:
    if word in _DARKNETS.split():
        return ": Darknet has it, this reader does not; run the network as ONNX"
    return did_you_mean(word, known)
